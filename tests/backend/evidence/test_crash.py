"""The process dies, or the disk refuses, between the steps that keep a target and its evidence."""

import contextlib
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.backend.evidence.flown import click, click_body, evidence_zip, hilly_station, write_hilly_flight

# Runs a station, clicks once (and deletes); the process ends at once, without any tidying, where it is told to.
DYING = """
import asyncio, os, sys
from pathlib import Path
from backend.evidence.keeper import EvidenceKeeper
from backend.store.targets import TargetStore
from tests.backend.evidence.flown import click, hilly_station

owner, name = {"TargetStore": TargetStore, "EvidenceKeeper": EvidenceKeeper}[sys.argv[2]], sys.argv[3]

async def die(*_):
    os._exit(9)

async def run():
    async with hilly_station(Path(sys.argv[1])) as running:
        setattr(owner, name, die)
        target = await click(running)
        await running.client.delete(f"/api/v1/targets/{target['id']}")
    os._exit(1)

asyncio.run(run())
"""


@pytest.mark.parametrize(
    ("owner", "step", "kept"),
    [
        ("TargetStore", "add", False),  # evidence, no row: nobody was told of the target
        ("EvidenceKeeper", "confirm", True),  # evidence and row, the last renaming is missing
        ("TargetStore", "delete", True),  # evidence set aside, the row is still there
        ("EvidenceKeeper", "deleted", False),  # the row is gone, the evidence is not
    ],
)
async def test_a_crash_leaves_target_and_evidence_or_neither(tmp_path: Path, owner: str, step: str, kept: bool) -> None:
    """
    Fault: the process dies between two steps of keeping or deleting a clicked target.
    Expected: after the next start there is the target with its evidence, or no trace of either.
    """
    write_hilly_flight(tmp_path / "flights" / "hills")
    died = subprocess.run(
        [sys.executable, "-c", DYING, str(tmp_path), owner, step], capture_output=True, text=True, timeout=120,
        check=False, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    assert died.returncode == 9, died.stderr
    before = [path.suffix for path in (tmp_path / "evidence").iterdir()]

    async with hilly_station(tmp_path) as running:
        targets = (await running.client.get("/api/v1/targets")).json()["features"]
        files = [path.name for path in (tmp_path / "evidence").iterdir()]
        answers = [(await evidence_zip(running, target["id"])).status_code for target in targets]

    assert before in ([".new"], [".deleting"])
    assert files == [f"{target['id']}.zip" for target in targets]
    assert answers == ([200] if kept else [])


async def test_an_unwritable_folder_refuses_the_click_in_words(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        (tmp_path / "evidence").write_text("in the way")
        refused = await running.client.post("/api/v1/targets", json=click_body())
        listed = (await running.client.get("/api/v1/targets")).json()["features"]
        (tmp_path / "evidence").unlink()
        target = await click(running)
        found = await evidence_zip(running, target["id"])

    assert refused.status_code == 507
    assert refused.headers["content-type"] == "application/problem+json"
    assert "evidence" in refused.json()["detail"]
    assert "make room" in refused.json()["detail"]
    assert listed == []
    assert found.status_code == 200


@contextlib.contextmanager
def files_no_larger_than(size_bytes: int) -> Iterator[None]:
    """Further writing of this process fails, as on a full disk, though with another number."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


async def test_a_disk_that_takes_no_more_keeps_nothing_half(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        with files_no_larger_than(1_000):
            refused = await running.client.post("/api/v1/targets", json=click_body())
        listed = (await running.client.get("/api/v1/targets")).json()["features"]
        left = list((tmp_path / "evidence").iterdir())
        await click(running)

    assert refused.status_code == 507, refused.text
    assert "data folder cannot be written" in refused.json()["detail"]
    assert (listed, left) == ([], [])


async def test_evidence_beside_another_database_is_left_alone(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        target = await click(running)
    (tmp_path / "station.db").rename(tmp_path / "moved.db")
    async with hilly_station(tmp_path):
        left = [path.name for path in (tmp_path / "evidence").iterdir()]

    assert left == [f"{target['id']}.zip"]
