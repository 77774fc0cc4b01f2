"""A car followed by a real station from a real aircraft's video: what is told, kept, refused and ended."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.backend.aircraft import flying, frame_header
from tests.backend.following.scene import SPEED_M_S, CircuitScene, click, show
from tests.backend.station_runner import next_of, running_station

MOST_MESSAGES = 2000


async def until(stream: Any, kind: str, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    last: dict[str, Any] = {}
    for _ in range(MOST_MESSAGES):
        last = await next_of(stream, kind)
        if wanted(last):
            return last
    raise AssertionError(f"never so: {last}")


def seen(message: dict[str, Any]) -> bool:
    return message["track"]["status"] == "seen"


async def test_a_driving_car_is_followed_and_everybody_is_told(tmp_path: Path) -> None:
    scene = CircuitScene()
    async with flying(tmp_path) as (running, aircraft, stream):
        show(aircraft, scene)
        await running.client.post("/api/v1/recording", json={"active": True})
        made = await click(running, stream, scene)
        sightings = [await until(stream, "sighting", seen) for _ in range(30)]
        moving = await until(stream, "sighting", lambda m: m["track"]["moving"] is True)
        kept = await until(stream, "target", lambda m: m["target"]["properties"]["track"]["moving"] is True)
        version = kept["target"]["properties"]["version"]
        old = await running.client.get(f"/api/v1/targets/{made['id']}/evidence?version=1")
        gone = await running.client.get(f"/api/v1/targets/{made['id']}/evidence")
        picture = await running.client.get(f"/api/v1/targets/{made['id']}/picture")
        track = (await running.client.get(f"/api/v1/targets/{made['id']}/track")).json()
        cot = (await running.client.get("/api/v1/targets?format=cot")).text
        stopped = await running.client.patch(f"/api/v1/targets/{made['id']}", json={"track": False})
        again = await running.client.patch(f"/api/v1/targets/{made['id']}", json={"track": True})
        resumed = await until(stream, "sighting", seen)
        await running.client.post("/api/v1/recording", json={"active": False})
        flight = running.station.settings.data_dir / "flights"
        (table,) = flight.glob("*/followed.csv")
        rows = list(csv.DictReader(table.open()))

    off = [np.hypot(m["u_px"] - u, m["v_px"] - v) for m in sightings for u, v in [scene.pixel(m["t_frame_unix_us"])]]
    assert made["properties"]["track"]["status"] == "seen"
    assert made["properties"]["registration"] is None  # where it goes, its tracker says
    assert max(off) < 5.0  # a car's length is 15 pixels
    assert abs(moving["track"]["speed_m_s"] - SPEED_M_S) < 2.5
    assert kept["target"]["properties"]["method"] == "followed"
    assert version > made["properties"]["version"]
    assert (old.status_code, old.headers["pilotage-evidence"]) == (200, "superseded")
    assert gone.status_code == 404
    assert "followed" in gone.json()["detail"]
    assert picture.content.startswith(b"\xff\xd8")
    assert len(track["features"][0]["geometry"]["coordinates"]) > 5
    assert "<track course=" in cot
    assert stopped.json()["properties"]["track"]["status"] == "stopped"
    assert again.status_code == 200, again.text
    assert resumed["target_id"] == made["id"]
    assert {row["status"] for row in rows} >= {"seen"}
    assert all(math.isfinite(float(row["lat_deg"])) for row in rows)


async def test_a_car_that_vanishes_is_lost_and_says_why(tmp_path: Path) -> None:
    scene = CircuitScene()
    async with flying(tmp_path) as (running, aircraft, stream):
        show(aircraft, scene)
        made = await click(running, stream, scene)
        for _ in range(5):
            await until(stream, "sighting", seen)
        scene.hidden = True
        lost = await until(stream, "target", lambda m: m["target"]["properties"]["track"]["status"] == "lost")
        version = lost["target"]["properties"]["version"]
        for _ in range(25):  # five seconds in which nothing new is known
            await until(stream, "sighting", lambda m: m["track"]["status"] == "lost")
        later = (await running.client.get(f"/api/v1/targets/{made['id']}")).json()["properties"]["version"]
        aircraft.close()  # link and video end
        ended = await until(stream, "target", lambda m: m["target"]["properties"]["track"]["status"] == "stopped")

    assert lost["target"]["id"] == made["id"]
    assert lost["target"]["properties"]["track"]["reason"]
    assert later - version <= 2  # another reason at most
    assert "link" in ended["target"]["properties"]["track"]["reason"]


async def test_what_cannot_be_followed_is_refused_whole(tmp_path: Path) -> None:
    scene = CircuitScene()
    async with flying(tmp_path) as (running, aircraft, stream):
        show(aircraft, scene)
        first = await click(running, stream, scene)
        about = first["properties"]
        body = {"vehicle_id": "1", "frame_id": about["frame_id"], "track": True}
        edge = await running.client.post("/api/v1/targets", json={**body, "u_px": 1.0, "v_px": 120.0})
        expired = await running.client.post(
            "/api/v1/targets", json={**body, "frame_id": 10**7, "u_px": 9.0, "v_px": 9.0}
        )
        typed = await running.client.post("/api/v1/targets", json={"lat_deg": 47.0, "lon_deg": 8.0, "track": True})
        whole = [about["u_px"], about["v_px"]]
        for _ in range(2):
            more = await running.client.post("/api/v1/targets", json={**body, "u_px": whole[0], "v_px": whole[1]})
            assert more.status_code == 201, more.text
        fourth = await running.client.post("/api/v1/targets", json={**body, "u_px": whole[0], "v_px": whole[1]})
        kept = (await running.client.get("/api/v1/targets")).json()["features"]
        moved = await running.client.patch(f"/api/v1/targets/{first['id']}", json={"lat_deg": 47.0, "lon_deg": 8.0})
        refollowed = await running.client.patch(f"/api/v1/targets/{first['id']}", json={"track": True})
        deleted = await running.client.delete(f"/api/v1/targets/{kept[1]['id']}")

    assert (edge.status_code, edge.headers["content-type"]) == (422, "application/problem+json")
    assert "border" in edge.json()["detail"]
    assert expired.status_code == 404
    assert typed.status_code == 422
    assert fourth.status_code == 409
    assert "followed already" in fourth.json()["detail"]
    assert len(kept) == 3
    assert (moved.json()["properties"]["track"]["status"], moved.json()["properties"]["method"]) == (
        "stopped",
        "manual",
    )
    assert refollowed.status_code == 422
    assert deleted.status_code == 204


async def test_a_station_that_ends_follows_nothing_when_it_starts_again(tmp_path: Path) -> None:
    scene = CircuitScene()
    async with flying(tmp_path) as (running, aircraft, stream):
        show(aircraft, scene)
        made = await click(running, stream, scene)
        await until(stream, "sighting", seen)
        first_us = made["properties"]["t_unix_us"]
    # Frames are numbered anew: the one of the same number is another picture.
    async with flying(tmp_path) as (running, aircraft, stream):
        show(aircraft, scene)
        frame = {"frame_id": -1}
        for _ in range(MOST_MESSAGES):
            if frame["frame_id"] >= made["properties"]["frame_id"]:
                break
            async with running.video("cam-1") as pictures:
                frame = await frame_header(pictures)
        url = f"/api/v1/targets/{made['id']}"
        other = await running.client.patch(url, json={"track": True})
        held = running.station.feed("cam-1").identify(made["properties"]["frame_id"])
    async with running_station(tmp_path / "data") as running:
        (left,) = (await running.client.get("/api/v1/targets")).json()["features"]
        again = await running.client.patch(f"/api/v1/targets/{made['id']}", json={"track": True})

    assert left["properties"]["track"]["status"] == "stopped"
    assert left["properties"]["track"]["reason"] == "the station ended"
    assert held.t_us - first_us > 1_000_000
    assert other.status_code == 404
    assert "is not held" in other.json()["detail"]
    assert again.status_code == 404  # nobody has heard of that vehicle
