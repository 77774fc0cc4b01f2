"""Clicks on a flight that is played into a station: the picture is registered, and the coordinate becomes better."""

from __future__ import annotations

import asyncio
import json
import math
import sys
from pathlib import Path
from typing import Any

from backend.demo import free_udp_ports
from backend.evidence.bundle import pack, unpack
from backend.evidence.schema import HASH_FIELD, content_sha256
from estimator.geometry.local import LocalFrame
from geodata.flight import FlightFolder
from geodata.flight_tables import TargetTruth
from tests.backend.aircraft import frame_header
from tests.backend.evidence.test_service import run_verify
from tests.backend.station_runner import PATIENCE_S, RunningStation, next_of, running_station
from tests.shared_data import shared_data

CLICKED = 3


def miss_m(truth: TargetTruth, properties: dict[str, Any]) -> float:
    local = LocalFrame(truth.lat_rad, truth.lon_rad, 0.0)
    ne = local.ne_from_geodetic(math.radians(properties["lat_deg"]), math.radians(properties["lon_deg"]))
    return float(math.hypot(*ne))


async def became(stream: Any, target_id: str) -> dict[str, Any]:
    """The target as the stream tells it once its picture was tried."""
    while True:
        told = await asyncio.wait_for(next_of(stream, "target"), PATIENCE_S)
        if told["action"] == "updated" and told["target"]["id"] == target_id:
            properties: dict[str, Any] = told["target"]["properties"]
            if properties["registration"] != "waiting":
                return properties


async def click_along(running: RunningStation, folder: FlightFolder) -> list[tuple[str, dict[str, Any]]]:
    """Click the first recorded clicks on their pictures, a while after those were shown."""
    wanted = folder.clicks()[:CLICKED]
    made: list[tuple[str, dict[str, Any]]] = []
    frames: dict[int, int] = {}
    async with running.video("cam-1") as pictures:
        first_id: int | None = None
        while len(frames) < CLICKED:
            header = await frame_header(pictures)
            first_id = header["frame_id"] if first_id is None else first_id
            at_us = folder.frame_time_us(header["frame_id"] - first_id) or 0
            frames |= {n: header["frame_id"] for n, c in enumerate(wanted) if abs(c.t_video_us - at_us) < 30_000}
        for _ in range(15):  # the estimator runs behind the pictures
            await frame_header(pictures)
    for n, click in enumerate(wanted):
        body = {"vehicle_id": "1", "frame_id": frames[n], "u_px": click.u_px, "v_px": click.v_px}
        answer = await running.client.post("/api/v1/targets", json=body)
        assert answer.status_code == 201, answer.text
        made.append((click.target, answer.json()))
    return made


async def test_live_clicks_are_fused_with_their_registration_and_proven(tmp_path: Path) -> None:
    """
    Expected: clicks are answered by the ray; then the stream tells a fused coordinate with a smaller circle, near the
    truth, whose evidence is computed again from the placement in it. The first answer's evidence stays. A target that
    the operator has moved stays where it was put.
    """
    flight = shared_data("flights/copter_120m")
    folder = FlightFolder.open(flight)
    mavlink_port, video_port = free_udp_ports(2)
    command = [
        sys.executable, "-m", "backend.cli", "replay", str(flight), "--live", "--station", "none",
        "--mavlink", f"udpout:127.0.0.1:{mavlink_port}", "--video", f"udp://127.0.0.1:{video_port}",
    ]  # fmt: skip
    async with running_station(
        tmp_path / "data", mavlink=(f"udpin:127.0.0.1:{mavlink_port}",), video=f"udp://127.0.0.1:{video_port}",
        camera=flight / "flight.json", map=str(flight / "reference.tif"),
    ) as running, running.stream() as stream:  # fmt: skip
        await next_of(stream, "hello")
        player = await asyncio.create_subprocess_exec(*command, stdout=-1, stderr=-1)
        try:
            made = await click_along(running, folder)
            moved_id = made[-1][1]["id"]
            put = await running.client.patch(f"/api/v1/targets/{moved_id}", json={"lat_deg": 32.0, "lon_deg": 35.0})
            first = made[0][1]
            better = await became(stream, first["id"])
            address = f"/api/v1/targets/{first['id']}/evidence"
            now, before = await running.client.get(address), await running.client.get(f"{address}?version=1")
            listed = (await running.client.get("/api/v1/targets")).json()["features"]
            for _ in range(100):  # until nothing waits any more
                if all(feature["properties"]["registration"] != "waiting" for feature in listed):
                    break
                await asyncio.sleep(0.1)
                listed = (await running.client.get("/api/v1/targets")).json()["features"]
        finally:
            player.terminate()
            await player.wait()

    truth = folder.targets_truth()
    asked = first["properties"]
    assert (asked["method"], asked["registration"], asked["refined"]) == ("ray_terrain", "waiting", 0)
    assert better["method"] == "fused"
    assert better["registration"].startswith("matched by")
    assert (better["version"], better["refined"]) == (2, 1)
    assert better["ce90_m"] < asked["ce90_m"]
    assert miss_m(truth[made[0][0]], better) < 2.0 * better["ce90_m"]
    stayed = next(feature for feature in listed if feature["id"] == moved_id)["properties"]
    assert put.status_code in (200, 409)
    assert (stayed["lat_deg"], stayed["lon_deg"], stayed["method"]) == (32.0, 35.0, "manual")

    for name, answer in (("now", now), ("before", before)):
        (tmp_path / f"{name}.zip").write_bytes(answer.content)
        verified = run_verify(tmp_path / f"{name}.zip", "--map", flight / "reference.tif")
        assert verified.exit_code == 0, verified.output
        given = f"'{flight / 'reference.tif'}'"
        assert (f"registration repeated on {given}: agrees" in verified.output) == (name == "now"), verified.output
    without_map = run_verify(tmp_path / "now.zip").output
    assert "registration repeated on the piece of it in the bundle: agrees" in without_map
    assert without_map.endswith("  agrees\n")
    assert before.headers["pilotage-evidence"] == "superseded"
    assert "located better since version 1" in run_verify(tmp_path / "before.zip").output
    evidence = unpack(now.content, "now").evidence
    assert evidence.placement is not None
    assert (evidence.target.version, evidence.result.method) == (2, "fused")
    assert evidence.result.lat_deg == better["lat_deg"]
    (reference,) = evidence.files
    assert reference.sha256 is not None
    assert unpack(before.content, "before").evidence.placement is None

    for change in (
        lambda c: c["placement"]["correction"].__setitem__(0, c["placement"]["correction"][0] + 0.5),
        lambda c: c["placement"].update(cross=0.1),
        lambda c: c.update(placement=None, registration=None),
    ):
        read = unpack(now.content, "now")
        content = json.loads(read.document)
        change(content)
        content[HASH_FIELD] = content_sha256(content)
        pieces = read.pieces if content["registration"] else {}
        (tmp_path / "altered.zip").write_bytes(pack(json.dumps(content).encode(), read.picture, None, pieces))
        refused = run_verify(tmp_path / "altered.zip")
        assert refused.exit_code == 1
        assert "does not agree" in refused.output
