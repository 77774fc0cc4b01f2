"""Targets of the last minute move when later fixes move the states that they were located with."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.clicks import clicked_target
from backend.evidence.collect import Sighting
from backend.evidence.keeper import EvidenceKeeper
from backend.fleet.feed import FrameIdentity
from backend.mapping import StationMaps
from backend.metrics import Metrics
from backend.navigation.setup import NavigationSetup
from backend.navigation.worker import NavigationWorker
from backend.refining import refiner
from backend.refining.later import LiveFixes
from backend.refining.refiner import CUT_OFF, NO_MAP, WAITING, Refiner
from backend.schemas.geometry import NewTarget
from backend.store.database import Database
from backend.store.targets import Target, TargetChange, TargetStore
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.history import Corrected
from estimator.types import NavigationState
from geodata.elevation import FlatGround
from tests.backend.flight_maker import GROUND_M, LAT_DEG, LON_DEG, T0_US, state

SETUP = NavigationSetup(
    Camera.from_hfov(640, 480, 1.0), Mount(0.0, -math.pi / 2, 0.0, np.zeros(3)), "fixed", True,
    LocalFrame(math.radians(LAT_DEG), math.radians(LON_DEG), GROUND_M), None, FlatGround(GROUND_M), 10.0, None,
)  # fmt: skip
FRAME = FrameIdentity(7, T0_US, 640, 480)


def drifting(n: int, std_m: float, north_m: float = 0.0) -> NavigationState:
    """The state of step ``n``, ten a second, whose position is known to ``std_m``."""
    cov = np.diag([*[std_m**2] * 3, *[0.04] * 3, *[1e-6] * 3, 1e-6])
    at = state(T0_US + n * 100_000, north_m=north_m)
    pose = np.diag([*[std_m**2] * 3, *[1e-6] * 3])
    return replace(
        at, process_model="attitude", cov_motion=cov, cov_pos_ned_m2=std_m**2 * np.eye(3), cov_camera_pose=pose
    )


def fixed_after(steps: int, jump_m: float) -> list[Corrected]:
    """Nothing is measured for some steps; then a fix moves the position north."""
    kept = [Corrected(each, each) for each in (drifting(n, 5.0) for n in range(steps))]
    return [*kept, Corrected(drifting(steps, 5.2), drifting(steps, 0.5, jump_m))]


class Vehicle:
    """A vehicle whose state at the click is the first of ``drifting``."""

    id = "1"
    setup = SETUP

    def exposure_us(self, frame: FrameIdentity) -> int:
        return frame.t_us

    async def state_at(self, _: int) -> NavigationState:
        return drifting(0, 5.0)

    def assumption_at(self, _: int) -> None:
        return None


class Bench:
    """A refiner with a real store and real evidence."""

    def __init__(self, folder: Path, store: TargetStore) -> None:
        self.store, self.told = store, list[Target]()
        self.evidence = EvidenceKeeper(folder / "evidence", StationMaps(folder / "maps"), "test")
        self.refiner = Refiner(lambda: store, self.evidence, Metrics(), self.told.append)
        self.worker = NavigationWorker("test", _never, delay_us=0, on_state=_ignore, on_reports=_ignore)

    async def click(self) -> Sighting:
        body = NewTarget(vehicle_id="1", frame_id=7, u_px=320.0, v_px=100.0, name="x")
        vehicle: Any = Vehicle()
        sighting = await clicked_target(body, vehicle, FRAME)
        target = replace(sighting.target, registration=self.refiner.prospect(sighting))
        sighting = replace(sighting, target=target)
        await self.evidence.keep_again(sighting, "cam-1", None)
        await self.store.add(target)
        await self.evidence.confirm(target.id)
        self.refiner.take(sighting, "cam-1", None, LiveFixes(self.worker))
        return sighting

    async def looked_back(self) -> None:
        before = len(self.told)
        for _ in range(100):
            await asyncio.sleep(0.02)
            if len(self.told) > before:
                return


def _never() -> Any:
    raise AssertionError("the estimator is not started here")


def _ignore(_: object) -> None: ...


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refiner, "LOOK_BACK_S", 0.05)
    monkeypatch.setattr(refiner, "QUIET_US", 0)


async def opened(folder: Path) -> tuple[Database, Bench]:
    database = await Database.open(folder / "station.db")
    return database, Bench(folder, await TargetStore.load(database))


async def test_a_later_fix_moves_the_target_with_its_evidence(tmp_path: Path) -> None:
    database, bench = await opened(tmp_path)
    await bench.refiner.start()
    sighting = await bench.click()
    bench.worker.corrected = lambda: fixed_after(10, 4.0)
    await bench.looked_back()
    moved = bench.store.get(sighting.target.id)
    proof = await bench.evidence.bundle(moved, None)
    first = await bench.evidence.bundle(moved, 1)
    await asyncio.sleep(0.3)
    told = len(bench.told)
    await bench.refiner.close()
    await database.close()

    north_m = math.radians(moved.lat_deg - sighting.target.lat_deg) * 6.37e6
    assert 3.0 < north_m < 4.1  # what the fix moved, less what the way since then leaves open
    assert (moved.version, moved.refined, moved.registration) == (2, 1, NO_MAP)
    assert (moved.var_n_m2 or 0.0) < 0.5 * (sighting.target.var_n_m2 or 0.0)
    assert proof.evidence.target.version == 2
    assert proof.evidence.state.corrected_by_later_fixes
    assert proof.evidence.result.lat_deg == moved.lat_deg
    assert (first.evidence.target.version, first.evidence.state.corrected_by_later_fixes) == (1, False)
    assert first.status is not None
    assert told == 1  # the same fix moves it once


async def test_a_target_that_somebody_has_moved_stays(tmp_path: Path) -> None:
    database, bench = await opened(tmp_path)
    await bench.refiner.start()
    sighting = await bench.click()
    await bench.store.change(sighting.target.id, TargetChange(position_deg=(47.0, 8.0)), None, 1)
    bench.worker.corrected = lambda: fixed_after(10, 4.0)
    await asyncio.sleep(0.4)
    found = bench.store.get(sighting.target.id)
    await bench.refiner.close()
    await database.close()

    assert (found.lat_deg, found.version, found.method) == (47.0, 2, "manual")
    assert bench.told == []


async def test_small_corrections_and_renaming_change_no_coordinate(tmp_path: Path) -> None:
    database, bench = await opened(tmp_path)
    await bench.refiner.start()
    sighting = await bench.click()
    await bench.store.change(sighting.target.id, TargetChange(name="renamed"), None, 1)
    bench.worker.corrected = lambda: fixed_after(10, 0.3)
    await asyncio.sleep(0.4)
    same = bench.store.get(sighting.target.id)
    bench.worker.corrected = lambda: fixed_after(10, 4.0)
    await bench.looked_back()
    moved = bench.store.get(sighting.target.id)
    await bench.refiner.close()
    await database.close()

    assert (same.lat_deg, same.version) == (sighting.target.lat_deg, 2)
    assert (moved.name, moved.version, moved.refined) == ("renamed", 3, 1)


async def test_what_an_earlier_end_cut_off_does_not_wait_for_ever(tmp_path: Path) -> None:
    database, bench = await opened(tmp_path)
    waiting = Target("a", "x", 47.0, 8.0, 400.0, "ray_terrain", 1, 1, registration=WAITING)
    await bench.store.add(waiting)
    await bench.refiner.start()
    await bench.refiner.close()
    await database.close()

    assert bench.store.get("a").registration == CUT_OFF


@pytest.mark.parametrize(("version", "left"), [(1, ["t.zip"]), (2, ["t.zip", "t@2.zip"])])
async def test_evidence_of_a_version_that_was_never_kept_is_removed(
    tmp_path: Path, version: int, left: list[str]
) -> None:
    """
    Fault: the process dies after the evidence of a better coordinate was written, before or after its row was.
    Expected: the evidence stays where the row has that version, and goes where it has not.
    """
    keeper = EvidenceKeeper(tmp_path, StationMaps(tmp_path / "maps"), "test")
    (tmp_path / "t.zip").write_bytes(b"1")
    (tmp_path / "t@2.new").write_bytes(b"2")

    await keeper.tidy({"t": version})

    assert sorted(path.name for path in tmp_path.glob("t*")) == left
