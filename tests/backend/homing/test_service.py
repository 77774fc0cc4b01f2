"""Flying home over real sockets: who may begin it, what the autopilot hears, and when it ends."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.clock import unix_us
from backend.guided import pages
from estimator.types import HomeSample, Mode, NavigationState
from tests.backend.flight_maker import GROUND_M, LAT_DEG, LON_DEG, state
from tests.backend.guided.scene import PAGE, SET_POINT, Obedient, Scene, becomes, scene
from tests.backend.landing.relative import over_pad
from tests.backend.landing.test_messages import setup
from tests.backend.station_runner import PATIENCE_S, next_of

EAST_M = 300.0
EAST_DEG = math.degrees(EAST_M / (6.39e6 * math.cos(math.radians(LAT_DEG))))


def known(mode: Mode = Mode.VISION, **changes: Any) -> NavigationState:
    """On the home's latitude, 300 m west of it; it hovers, velocity known to 0.2 m/s."""
    hovering = {"vel_ned_m_s": np.zeros(3), "cov_vel_ned_m2_s2": 0.04 * np.eye(3), **changes}
    return replace(state(unix_us(), mode=mode), **hovering)


async def ready(flown: Scene) -> None:
    """A vehicle that the station can fly home: home told, mode and armed heard, a state."""
    while flown.vehicle.telemetry.flight_mode != "LOITER":
        await asyncio.sleep(0.01)
    flown.vehicle._setup = setup()
    flown.vehicle.home = HomeSample(unix_us(), math.radians(LAT_DEG), math.radians(LON_DEG + EAST_DEG), GROUND_M)
    flown.give(known())


async def ask(flown: Scene, **body: Any) -> Any:
    return await flown.running.client.post("/api/v1/vehicles/1/homing", json=body)


async def flying(flown: Scene) -> None:
    """Begin, and go on until velocities are sent that lead east."""
    answer = await ask(flown, action="fly", page=PAGE)
    assert answer.status_code == 200, answer.text
    async with asyncio.timeout(PATIENCE_S):
        while not any(m.vy > 1.0 for m in flown.pilot.of(SET_POINT)):
            flown.give(known())
            await asyncio.sleep(0.05)


async def test_a_preview_shows_the_way_and_moves_nothing(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        await ready(flown)
        shown = await ask(flown, action="preview", speed_m_s=10.0)
        await asyncio.sleep(0.3)

    assert shown.status_code == 200, shown.text
    way = shown.json()["way"]
    assert way["length_m"] == pytest.approx(EAST_M, rel=5e-3)
    assert way["geometry"]["coordinates"][-1][0] == pytest.approx(LON_DEG + EAST_DEG, abs=1e-6)
    assert (shown.json()["active"], shown.json()["phase"]) == (False, None)
    assert flown.pilot.of(SET_POINT) == []


async def test_it_takes_the_vehicle_over_and_flies_it_towards_home(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        await ready(flown)
        await flying(flown)
        told = await next_of(flown.stream, "homing")
        again = await ask(flown, action="fly", page=PAGE)
        landing = await flown.ask(page=PAGE, land=True)
        last = flown.pilot.of(SET_POINT)[-1]

    assert [m.param2 for m in flown.pilot.of("COMMAND_LONG") if m.command == 176] == [4]
    assert abs(last.vx) < 0.5 * last.vy
    assert told["vehicle_id"] == "1" and told["way"]["length_m"] == pytest.approx(EAST_M, rel=5e-3)
    assert (again.status_code, landing.status_code) == (409, 409)
    assert "flown already (homing)" in again.json()["detail"]


async def test_what_cannot_be_flown_is_refused_in_words(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        no_state = await ask(flown, action="preview")
        await ready(flown)
        no_page = await ask(flown, action="fly")
        stranger = await ask(flown, action="fly", page="somebody")
        flown.give(known(Mode.LOST))
        lost = await ask(flown, action="fly", page=PAGE)
        flown.give(known(cov_pos_ned_m2=np.diag([2500.0, 1.0, 1.0])))
        vague = await ask(flown, action="fly", page=PAGE)
        flown.give(known())
        flown.vehicle.home = None
        homeless = await ask(flown, action="fly", page=PAGE)
        named = await ask(flown, action="preview", home={"lat_deg": LAT_DEG + 0.002, "lon_deg": LON_DEG})
        nonsense = await ask(flown, action="fly", page=PAGE, speed_m_s=400.0)
        nobody = await flown.running.client.get("/api/v1/vehicles/9/homing")

    answers = (no_state, no_page, stranger, lost, vague, homeless, nonsense, nobody)
    assert [a.status_code for a in answers] == [409, 409, 409, 409, 409, 409, 422, 404]
    assert "lost the place" in lost.json()["detail"]
    assert "known to 50 m only" in vague.json()["detail"]
    assert "where its home is" in homeless.json()["detail"]
    assert named.status_code == 200
    assert flown.pilot.of(SET_POINT) == []


async def test_when_the_page_goes_it_stands_by_vision_and_an_order_of_another_page_moves_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pages, "GONE_US", 0)
    async with scene(tmp_path, kind=Obedient) as flown:
        await ready(flown)
        await flying(flown)
        await flown.stream.close()
        async with flown.running.stream() as other, asyncio.timeout(PATIENCE_S):
            told = await next_of(other, "homing")
            while told["phase"] != "hold":
                flown.give(known())
                told = await next_of(other, "homing")
            count = len(flown.pilot.of(SET_POINT))
            while len(flown.pilot.of(SET_POINT)) < count + 10:
                flown.give(known())
                await asyncio.sleep(0.05)
            assert flown.pilot.mode == Obedient.MODES["GUIDED"]  # type: ignore[attr-defined]
            await flown.running.client.post("/api/v1/vehicles/1/commands", json={"command": "hold"})
        ended = await flown.running.client.get("/api/v1/vehicles/1/homing")

    assert "page has gone" in told["reason"]
    assert ended.json()["active"] is False and "the operator said 'hold'" in ended.json()["reason"]


async def test_it_is_ended_by_the_operator_and_then_holds_by_itself(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        await ready(flown)
        await flying(flown)
        first = await ask(flown, action="abort")
        flown.give(known())
        second = await ask(flown, action="abort")
        await becomes(flown, "LOITER")

    assert (first.json()["active"], first.json()["phase"]) == (True, "hold")
    assert (second.json()["active"], second.json()["phase"]) == (False, "abort")


async def test_over_home_a_pad_in_sight_takes_over(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        await ready(flown)
        await flying(flown)
        alarms: list[str] = []
        async with asyncio.timeout(PATIENCE_S):
            for _ in range(600):
                # It is carried home: the autopilot of this test does not fly.
                there = known(
                    pos_ned_m=np.array([0.2, EAST_M, -60.0]), vel_ned_m_s=np.array([0.0, 0.0, 0.8]),
                    pad=over_pad(unix_us(), (0.6, -0.4, -18.0)).pad,
                )  # fmt: skip
                flown.give(there)
                await asyncio.sleep(0.05)
                landing = (await flown.running.client.get("/api/v1/vehicles/1/landing")).json()["descent"]
                if landing is not None:
                    break
            while "over_home" not in alarms:
                alarms.append((await next_of(flown.stream, "alarm"))["code"])
        homing = (await flown.running.client.get("/api/v1/vehicles/1/homing")).json()

    assert landing is not None and landing["active"]
    assert homing["active"] is False
    assert flown.pilot.mode == Obedient.MODES["GUIDED"]  # type: ignore[attr-defined]
