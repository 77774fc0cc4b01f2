"""Aiding over real sockets: who may begin it, what the autopilot hears, and when it ends."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.clock import unix_us
from backend.guided import pages
from estimator.types import PadMode
from geodata.pad_file import as_description, pad_from
from guidance.pan_tilt import GimbalAngles, line_of_sight
from tests.backend.guided.scene import PAGE, SET_POINT, Obedient, Pilot, Scene, becomes, scene
from tests.backend.landing.relative import PAD, over_pad
from tests.backend.landing.test_messages import setup
from tests.backend.link.wire import PX4, dialect
from tests.backend.station_runner import PATIENCE_S, next_of

SENT = "LANDING_TARGET"


async def test_nothing_is_sent_until_the_operator_asks(tmp_path: Path) -> None:
    async with scene(tmp_path) as flown:
        flown.give(over_pad(unix_us()))
        await flown.pilot.hears("HEARTBEAT", 1)
        answer = await flown.running.client.get("/api/v1/vehicles/1/landing")
        assert answer.json()["aiding"] == {"on": False, "form": None, "sending": False, "sent": 0, "reason": ""}
        assert (answer.json()["mode"], answer.json()["height_m"]) == (None, None)  # its estimator has no pad
        assert (await flown.ask(page=PAGE, aiding=True)).status_code == 200
        flown.give(over_pad(unix_us()))
        await flown.pilot.hears(SENT)

    assert len(flown.pilot.of(SENT)) == 1


async def test_an_ardupilot_hears_where_the_pad_is_from_its_body(tmp_path: Path) -> None:
    """Heading east, 8 m up, 0.6 m north and 0.4 m west of the pad: 0.4 m ahead, 0.6 m to the right, 8 m below."""
    async with scene(tmp_path) as flown:
        await flown.ask(page=PAGE, aiding=True)
        times = []
        for _ in range(5):
            times.append(unix_us())
            flown.give(over_pad(times[-1], heading_deg=90.0))
        heard = await flown.pilot.hears(SENT, 5)
        told = (await flown.running.client.get("/api/v1/vehicles/1/landing")).json()["aiding"]

    assert [message.time_usec for message in heard] == times
    assert all((m.frame, m.position_valid, m.type) == (12, 1, 2) for m in heard)
    assert (heard[0].x, heard[0].y, heard[0].z) == pytest.approx((0.4, 0.6, 8.0), abs=1e-6)
    assert told == {"on": True, "form": "body", "sending": True, "sent": 5, "reason": ""}


async def test_a_pad_that_is_lost_is_not_told_of_and_a_found_one_again(tmp_path: Path) -> None:
    async with scene(tmp_path) as flown:
        await flown.ask(page=PAGE, aiding=True)
        modes = [PadMode.SEARCHING, PadMode.TRACKING, PadMode.DEAD_RECKONING, PadMode.LOST, PadMode.TRACKING]
        reasons = []
        t0_us = unix_us()
        for number, mode in enumerate(modes):
            flown.give(over_pad(t0_us + number, mode=mode, reason="" if mode is PadMode.TRACKING else "covered"))
            reasons.append(flown.running.station.landings.message(flown.vehicle)["aiding"]["reason"])
        heard = await flown.pilot.hears(SENT, 3)

    assert [message.time_usec - t0_us for message in heard] == [1, 2, 4]
    assert reasons == ["the pad is not found: covered", "", "", "the pad is lost: covered", ""]


async def test_a_place_too_uncertain_to_land_by_is_not_told(tmp_path: Path) -> None:
    """Dead reckoned by an estimator that is far behind, as on a busy machine."""
    async with scene(tmp_path) as flown:
        await flown.ask(page=PAGE, aiding=True)
        flown.give(over_pad(unix_us(), mode=PadMode.DEAD_RECKONING, std_m=(0.1, 0.1, 1.7)))
        told = flown.running.station.landings.message(flown.vehicle)["aiding"]
        flown.give(over_pad(unix_us()))
        await flown.pilot.hears(SENT)

    assert (told["sending"], told["reason"]) == (False, "the pad's place is known to 1.7 m only")
    assert len(flown.pilot.of(SENT)) == 1


async def test_a_px4_is_asked_for_its_own_place_and_told_the_pad_s_in_it(tmp_path: Path) -> None:
    async with scene(tmp_path, PX4) as flown:
        await flown.ask(page=PAGE, aiding=True)
        flown.give(over_pad(unix_us()))
        first = (await flown.ask()).json()["aiding"]
        await flown.pilot.hears("COMMAND_LONG", 5)
        async with asyncio.timeout(PATIENCE_S):
            while not [m for m in flown.pilot.of("COMMAND_LONG") if (m.command, m.param1) == (511, 32)]:
                await asyncio.sleep(0.01)
        while flown.vehicle.local_position is None:
            flown.pilot.send(
                flown.pilot.wire.pack(dialect.MAVLink_local_position_ned_message(1000, 100.0, 50.0, -20.0, 0, 0, 0))
            )
            await asyncio.sleep(0.01)
        flown.give(over_pad(unix_us()))
        (heard,) = await flown.pilot.hears(SENT)

    assert (first["form"], first["sending"]) == ("local", False)
    assert "LOCAL_POSITION_NED" in first["reason"]
    assert (heard.frame, heard.position_valid) == (1, 1)
    assert (heard.x, heard.y, heard.z) == pytest.approx((99.4, 50.4, -12.0), abs=1e-5)


async def test_it_ends_with_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "GONE_US", 0)
    async with scene(tmp_path) as flown, flown.running.stream() as other:
        await next_of(other, "hello")
        await flown.ask(page=PAGE, aiding=True)
        await flown.stream.close()
        while (alarm := await next_of(other, "alarm"))["code"] != "aiding_ended":
            pass
        flown.give(over_pad(unix_us()))
        told = (await flown.running.client.get("/api/v1/vehicles/1/landing")).json()

    assert "the page that began it has gone" in alarm["text"]
    assert told["aiding"]["on"] is False
    assert flown.pilot.of(SENT) == []


async def test_who_may_not_begin_it_is_told_why(tmp_path: Path) -> None:
    async with scene(tmp_path, 0, pad=False) as flown:
        stranger = await flown.ask(page="stranger", aiding=True)
        nobody = await flown.ask(aiding=True)
        no_pad = await flown.ask(page=PAGE, aiding=True)
        await flown.running.client.put("/api/v1/pad", json=as_description(PAD))
        unknown_kind = await flown.ask(page=PAGE, aiding=True)
        no_vehicle = await flown.running.client.post("/api/v1/vehicles/9/landing", json={"aiding": False})

    assert [a.status_code for a in (stranger, nobody, no_pad, unknown_kind, no_vehicle)] == [409, 409, 404, 409, 404]
    assert "/api/v1/stream?page=NAME" in stranger.json()["detail"]
    assert "no landing pad is described" in no_pad.json()["detail"]
    assert "ArduPilot or PX4" in unknown_kind.json()["detail"]


async def test_another_pad_has_to_wait_while_a_flight_without_gps_hangs_on_the_estimator(tmp_path: Path) -> None:
    async with scene(tmp_path) as flown:
        flown.give(over_pad(unix_us()))  # its mode is vision
        while not flown.vehicle.telemetry.armed:
            await asyncio.sleep(0.01)
        refused = await flown.running.client.delete("/api/v1/pad")
        kept = await flown.running.client.get("/api/v1/pad")

    assert refused.status_code == 409
    assert "without GPS" in refused.json()["detail"]
    assert kept.status_code == 200


async def test_a_recording_says_which_pad_was_looked_for(tmp_path: Path) -> None:
    """So that its replay looks for the same."""
    async with scene(tmp_path) as flown:
        flight_id = await flown.running.station.start_recording(None)
        await flown.running.station.stop_recording()
    flight = json.loads((tmp_path / "flights" / flight_id / "flight.json").read_text())

    assert pad_from(flight["pad"], Path("flight.json")) == PAD


async def test_the_pad_over_rest(tmp_path: Path) -> None:
    async with scene(tmp_path, pad=False) as flown:
        client = flown.running.client
        none = await client.get("/api/v1/pad")
        wrong = await client.put("/api/v1/pad", json={"schema": "pilotage.pad/1", "kind": "circles"})
        given = await client.put("/api/v1/pad", json=as_description(PAD))
        message = await next_of(flown.stream, "pad")
        view = await client.get("/api/v1/vehicles/1/landing/view")
        gone = await client.delete("/api/v1/pad")
        after = await client.get("/api/v1/pad")

    assert (none.status_code, wrong.status_code, given.status_code) == (404, 422, 200)
    assert "circles.name" in wrong.json()["detail"]
    assert given.json()["name"] == message["name"] == "test pad"
    assert view.status_code == 204
    assert (gone.status_code, after.status_code) == (204, 404)


async def landing(flown: Scene, height_m: float = 8.0) -> None:
    """Begin a landing and fly it until velocities are sent that move."""
    flown.give(over_pad(unix_us(), (0.6, -0.4, -height_m)))
    while flown.vehicle.telemetry.flight_mode != "LOITER":
        await asyncio.sleep(0.01)
    answer = await flown.ask(page=PAGE, land=True)
    assert answer.status_code == 200, answer.text
    async with asyncio.timeout(PATIENCE_S):
        while not any(abs(m.vy) > 0.01 for m in flown.pilot.of(SET_POINT)):
            flown.give(over_pad(unix_us(), (0.6, -0.4, -height_m)))
            await asyncio.sleep(0.05)


async def test_a_landing_takes_the_vehicle_over_and_flies_it_to_the_pad(tmp_path: Path) -> None:
    """It is 0.6 m north and 0.4 m west of the pad: south-east is where it is sent, and not up."""
    async with scene(tmp_path, kind=Obedient) as flown:
        await landing(flown)
        told = (await flown.ask()).json()["descent"]
        again = await flown.ask(page=PAGE, land=True)
        last = flown.pilot.of(SET_POINT)[-1]

    assert flown.pilot.of(SET_POINT)[0].vx == 0.0
    assert last.vx < 0.0 < last.vy
    assert last.vz > -0.6
    assert (told["active"], told["phase"]) in ((True, "approach"), (True, "descend"))
    assert again.status_code == 409
    assert "flown already (landing)" in again.json()["detail"]


async def test_one_press_ends_it_and_it_stands_still_and_another_has_the_vehicle_hold(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        await landing(flown)
        answer = await flown.ask(abort=True)
        alarm = await next_of(flown.stream, "alarm")
        count = len(flown.pilot.of(SET_POINT))
        async with asyncio.timeout(PATIENCE_S):
            while len(flown.pilot.of(SET_POINT)) < count + 5:
                flown.give(over_pad(unix_us()))
                await asyncio.sleep(0.02)
        stands = (await flown.ask()).json()["descent"]
        assert flown.pilot.mode == Obedient.MODES["GUIDED"]  # type: ignore[attr-defined]
        ended = await flown.ask(abort=True)
        await becomes(flown, "LOITER")
        count = len(flown.pilot.of(SET_POINT))
        flown.give(over_pad(unix_us()))
        await asyncio.sleep(0)
        last = await next_of(flown.stream, "alarm")

    assert (answer.json()["descent"]["active"], answer.json()["descent"]["phase"]) == (True, "hold")
    assert alarm["code"] == "landing_aborted"
    assert "held by vision: the operator ended it" in alarm["text"]
    assert (stands["active"], stands["phase"]) == (True, "hold")
    assert ended.json()["descent"]["active"] is False
    assert last["code"] == "hold_ended"
    assert "held by vision no more: the operator ended it" in last["text"]
    assert len(flown.pilot.of(SET_POINT)) == count


async def test_a_landing_can_be_begun_again_where_it_stands(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        await landing(flown)
        await flown.ask(abort=True)
        flown.give(over_pad(unix_us()))
        again = await flown.ask(page=PAGE, land=True)

    assert again.status_code == 200, again.text
    assert again.json()["descent"]["phase"] == "approach"


async def test_a_landing_ends_with_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "GONE_US", 0)
    async with scene(tmp_path, kind=Obedient) as flown:
        await landing(flown)
        await flown.stream.close()
        await becomes(flown, "LOITER")


async def test_a_landing_ends_with_the_station(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        await landing(flown)
        await flown.running.station.stop()
        await becomes(flown, "LOITER")


async def test_another_command_ends_a_landing_without_a_word_of_ours(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        await landing(flown)
        await flown.running.client.post("/api/v1/vehicles/1/commands", json={"command": "land"})
        await becomes(flown, "LAND")
        told = (await flown.ask()).json()["descent"]

    assert (told["active"], told["reason"]) == (False, "the operator said 'land'")
    assert [m.param2 for m in flown.pilot.of("COMMAND_LONG") if m.command == 176] == [4]


async def test_what_cannot_be_landed_is_refused_in_words(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        unseen = await flown.ask(page=PAGE, land=True)
        flown.give(over_pad(unix_us(), mode=PadMode.SEARCHING, reason="only part of a triple"))
        part = await flown.ask(page=PAGE, land=True)
        flown.give(over_pad(unix_us()))
        nobody = await flown.ask(land=True)

    assert [answer.status_code for answer in (unseen, part, nobody)] == [409] * 3
    assert "the pad must be followed when a landing begins" in unseen.json()["detail"]
    assert "only part of a triple" in part.json()["detail"]
    assert "ends with the page" in nobody.json()["detail"]


async def test_a_landing_by_dead_reckoning_may_begin_and_takes_the_camera_with_it(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Obedient) as flown:
        flown.vehicle._setup = replace(setup(), gimbal="pan_tilt")
        flown.give(over_pad(unix_us(), mode=PadMode.DEAD_RECKONING))
        answer = (await flown.ask(page=PAGE, land=True)).json()

    assert answer["descent"]["active"] is True
    assert answer["gaze"]["on"] is True


class Gimballed(Pilot):
    """An autopilot whose gimbal obeys who has configured himself into control."""

    def step(self) -> None:
        heard = len(self.heard)
        super().step()
        for message in self.heard[heard:]:
            if message.get_type() == "COMMAND_LONG" and message.command == 1001:
                system, component = (0, 0) if message.param1 == -3 else (int(message.param1), int(message.param2))
                status = dialect.MAVLink_gimbal_manager_status_message(1, 0, 1, system, component, 0, 0)
                self.send(self.wire.pack(status))


async def test_a_pan_tilt_camera_is_kept_on_the_pad_and_handed_back(tmp_path: Path) -> None:
    async with scene(tmp_path, kind=Gimballed) as flown:
        fixed = await flown.ask(page=PAGE, gaze=True)
        flown.vehicle._setup = replace(setup(), gimbal="pan_tilt")
        answer = await flown.ask(page=PAGE, gaze=True)
        t_us = unix_us()
        async with asyncio.timeout(PATIENCE_S):
            while len(flown.pilot.of("GIMBAL_MANAGER_SET_PITCHYAW")) < 12:
                t_us += 100_000
                flown.give(over_pad(t_us, (4.0, -3.0, -8.0), heading_deg=30.0))
                await asyncio.sleep(0.02)
        last = flown.pilot.of("GIMBAL_MANAGER_SET_PITCHYAW")[-1]
        told = (await flown.ask(gaze=False)).json()["gaze"]
        async with asyncio.timeout(PATIENCE_S):
            while [m.param1 for m in flown.pilot.of("COMMAND_LONG") if m.command == 1001] != [255, -3]:
                await asyncio.sleep(0.01)

    assert fixed.status_code == 409
    assert "cannot be turned" in fixed.json()["detail"]
    assert answer.json()["gaze"]["on"] is True
    assert told == {"on": False, "reason": ""}
    axis = line_of_sight(GimbalAngles(last.pitch, last.yaw), np.radians(30.0))
    to_pad = np.array((-4.0, 3.0, 8.0))
    off_deg = np.degrees(np.arccos(axis @ to_pad / np.linalg.norm(to_pad)))
    # Within four degrees the yaw need not turn.
    assert off_deg < 4.1
