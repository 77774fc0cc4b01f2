"""A car followed in a flight that is replayed: as far as the flight is shown, at any speed, until it is moved."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from backend.recorder.folder import FlightWriter
from backend.video.frames import EncodedFrame
from backend.video.jpeg import encode_jpeg
from tests.backend.flight_maker import SIZE, T0_US, plan, state, telemetry
from tests.backend.following.scene import SPEED_M_S, CircuitScene
from tests.backend.following.test_following import seen, until
from tests.backend.station_runner import RunningStation, next_of, running_station

SECONDS, FPS = 12.0, 25
COUNT = round(SECONDS * FPS)
VEHICLE = "replay-circuit"
CLICKED = 30


def write_circuit(folder: Path, scene: CircuitScene) -> None:
    """Hover above the scene; the pictures are files, so that no coder blurs the car."""
    folder.mkdir(parents=True)
    writer = FlightWriter(folder, plan(), folder.name)
    for t_us, data in telemetry(SECONDS):
        writer.packet(t_us, data)
    for n in range(COUNT):
        t_us = T0_US + n * 1_000_000 // FPS
        payload = encode_jpeg(scene.picture(t_us))
        writer.frame(EncodedFrame(n, 1, t_us, t_us + 5_000, "jpeg", "jpeg", True, *SIZE, payload))
    for n in range(round(SECONDS * 10)):
        pose = np.diag([0.01, 0.01, 0.01, 1e-6, 1e-6, 1e-6])
        writer.state(replace(state(T0_US + n * 100_000), cov_camera_pose=pose))
    writer.close()


async def replay(running: RunningStation, **changes: object) -> None:
    started = await running.client.post("/api/v1/flights/circuit/replay", json={"speed": 1.0})
    assert started.status_code == 201, started.text
    await change(running, **changes)
    for _ in range(300):
        (body,) = (await running.client.get("/api/v1/replays")).json()
        if body["progress"] is None:
            return
        await asyncio.sleep(0.1)
    raise AssertionError("the estimate was not read")


async def change(running: RunningStation, **changes: object) -> None:
    answer = await running.client.patch(f"/api/v1/replays/{VEHICLE}", json=changes)
    assert answer.status_code == 200, answer.text


async def follow(running: RunningStation, scene: CircuitScene, index: int = CLICKED) -> dict[str, Any]:
    u, v = scene.pixel(T0_US + index * 1_000_000 // FPS)
    body = {"vehicle_id": VEHICLE, "frame_id": COUNT + index, "u_px": u, "v_px": v, "track": True}
    answer = await running.client.post("/api/v1/targets", json=body)
    assert answer.status_code == 201, answer.text
    return dict(answer.json())


async def test_a_car_is_followed_through_a_replay_to_its_end(tmp_path: Path) -> None:
    """Expected: nothing while it is paused; then all pictures that were shown, none left out at sixteen times the
    speed; the coordinate is where the car was last, and following ends with the flight."""
    scene = CircuitScene()
    write_circuit(tmp_path / "flights" / "circuit", scene)
    async with running_station(tmp_path) as running, running.stream() as stream:
        await next_of(stream, "hello")
        await running.client.post("/api/v1/recording", json={"active": True, "name": "meanwhile"})
        await replay(running, paused=True)
        made = await follow(running, scene)
        await asyncio.sleep(1.0)
        waiting = (await running.client.get(f"/api/v1/targets/{made['id']}")).json()
        await change(running, paused=False, speed=16.0)
        sightings = []
        while not sightings or sightings[-1]["frame_id"] < 2 * COUNT - 6:
            sightings.append(await until(stream, "sighting", seen))
        ended = await until(stream, "target", lambda m: m["target"]["properties"]["track"]["status"] == "stopped")
        track = (await running.client.get(f"/api/v1/targets/{made['id']}/track")).json()
        left = list(running.station.following._workers)
        await running.client.post("/api/v1/recording", json={"active": False})
        recorded = list((tmp_path / "flights").glob("meanwhile*/followed.csv"))

    off = [np.hypot(m["u_px"] - u, m["v_px"] - v) for m in sightings for u, v in [scene.pixel(m["t_frame_unix_us"])]]
    steps = np.diff([m["t_frame_unix_us"] for m in sightings])
    properties = ended["target"]["properties"]
    assert waiting["properties"]["track"]["status"] == "seen"
    assert waiting["properties"]["version"] == 1
    assert len(sightings) > 40
    assert max(off) < 5.0
    assert steps.max() < 450_000  # the tracker may miss one picture; the thread leaves none out
    assert properties["track"]["reason"] == "the video of the flight ends"
    assert properties["method"] == "followed"
    assert abs(properties["track"]["speed_m_s"] - SPEED_M_S) < 2.5
    assert sum(len(f["geometry"]["coordinates"]) for f in track["features"]) > 40
    assert left == []
    assert recorded == []  # it is not of the flight that is recorded


async def test_a_replay_that_is_moved_or_ended_is_followed_no_longer(tmp_path: Path) -> None:
    scene = CircuitScene()
    write_circuit(tmp_path / "flights" / "circuit", scene)
    async with running_station(tmp_path) as running, running.stream() as stream:
        await next_of(stream, "hello")
        await replay(running)
        first = await follow(running, scene)
        await until(stream, "sighting", seen)
        await change(running, seek_unix_us=T0_US)
        moved = await until(stream, "target", lambda m: m["target"]["properties"]["track"]["status"] == "stopped")
        again = await running.client.patch(f"/api/v1/targets/{first['id']}", json={"track": True})
        await until(stream, "sighting", seen)
        await running.client.delete(f"/api/v1/replays/{VEHICLE}")
        ended = await until(stream, "target", lambda m: m["target"]["properties"]["track"]["status"] == "stopped")
        gone = await running.client.patch(f"/api/v1/targets/{first['id']}", json={"track": True})
        left = list(running.station.following._workers)

    assert moved["target"]["properties"]["track"]["reason"] == "the replay was moved to another time"
    assert again.status_code == 200, again.text
    assert ended["target"]["properties"]["track"]["reason"] == "the replay was ended"
    assert gone.status_code == 404
    assert left == []
