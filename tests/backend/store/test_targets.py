"""The target store, and databases that cannot be used."""

import asyncio
import sqlite3
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path

import pytest
from sqlalchemy import text

from backend.errors import StartError, TargetChangedError, UnknownTargetError
from backend.store.database import Database
from backend.store.lock import DataDirLock
from backend.store.models import TargetRow
from backend.store.targets import Target, TargetChange, TargetStore, TrackUpdate


def target(name: str, created_us: int = 1) -> Target:
    return Target(
        name, name, 47.0, 8.0, 400.0, "ray_terrain", created_us, created_us, vehicle_id="1", frame_id=2**40,
        t_unix_us=1_760_000_000_123_456, u_px=1.5, v_px=2.5, var_n_m2=1.0, var_e_m2=2.0, var_d_m2=3.0, cov_ne_m2=-0.1,
    )  # fmt: skip


@asynccontextmanager
async def opened(path: Path) -> AsyncIterator[TargetStore]:
    database = await Database.open(path)
    try:
        yield await TargetStore.load(database)
    finally:
        await database.close()


async def test_everything_of_a_target_comes_back(tmp_path: Path) -> None:
    async with opened(tmp_path / "s.db") as store:
        await store.add(target("b", 2))
        await store.add(target("a", 1))
    async with opened(tmp_path / "s.db") as store:
        assert store.all() == [target("a", 1), target("b", 2)]
        assert store.get("b") == target("b", 2)


async def test_changes_and_deletions_reach_the_file(tmp_path: Path) -> None:
    async with opened(tmp_path / "s.db") as store:
        for name in ("a", "b"):
            await store.add(target(name))
        changed = await store.change("a", TargetChange(name="new", position_deg=(1.0, 2.0)), None, now_us=9)
        await store.delete("b", 1)
    async with opened(tmp_path / "s.db") as store:
        assert store.all() == [changed]

    assert (changed.name, changed.lat_deg, changed.method, changed.var_n_m2) == ("new", 1.0, "manual", None)


async def test_a_followed_target_has_its_last_sighting_after_a_restart(tmp_path: Path) -> None:
    """The file is one of schema 2, which knew nothing of following."""
    columns = [name for name in TargetRow.__table__.columns.keys() if name.startswith(("track_", "vel_", "var_vel"))]  # noqa: SIM118
    async with opened(tmp_path / "s.db") as store:
        await store.add(target("a"))
    with closing(sqlite3.connect(tmp_path / "s.db")) as connection:
        for name in [*columns, "seen_unix_us", "moving", "cov_vel_ne_m2_s2"]:
            connection.execute(f"ALTER TABLE targets DROP COLUMN {name}")
        connection.execute("PRAGMA user_version = 2")
    update = TrackUpdate(
        "seen", None, 7, 48.0, 9.0, 401.0, 4.0, 5.0, 0.5, 6.0, True, 3.0, -4.0, 0.1, 0.2, 0.01
    )  # fmt: skip
    async with opened(tmp_path / "s.db") as store:
        before = store.get("a")
        seen = await store.track("a", update, now_us=11)
        lost = await store.set_track("a", "lost", "not seen", now_us=12)
    async with opened(tmp_path / "s.db") as store:
        kept = store.get("a")
        moved = await store.change("a", TargetChange(position_deg=(1.0, 2.0)), None, now_us=13)

    assert before == target("a")
    assert (seen.method, seen.version, seen.followed, seen.lat_deg) == ("followed", 2, True, 48.0)
    assert (seen.frame_id, seen.u_px, seen.t_unix_us) == (
        2**40,
        1.5,
        1_760_000_000_123_456,
    )  # the click's, for evidence
    assert kept == lost
    assert (kept.track_reason, kept.vel_n_m_s, kept.vel_e_m_s, kept.moving) == ("not seen", 3.0, -4.0, True)
    assert (moved.vel_n_m_s, moved.moving, moved.seen_unix_us, moved.method) == (None, None, None, "manual")


async def test_of_many_changes_to_one_version_one_wins(tmp_path: Path) -> None:
    async with opened(tmp_path / "s.db") as store:
        await store.add(target("a"))
        changes = [store.change("a", TargetChange(name=f"n{n}"), 1, now_us=5) for n in range(20)]
        results = await asyncio.gather(*changes, return_exceptions=True)
        final = store.get("a")

    won = [result for result in results if isinstance(result, Target)]
    assert len(won) == 1
    assert sum(isinstance(result, TargetChangedError) for result in results) == 19
    assert final == won[0]
    assert (final.version, final.updated_unix_us) == (2, 5)


async def test_unknown_targets_are_named(tmp_path: Path) -> None:
    async with opened(tmp_path / "s.db") as store:
        with pytest.raises(UnknownTargetError, match="'x'"):
            store.get("x")
        for call in (store.change("x", TargetChange(), None, 1), store.delete("x", None)):
            with pytest.raises(UnknownTargetError, match="'x'"):
                await call


async def test_commits_go_to_the_disk(tmp_path: Path) -> None:
    database = await Database.open(tmp_path / "s.db")
    async with database.session() as session:
        settings = {
            name: (await session.execute(text(f"PRAGMA {name}"))).scalar_one()
            for name in ("journal_mode", "synchronous")
        }
    await database.close()

    assert settings == {"journal_mode": "wal", "synchronous": 2}  # 2 is FULL


async def test_a_file_that_is_no_database_is_named(tmp_path: Path) -> None:
    (tmp_path / "s.db").write_bytes(b"this is not a database, it is a letter" * 100)

    with pytest.raises(StartError, match=r"s\.db.*not a database"):
        await Database.open(tmp_path / "s.db")


async def test_a_database_of_the_future_is_left_alone(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "s.db") as connection:
        connection.execute("PRAGMA user_version = 99")

    with pytest.raises(StartError, match="newer"):
        await Database.open(tmp_path / "s.db")


def test_a_folder_has_one_station(tmp_path: Path) -> None:
    first, second = DataDirLock(tmp_path), DataDirLock(tmp_path)
    first.acquire()
    with pytest.raises(StartError, match="in use by another station"):
        second.acquire()
    first.release()
    second.acquire()
    second.release()
