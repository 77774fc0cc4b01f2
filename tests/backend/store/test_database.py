"""The database file: what survives a kill, who waits for whom, and files that cannot be used."""

from __future__ import annotations

import asyncio
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import func, select, text
from sqlalchemy.exc import IntegrityError

from backend.errors import StartError
from backend.store.database import Database
from backend.store.models import SCHEMA_VERSION, TargetRow

# Commits one target, begins another, and is killed before that is committed.
_KILLED = """
import asyncio, os, signal, sys
from pathlib import Path
from backend.store.database import Database
from backend.store.models import TargetRow

def row(name):
    return TargetRow(id=name, name=name, lat_deg=47.0, lon_deg=8.0, method="manual", created_unix_us=1,
                     updated_unix_us=1, version=1)

async def main():
    database = await Database.open(Path(sys.argv[1]))
    async with database.session.begin() as session:
        session.add(row("kept"))
    async with database.session.begin() as session:
        session.add(row("half"))
        await session.flush()
        os.kill(os.getpid(), signal.SIGKILL)

asyncio.run(main())
"""


def row(name: str) -> TargetRow:
    return TargetRow(
        id=name, name=name, lat_deg=47.0, lon_deg=8.0, method="manual", created_unix_us=1, updated_unix_us=1, version=1
    )


async def names(database: Database) -> list[str]:
    async with database.session() as session:
        return sorted(await session.scalars(select(TargetRow.name)))


def open_files(path: Path) -> list[str]:
    """Which of this process's open files lie under a path."""
    found = []
    for entry in Path("/proc/self/fd").iterdir():
        try:
            found.append(str(entry.readlink()))
        except OSError:
            continue
    return [name for name in found if name.startswith(str(path))]


async def test_a_killed_process_loses_nothing_committed_and_keeps_nothing_half_done(tmp_path: Path) -> None:
    path = tmp_path / "s.db"
    killed = subprocess.run([sys.executable, "-c", _KILLED, str(path)], check=False, capture_output=True, timeout=60)
    assert killed.returncode == -9, killed.stderr.decode()
    database = await Database.open(path)
    found = await names(database)
    async with database.session() as session:
        sound = (await session.execute(text("PRAGMA integrity_check"))).scalar_one()
    await database.close()

    assert found == ["kept"]
    assert sound == "ok"


async def test_readers_do_not_wait_for_a_writer(tmp_path: Path) -> None:
    """In the middle of a transaction others read what was there before it."""
    database = await Database.open(tmp_path / "s.db")
    async with database.session.begin() as session:
        session.add(row("first"))
    async with database.session.begin() as writing:
        writing.add(row("second"))
        await writing.flush()
        during = await asyncio.wait_for(names(database), 10.0)
    after = await names(database)
    await database.close()

    assert (during, after) == (["first"], ["first", "second"])


async def test_a_failed_transaction_leaves_nothing(tmp_path: Path) -> None:
    database = await Database.open(tmp_path / "s.db")
    with pytest.raises(IntegrityError):
        async with database.session.begin() as session:
            session.add(row("a"))
            await session.flush()
            await session.execute(text("INSERT INTO targets SELECT * FROM targets"))
    found = await names(database)
    await database.close()

    assert found == []


async def test_every_connection_is_durable(tmp_path: Path) -> None:
    """Connections are made as they are needed: the second must be as careful as the first."""
    database = await Database.open(tmp_path / "s.db")
    async with database.session() as one, database.session() as two:
        for session in (one, two):
            await session.execute(select(func.count()).select_from(TargetRow))
        settings = [
            [(await session.execute(text(f"PRAGMA {name}"))).scalar_one() for name in ("synchronous", "foreign_keys")]
            for session in (one, two)
        ]
    await database.close()

    assert settings == [[2, 1], [2, 1]]  # FULL, on


async def test_an_existing_database_is_used_as_it_is_and_marked(tmp_path: Path) -> None:
    """One whose version nobody wrote yet, with a target in it."""
    first = await Database.open(tmp_path / "s.db")
    async with first.session.begin() as session:
        session.add(row("old"))
    await first.close()
    with closing(sqlite3.connect(tmp_path / "s.db")) as connection:
        connection.execute("PRAGMA user_version = 0")
    second = await Database.open(tmp_path / "s.db")
    found = await names(second)
    await second.close()
    with closing(sqlite3.connect(tmp_path / "s.db")) as connection:
        (version,) = connection.execute("PRAGMA user_version").fetchone()

    assert found == ["old"]
    assert version == SCHEMA_VERSION


async def test_an_older_database_gets_the_columns_that_were_added_since(tmp_path: Path) -> None:
    """One of schema 1, which knew neither the height above ground nor the choice of the ground."""
    first = await Database.open(tmp_path / "s.db")
    async with first.session.begin() as session:
        session.add(row("old"))
    await first.close()
    with closing(sqlite3.connect(tmp_path / "s.db")) as connection:
        connection.execute("ALTER TABLE targets DROP COLUMN height_above_ground_m")
        connection.execute("ALTER TABLE targets DROP COLUMN ground")
        connection.execute("PRAGMA user_version = 1")
    second = await Database.open(tmp_path / "s.db")
    async with second.session.begin() as session:
        new = row("new")
        new.height_above_ground_m, new.ground = 4.5, "flat"
        session.add(new)
    await second.close()
    third = await Database.open(tmp_path / "s.db")
    async with third.session() as session:
        found = {r.name: (r.height_above_ground_m, r.ground) for r in await session.scalars(select(TargetRow))}
    await third.close()

    assert found == {"old": (None, None), "new": (4.5, "flat")}


@pytest.mark.parametrize("kind", ["folder", "missing folder", "cut off", "newer"])
async def test_a_file_that_cannot_be_used_is_named_and_let_go(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "s.db"
    if kind == "folder":
        path.mkdir()
    elif kind == "missing folder":
        path = tmp_path / "absent" / "s.db"
    else:
        whole = await Database.open(path)
        await whole.close()
        if kind == "cut off":
            path.write_bytes(path.read_bytes()[:1500])
        else:
            with closing(sqlite3.connect(path)) as connection:
                connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    content = path.read_bytes() if path.is_file() else None

    with pytest.raises(StartError, match=r"s\.db") as refused:
        await Database.open(path)

    assert "--data-dir" in str(refused.value)
    assert open_files(tmp_path) == []
    # what may be of use to somebody else is left as it was
    assert content is None or path.read_bytes() == content
