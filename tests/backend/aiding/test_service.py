"""Aiding over real sockets: who may begin it, what the autopilot hears, what is said of it, and when it ends."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.aiding import service
from backend.clock import unix_us
from backend.guided import pages
from estimator.types import Mode, NavigationState
from tests.backend.flight_maker import GROUND_M, LAT_DEG, LON_DEG, state
from tests.backend.guided.scene import PAGE, Pilot, Scene, scene
from tests.backend.landing.test_messages import setup
from tests.backend.link.wire import ARDUPILOT, PX4, dialect
from tests.backend.station_runner import PATIENCE_S, next_of

NAVIGATION = "/api/v1/vehicles/1/navigation"
AIDING = "/api/v1/vehicles/1/aiding"
PARAMETERS = "/api/v1/vehicles/1/parameters"
INT8, REAL32 = 2, 9


class Aided(Pilot):
    """An autopilot with parameters that answers to positions and says where it has itself, metres north of home."""

    def __init__(self, port: int, autopilot: int) -> None:
        super().__init__(port, autopilot)
        self.parameters = {"AHRS_EKF_TYPE": (3.0, INT8), "EK3_SRC1_POSXY": (3.0, INT8), "GPS_TYPE": (1.0, INT8)}
        self.north_m = 80.0
        self.result = 0
        self.follows = True
        self.origin: Any = None
        self.armed = True

    def heartbeat(self) -> bytes:
        return self.wire.heartbeat(2, self.autopilot, 0x81 if self.armed else 0x01)

    def step(self) -> None:
        heard = len(self.heard)
        super().step()
        lat = round((LAT_DEG + math.degrees(self.north_m / 6.368e6)) * 1e7)
        self.send(self.wire.pack(dialect.MAVLink_global_position_int_message(
            1000, lat, round(LON_DEG * 1e7), 500_000, 100_000, 0, 0, 0, 0
        )))  # fmt: skip
        for m in self.heard[heard:]:
            self.answer(m)

    def answer(self, m: Any) -> None:
        kind = m.get_type()
        if kind == "COMMAND_INT" and m.command == 43003:
            self.send(self.wire.ack(43003, self.result))
            if self.result == 0 and self.follows:
                self.north_m = math.radians(m.x * 1e-7 - LAT_DEG) * 6.368e6
        elif kind == "COMMAND_LONG" and (m.command, m.param1) == (512, 49) and self.origin is not None:
            self.send(self.wire.pack(self.origin))
        elif kind == "PARAM_REQUEST_READ" and m.param_id in self.parameters:
            self.say(m.param_id)
        elif kind == "PARAM_SET" and m.param_id in self.parameters:
            self.parameters[m.param_id] = (m.param_value, m.param_type)
            self.say(m.param_id)

    def say(self, name: str) -> None:
        self.send(self.wire.pack(dialect.MAVLink_param_value_message(name.encode(), *self.parameters[name], 3, 0)))


def flown(*, mode: Mode = Mode.VISION, std_m: float = 1.0) -> NavigationState:
    return replace(
        state(unix_us(), mode=mode), cov_pos_ned_m2=std_m**2 * np.eye(3), vel_ned_m_s=np.zeros(3),
    )  # fmt: skip


class Flying:
    """Gives states 20 times a second, as an estimator does."""

    def __init__(self, scene_: Scene, **how: Any) -> None:
        self.scene, self.how = scene_, how
        scene_.vehicle._setup = setup(pad=False)
        self.task = asyncio.create_task(self.run())

    async def run(self) -> None:
        while True:
            self.scene.give(flown(**self.how))
            await asyncio.sleep(0.05)

    async def __aenter__(self) -> Flying:
        await asyncio.sleep(0)
        return self

    async def __aexit__(self, *_: object) -> None:
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)


async def ask(on: Scene, aiding: str, **more: Any) -> Any:
    return await on.running.client.post(NAVIGATION, json={"aiding": aiding, "page": PAGE, **more})


async def told(on: Scene, wanted: str, value: Any) -> dict[str, Any]:
    """The first ``aiding`` message in which a field has a value."""
    while (message := await next_of(on.stream, "aiding"))[wanted] != value:
        pass
    return message


async def test_an_ardupilot_whose_gps_is_lost_comes_to_the_estimate(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on, Flying(on):
        await asyncio.sleep(0.2)
        answer = await ask(on, "external_position")
        message = await told(on, "effect", "used")
        (first, *_) = await on.pilot.hears("COMMAND_INT")
        off = await ask(on, "off")

    assert answer.json() == {"gps_denied": False, "aiding": "external_position"}
    assert (first.command, first.frame, math.isnan(first.z)) == (43003, 0, True)
    assert (first.x, first.y) == (round(LAT_DEG * 1e7), round(LON_DEG * 1e7))
    assert message["gap_began_m"] == pytest.approx(80.0, abs=0.5)
    assert message["gap_now_m"] < 1.0
    assert message["accepted"] >= 1
    assert (message["sending"], message["refused"], message["last_resort"]) == (True, 0, False)
    assert off.json()["aiding"] == "off"


async def test_a_refusal_is_told_as_one(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on, Flying(on):
        on.pilot.result = 2  # type: ignore[attr-defined]
        await ask(on, "external_position")
        message = await told(on, "effect", "not_used")

    assert (message["accepted"], message["refused"]) == (0, 1)
    assert message["effect_text"] == "the autopilot refuses it (denied)"
    assert message["gap_now_m"] == pytest.approx(80.0, abs=0.5)


async def test_nothing_is_sent_until_asked_and_nothing_after_the_end(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on, Flying(on):
        await asyncio.sleep(0.3)
        assert on.pilot.of("COMMAND_INT") == []
        await ask(on, "external_position")
        await on.pilot.hears("COMMAND_INT")
        await ask(on, "off")
        await on.pilot.hears("HEARTBEAT", len(on.pilot.of("HEARTBEAT")) + 1)
        count = len(on.pilot.of("COMMAND_INT"))
        await on.pilot.hears("HEARTBEAT", len(on.pilot.of("HEARTBEAT")) + 2)
        assert len(on.pilot.of("COMMAND_INT")) == count


async def test_a_lost_place_pauses_it_and_a_found_one_goes_on(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on, Flying(on) as flying:
        await ask(on, "external_position")
        await on.pilot.hears("COMMAND_INT")
        flying.how = {"mode": Mode.LOST}
        while (paused := await next_of(on.stream, "alarm"))["code"] != "position_aiding_paused":
            pass
        count = len(on.pilot.of("COMMAND_INT"))
        message = await told(on, "sending", False)
        flying.how = {"std_m": 30.0}
        while "30.0 m" not in (uncertain := await next_of(on.stream, "aiding"))["reason"]:
            pass
        assert len(on.pilot.of("COMMAND_INT")) == count
        flying.how = {}
        while (resumed := await next_of(on.stream, "alarm"))["code"] != "position_aiding_resumed":
            pass
        await on.pilot.hears("COMMAND_INT", count + 1)

    assert "the estimator has lost the place" in paused["text"]
    assert message["on"] is True
    assert message["effect"] == "cannot_tell"
    assert uncertain["sending"] is False
    assert resumed["severity"] == "info"


async def test_an_estimator_that_falls_silent_pauses_it(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on:
        async with Flying(on):
            await ask(on, "external_position")
            await told(on, "sending", True)
        message = await told(on, "sending", False)

    assert message["reason"] == "the estimator gives no state"


async def test_it_ends_with_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "GONE_US", 0)
    async with scene(tmp_path, kind=Aided, pad=False) as on, Flying(on), on.running.stream() as other:
        await ask(on, "external_position")
        await on.stream.close()
        while (alarm := await next_of(other, "alarm"))["code"] != "position_aiding_ended":
            pass
        now = await on.running.client.get(AIDING)

    assert "the page that began it has gone" in alarm["text"]
    assert now.json()["status"]["on"] is False


async def test_refusals_say_why(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on:
        on.vehicle._setup = setup(pad=False)
        no_state = await ask(on, "odometry")
        on.give(flown())
        cases = [
            (await ask(on, "odometry", page="stranger"), "page"),
            (await ask(on, "global_position_sensor"), "does not take 'global_position_sensor': it takes"),
            (await ask(on, "gps_input"), "GPS must be kept from the estimator"),
        ]
        on.give(flown(mode=Mode.GPS))
        cases.append((await ask(on, "external_position"), "comes from the vehicle's own GPS"))
        on.give(flown())
        on.pilot.send(on.pilot.wire.pack(dialect.MAVLink_gps_raw_int_message(
            1_000_000, 3, round(LAT_DEG * 1e7), round(LON_DEG * 1e7), 500_000, 80, 80, 500, 0, 10
        )))  # fmt: skip
        await next_of(on.stream, "gps")
        on.give(flown())
        cases.append((await ask(on, "external_position"), "has a fix"))
        nothing = await on.running.client.post(NAVIGATION, json={"page": PAGE})

    assert (no_state.status_code, nothing.status_code) == (409, 422)
    for answer, words in cases:
        assert answer.status_code == 409
        assert words in answer.json()["detail"]


async def test_an_autopilot_that_nobody_knows_is_told_nothing(tmp_path: Path) -> None:
    async with scene(tmp_path, 0, kind=Aided, pad=False) as on:
        answer = await on.running.client.get(AIDING)
    assert answer.status_code == 409
    assert "nobody knows what the autopilot" in answer.json()["detail"]


async def test_odometry_is_about_the_origin_that_the_autopilot_says(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on, Flying(on):
        on.pilot.origin = dialect.MAVLink_gps_global_origin_message(  # type: ignore[attr-defined]
            round(LAT_DEG * 1e7) - 1000, round(LON_DEG * 1e7), round((GROUND_M + 10.0) * 1000), 0
        )
        await ask(on, "odometry")
        heard = await on.pilot.hears("ODOMETRY", 20)

    assert (heard[0].frame_id, heard[0].child_frame_id) == (20, 12)
    # A thousand units of 1e-7 degrees are 11.1 m; the state is 100 m above the ground.
    assert (heard[0].x, heard[0].y, heard[0].z) == pytest.approx((11.1, 0.0, -90.0), abs=0.1)


async def test_gps_input_keeps_gps_away_until_its_echo_has_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on, Flying(on):
        client = on.running.client
        begun = await ask(on, "gps_input", gps_denied=True)
        (first, *_) = await on.pilot.hears("GPS_INPUT", 3)
        on.pilot.send(on.pilot.wire.pack(dialect.MAVLink_gps_raw_int_message(
            1_000_000, 3, first.lat, first.lon, 500_000, 80, 80, 500, 0, 10
        )))  # fmt: skip
        echo = await next_of(on.stream, "gps")
        back = await client.post(NAVIGATION, json={"gps_denied": False})
        monkeypatch.setattr(service, "ECHO_US", 0)
        await ask(on, "off")
        async with asyncio.timeout(PATIENCE_S):
            while on.vehicle.gps_is_echo:
                await asyncio.sleep(0.02)
        given = await client.post(NAVIGATION, json={"gps_denied": False})

    assert begun.json() == {"gps_denied": True, "aiding": "gps_input"}
    assert (echo["used"], echo["lat_deg"]) == (False, None)
    assert (back.status_code, given.status_code) == (409, 200)
    assert "what the station sends it" in back.json()["detail"]


async def test_a_px4_hears_a_global_position_sensor(tmp_path: Path) -> None:
    async with scene(tmp_path, PX4, kind=Aided, pad=False) as on, Flying(on):
        await ask(on, "global_position_sensor")
        (first, *_) = await on.pilot.hears("GLOBAL_POSITION_SENSOR", 3)
    assert (first.source, first.lat) == (2, round(LAT_DEG * 1e7))


async def test_the_check_names_each_parameter(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Aided, pad=False) as on, Flying(on):
        await asyncio.sleep(0.1)
        right = (await on.running.client.get(AIDING)).json()
        wrong = (await on.running.client.get(AIDING, params={"form": "gps_input"})).json()

    assert right["form"] == "external_position"
    assert right["forms"] == ["external_position", "odometry", "gps_input"]
    assert (right["parameters_ok"], right["objection"]) == (True, "")
    assert {row["name"]: row["ok"] for row in wrong["parameters"]} == {
        "AHRS_EKF_TYPE": True, "GPS1_TYPE": False, "EK3_SRC1_POSXY": True, "EK3_SRC1_VELXY": None,
    }  # fmt: skip
    assert (wrong["parameters_ok"], wrong["last_resort"]) == (False, True)


async def test_parameters_are_read_and_written_by_name(tmp_path: Path) -> None:
    async with scene(tmp_path, ARDUPILOT, kind=Aided, pad=False) as on:
        client, pilot = on.running.client, on.pilot
        assert isinstance(pilot, Aided)
        read = (await client.get(PARAMETERS, params={"name": ["GPS1_TYPE", "AHRS_EKF_TYPE"]})).json()
        armed = await client.put(f"{PARAMETERS}/GPS1_TYPE", json={"value": 14})
        meant = await client.put(f"{PARAMETERS}/GPS1_TYPE", json={"value": 14, "armed": True})
        pilot.armed = False
        async with asyncio.timeout(PATIENCE_S):
            while on.vehicle.telemetry.armed:
                await asyncio.sleep(0.02)
        standing = await client.put(f"{PARAMETERS}/AHRS_EKF_TYPE", json={"value": 2})
        unknown = await client.put(f"{PARAMETERS}/NO_SUCH", json={"value": 2})
        broken = await client.put(f"{PARAMETERS}/AHRS_EKF_TYPE", json={"value": 2.5})
        no_name = await client.get(PARAMETERS)

    assert [(one["asked"], one["name"], one["value"]) for one in read] == [
        ("GPS1_TYPE", "GPS_TYPE", 1.0), ("AHRS_EKF_TYPE", "AHRS_EKF_TYPE", 3.0),
    ]  # fmt: skip
    assert armed.status_code == 409
    assert "armed" in armed.json()["detail"]
    assert (meant.json()["status"], pilot.parameters["GPS_TYPE"][0]) == ("written", 14.0)
    assert (standing.status_code, pilot.parameters["AHRS_EKF_TYPE"][0]) == (200, 2.0)
    assert (unknown.status_code, broken.status_code, no_name.status_code) == (409, 409, 422)
    assert "whole number" in broken.json()["detail"]
