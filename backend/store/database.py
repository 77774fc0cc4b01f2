"""The database: opening it so that what was acknowledged is on the disk."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, event, inspect, text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.ext.asyncio import AsyncEngine, AsyncSession, async_sessionmaker, create_async_engine

from backend.errors import StartError
from backend.store.models import SCHEMA_VERSION, Base


class Database:
    """An open database. Writers take turns (``writing``), readers do not wait for them."""

    def __init__(self, engine: AsyncEngine) -> None:
        self._engine = engine
        self.session = async_sessionmaker(engine, expire_on_commit=False, class_=AsyncSession)
        self.writing = asyncio.Lock()

    @classmethod
    async def open(cls, path: Path) -> Database:
        """Open or create the database file.

        Raises
        ------
        StartError
            The file cannot be used, is no database, or was written by a newer version.
        """
        engine = create_async_engine(f"sqlite+aiosqlite:///{path}")
        event.listen(engine.sync_engine, "connect", _make_durable)
        try:
            async with engine.begin() as connection:
                version = (await connection.execute(text("PRAGMA user_version"))).scalar_one()
                if version > SCHEMA_VERSION:
                    raise StartError(
                        f"database '{path}' was written by a newer Pilotage (schema {version}, this one knows "
                        f"{SCHEMA_VERSION}): update, or give another --data-dir"
                    )
                await connection.run_sync(Base.metadata.create_all)
                await connection.run_sync(_add_missing_columns)
                await connection.execute(text(f"PRAGMA user_version = {SCHEMA_VERSION}"))
        except SQLAlchemyError as error:
            await engine.dispose()
            reason = getattr(error, "orig", None) or error
            raise StartError(
                f"database '{path}' cannot be used: {reason}; move it away or give another --data-dir"
            ) from None
        except StartError:
            await engine.dispose()
            raise
        return cls(engine)

    async def close(self) -> None:
        """Close all connections."""
        await self._engine.dispose()


def _add_missing_columns(connection: Connection) -> None:
    """Give the tables of an older database what has been added since: columns that may be null, so nothing is lost."""
    for table in Base.metadata.sorted_tables:
        there = {column["name"] for column in inspect(connection).get_columns(table.name)}
        for column in table.columns:
            if column.name not in there and column.nullable:
                kind = column.type.compile(connection.dialect)
                connection.execute(text(f'ALTER TABLE "{table.name}" ADD COLUMN "{column.name}" {kind}'))


def _make_durable(connection: Any, _record: object) -> None:
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode=WAL")
    # WAL with NORMAL may lose the last commits in a power cut; an acknowledged target must survive one.
    cursor.execute("PRAGMA synchronous=FULL")
    cursor.execute("PRAGMA busy_timeout=5000")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.close()
