"""One live vehicle with a real estimator: what it says in each phase, and what it makes of a restart."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.clock import unix_us
from backend.fleet.feed import FrameIdentity
from backend.fleet.vehicle import GpsReading, LiveVehicle, gps_reading, place_of_gnss
from backend.link.events import TelemetryGps
from backend.navigation.setup import CameraProfile, MapFiles, NavigationSetup, Place, build_setup
from backend.navigation.worker import StateUpdate
from estimator.geometry.rotation import q_from_euler
from estimator.types import (
    AttitudeSample,
    BarometerSample,
    FixReport,
    FrameSample,
    GnssSample,
    HomeSample,
    Mode,
    NavigationState,
)
from geodata.flight_meta import MapMeta
from tests.backend.flight_maker import CAMERA, GROUND_M, HEIGHT_M, LAT_DEG, LON_DEG

PATIENCE_S = 30.0
LAT, LON = math.radians(LAT_DEG), math.radians(LON_DEG)
LEVEL = q_from_euler(0.0, 0.0, 0.0)


def setup(time_offset_s: float | None = 0.0) -> NavigationSetup:
    profile = CameraProfile(CAMERA, MapMeta(ground_alt_amsl_m=GROUND_M), None)
    return build_setup(profile, MapFiles(None, None, None, None), Place(LAT, LON, GROUND_M), None, time_offset_s)


def fix(t_us: int) -> GnssSample:
    return GnssSample(t_us, LAT, LON, GROUND_M + HEIGHT_M, np.zeros(3), 1.5, 2.5, 12)


class Vehicle:
    """A vehicle, and everything it told."""

    def __init__(self) -> None:
        self.updates: list[StateUpdate] = []
        self.reports: list[FixReport] = []
        self.changed = asyncio.Event()
        self.vehicle = LiveVehicle(7, "udpin:0.0.0.0:14550", 0, self._state, lambda _, made: self.reports.extend(made))

    def _state(self, vehicle: LiveVehicle, update: StateUpdate) -> None:
        self.updates.append(update)
        self.changed.set()

    def offer_a_moment(self, *, gps: bool = True) -> int:
        t_us = unix_us()
        self.vehicle.offer(AttitudeSample(t_us, LEVEL, np.zeros(3)))
        self.vehicle.offer(BarometerSample(t_us, GROUND_M + HEIGHT_M))
        if gps:
            self.vehicle.offer(fix(t_us))
        return t_us

    async def fly_until(self, count: int) -> None:
        """Goes on reporting until the estimator has spoken so many times more."""
        wanted = len(self.updates) + count
        async with asyncio.timeout(PATIENCE_S):
            while len(self.updates) < wanted:
                self.offer_a_moment()
                self.changed.clear()
                try:
                    await asyncio.wait_for(self.changed.wait(), 0.05)
                except TimeoutError:
                    continue


@asynccontextmanager
async def a_vehicle() -> AsyncIterator[Vehicle]:
    made = Vehicle()
    try:
        yield made
    finally:
        made.vehicle.stop_navigation()


async def test_before_it_is_placed_it_says_what_it_waits_for_and_answers_nothing() -> None:
    async with a_vehicle() as made:
        vehicle = made.vehicle
        vehicle.offer(fix(unix_us()))

        assert "home position or a GPS fix" in vehicle.waiting_for()[0]
        assert (vehicle.here(), vehicle.state_message(), vehicle.gps_message()) == (None, None, None)
        assert await vehicle.state_at(unix_us()) is None
        assert vehicle.exposure_us(FrameIdentity(1, 123, 320, 240)) == 123
        assert vehicle.summary()["map_id"] is None
        vehicle.stop_navigation()  # nothing to stop


async def test_it_aligns_and_says_where_it_is() -> None:
    async with a_vehicle() as made:
        vehicle = made.vehicle
        vehicle.offer(HomeSample(unix_us(), LAT, LON, GROUND_M))
        vehicle.navigate(setup())
        assert vehicle.waiting_for() != []
        await made.fly_until(5)
        message = vehicle.state_message()
        now = await vehicle.state_at(unix_us())
        long_ago = await vehicle.state_at(unix_us() - 3_600_000_000)
        waits = vehicle.waiting_for()

    assert vehicle.here() == Place(LAT, LON, GROUND_M)
    assert message is not None
    assert (message["vehicle_id"], message["mode"], message["epoch"]) == ("7", "gps", 1)
    assert message["lat_deg"] == pytest.approx(LAT_DEG, abs=1e-4)
    assert message["alt_agl_m"] == pytest.approx(HEIGHT_M, abs=15.0)
    assert message["video_clock"]["source"] == "given"
    assert waits == []
    assert now is not None
    assert_allclose(np.degrees([now.lat_rad, now.lon_rad]), [LAT_DEG, LON_DEG], atol=1e-4)
    assert long_ago is None
    points = vehicle.tracks["vision"].pieces(0)
    assert [point.epoch for piece in points for point in piece] == [1] * sum(map(len, points))


async def test_a_new_setup_begins_a_new_epoch_and_the_old_estimator_is_not_heard() -> None:
    async with a_vehicle() as made:
        vehicle = made.vehicle
        vehicle.navigate(setup())
        await made.fly_until(2)
        old = vehicle.worker
        vehicle.navigate(setup())
        # what the old one said last may still be on its way into the loop
        stale = replace(made.updates[-1], epoch=1)
        before = len(made.updates)
        vehicle._take_state(stale)
        assert len(made.updates) == before
        await made.fly_until(2)

    assert old is not None
    assert vehicle.worker is None  # closed by now
    assert {update.epoch for update in made.updates[before:]} == {2}
    assert not old._thread.is_alive()


async def test_a_question_to_an_estimator_that_is_replaced_has_no_answer() -> None:
    """It does not hang, and does not look like the cancelling of who asks."""
    async with a_vehicle() as made:
        vehicle = made.vehicle
        vehicle.navigate(setup())
        asking = [asyncio.create_task(vehicle.state_at(unix_us())) for _ in range(20)]
        vehicle.stop_navigation(wait_s=0.0)
        answers = await asyncio.wait_for(asyncio.gather(*asking), PATIENCE_S)
        assert await vehicle.state_at(unix_us()) is None

    assert all(answer is None or isinstance(answer, NavigationState) for answer in answers)


async def test_gps_is_kept_from_the_estimator_before_and_after_it_starts() -> None:
    async with a_vehicle() as made:
        vehicle = made.vehicle
        vehicle.take_gps(GpsReading(unix_us(), 3, 12, LAT_DEG, LON_DEG, 500.0, 1.0))
        vehicle.deny_gps(True)
        vehicle.offer(HomeSample(unix_us(), LAT, LON, GROUND_M))
        vehicle.navigate(setup())
        await made.fly_until(3)  # from home, after the patience with satellites
        denied = vehicle.gps_message()
        modes = {update.state.mode for update in made.updates}
        vehicle.deny_gps(False)
        async with asyncio.timeout(PATIENCE_S):
            while made.updates[-1].state.mode is not Mode.GPS:
                await made.fly_until(1)
        used = vehicle.gps_message()

    assert Mode.GPS not in modes
    assert denied is not None
    assert used is not None
    assert (denied["used"], used["used"]) == (False, True)
    assert vehicle.summary()["gps_denied"] is False


async def test_pictures_without_a_camera_file_do_not_reach_the_estimator() -> None:
    async with a_vehicle() as made:
        vehicle = made.vehicle
        blind = build_setup(None, MapFiles(None, None, None, None), Place(LAT, LON, GROUND_M))
        vehicle.navigate(blind)
        vehicle.offer(FrameSample(unix_us(), 1, np.zeros((480, 640), np.uint8)))
        await made.fly_until(1)
        assert vehicle.worker is not None
        counts = vehicle.worker.counts
        message = vehicle.state_message()

    assert (counts.frames, counts.failures) == (0, 0)
    assert message is not None
    assert (message["footprint"], message["video_clock"], message["boresight_deg"]) == (None, None, None)


async def test_an_estimator_that_breaks_says_so_and_starts_anew() -> None:
    """
    Fault: a sample whose arithmetic fails.
    Expected: the vehicle says what it recovers from, then goes on in another epoch.
    """
    async with a_vehicle() as made:
        vehicle = made.vehicle
        vehicle.navigate(setup())
        await made.fly_until(2)
        said: list[str] = []
        async with asyncio.timeout(PATIENCE_S):
            while not any("recover" in text for text in said):
                # of several in a fifth of a second one is used
                vehicle.offer(BarometerSample(unix_us(), "high"))  # type: ignore[arg-type]
                await asyncio.sleep(0.05)
                said = vehicle.waiting_for()
            while made.updates[-1].epoch == 1:
                await made.fly_until(1)

    assert any("recover from: " in text for text in said)
    assert made.updates[-1].epoch == 2


def test_the_receivers_words_become_degrees_and_a_track_only_with_a_fix() -> None:
    live = LiveVehicle(7, "x", 0, lambda *_: None, lambda *_: None)
    live.take_gps(gps_reading(TelemetryGps(1_000_000, 7, 1, 0, None, None, None, None)))
    assert live.gps_message() == {
        "vehicle_id": "7", "lat_deg": None, "lon_deg": None, "alt_amsl_m": None, "fix_type": 1, "satellites": 0,
        "std_horizontal_m": None, "used": False, "t_gps_unix_us": 1_000_000,
    }  # fmt: skip
    for n in (2, 3):
        live.take_gps(gps_reading(TelemetryGps(n * 1_000_000, 7, 3, 9, LAT, LON, 512.0, 1.5)))

    (piece,) = live.tracks["gps"].pieces(0)
    assert [point.t_us for point in piece] == [2_000_000, 3_000_000]
    assert piece[0].lat_deg == pytest.approx(LAT_DEG)


def test_the_ground_below_a_fix_is_guessed_from_the_height_above_home() -> None:
    assert place_of_gnss(fix(0), 100.0) == Place(LAT, LON, GROUND_M)
    assert place_of_gnss(fix(0), None).alt_amsl_m == GROUND_M + HEIGHT_M
