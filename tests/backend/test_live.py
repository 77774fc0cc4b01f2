"""A live vehicle over real sockets: what the station makes of it, and of garbage beside it."""

import random
import socket
from pathlib import Path

from backend.demo import free_udp_ports
from tests.backend.aircraft import flying, frame_header
from tests.backend.flight_maker import LAT_DEG
from tests.backend.station_runner import next_of, running_station


async def test_vehicle_video_and_gps_reach_a_browser(tmp_path: Path) -> None:
    async with flying(tmp_path) as (running, aircraft, stream):
        vehicle = await next_of(stream, "vehicle")
        gps = await next_of(stream, "gps")
        telemetry = await next_of(stream, "telemetry")
        link = await next_of(stream, "link")
        video = await next_of(stream, "video")
        async with running.video("cam-1") as pictures:
            first = await frame_header(pictures)
            second = await frame_header(pictures)
        jpeg = await running.client.get(f"/api/v1/video/cam-1/frames/{first['frame_id']}.jpg")
        gone = await running.client.get("/api/v1/video/cam-1/frames/123456.jpg")
        metrics = (await running.client.get("/metrics")).text

    assert (vehicle["action"], vehicle["vehicle"]["id"]) == ("created", "1")
    assert abs(gps["lat_deg"] - LAT_DEG) < 1e-6
    assert (telemetry["vehicle_type"], telemetry["simulated"]) == ("helicopter", True)
    assert link["connected"]
    assert video["source"] == "cam-1"
    assert first["key"]
    assert second["frame_id"] == first["frame_id"] + 1
    assert second["t_unix_us"] > first["t_unix_us"]
    assert jpeg.content.startswith(b"\xff\xd8")
    assert gone.status_code == 404
    assert 'pilotage_video_frames_total{source="camera"}' in metrics
    assert any(message.get_type() == "HEARTBEAT" for message in aircraft.received)


async def test_a_station_says_what_it_waits_for(tmp_path: Path) -> None:
    mavlink_port, video_port = free_udp_ports(2)
    options = {"mavlink": (f"udpin:127.0.0.1:{mavlink_port}",), "video": f"udp://127.0.0.1:{video_port}"}
    async with running_station(tmp_path, **options) as running, running.stream() as stream:
        hello = await next_of(stream, "hello")

    waits = "\n".join(hello["waiting_for"])
    assert f"MAVLink: UDP port {mavlink_port}" in waits
    assert f"UDP port {video_port}" in waits
    assert "--camera" in waits


async def test_garbage_on_every_link_stops_nothing(tmp_path: Path) -> None:
    """
    Fault: random bytes and cut packets on the MAVLink and the video port, between the real ones.
    Expected: telemetry and video go on, the noise is counted.
    """
    garbage = random.Random(3)
    async with flying(tmp_path) as (running, aircraft, stream):
        await next_of(stream, "vehicle")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noise:
            ports = [int(running.station.settings.mavlink[0].rsplit(":", 1)[1])]
            ports.append(int((running.station.settings.video or "").rsplit(":", 1)[1]))
            for _ in range(200):
                data = garbage.randbytes(garbage.randrange(1, 1400))
                whole = aircraft.wire.heartbeat()
                for port in ports:
                    noise.sendto(data, ("127.0.0.1", port))
                    noise.sendto(whole[: garbage.randrange(1, len(whole))], ("127.0.0.1", port))
        noisy = await next_of(stream, "link")
        while not noisy["noise_bytes"]:
            noisy = await next_of(stream, "link")
        gps = await next_of(stream, "gps")
        async with running.video("cam-1") as pictures:
            seen = [await frame_header(pictures) for _ in range(10)]
        health = await running.client.get("/healthz")

    assert gps["fix_type"] == 3
    assert len(seen) == 10
    assert health.status_code == 200


async def test_a_command_is_sent_and_its_answer_told(tmp_path: Path) -> None:
    async with flying(tmp_path) as (running, aircraft, stream):
        await next_of(stream, "gps")
        sent = await running.client.post(
            "/api/v1/vehicles/1/commands", json={"command": "inject_failure", "unit": "gps", "failure": "off"}
        )
        ack = await next_of(stream, "ack")
        incomplete = await running.client.post("/api/v1/vehicles/1/commands", json={"command": "goto"})
        nobody = await running.client.post("/api/v1/vehicles/7/commands", json={"command": "arm"})

    assert sent.status_code == 202
    assert (ack["command_id"], ack["command"], ack["status"]) == (
        sent.json()["command_id"], "inject_failure", "accepted",
    )  # fmt: skip
    failure = next(m for m in aircraft.received if m.get_type() == "COMMAND_LONG" and m.command == 420)
    assert (failure.param1, failure.param2) == (4.0, 1.0)
    assert (incomplete.status_code, nobody.status_code) == (400, 404)


async def test_a_recording_of_live_data_is_a_flight(tmp_path: Path) -> None:
    async with flying(tmp_path) as (running, _, stream):
        await next_of(stream, "gps")
        started = await running.client.post("/api/v1/recording", json={"active": True, "name": "live"})
        while (await next_of(stream, "recording")).get("bytes", 0) < 20_000:
            pass
        twice = await running.client.post("/api/v1/recording", json={"active": True})
        while_active = await running.client.delete(f"/api/v1/flights/{started.json()['flight_id']}")
        await running.client.post("/api/v1/vehicles/1/navigation", json={"gps_denied": True})
        await next_of(stream, "telemetry")
        stopped = await running.client.post("/api/v1/recording", json={"active": False})
        (flight,) = (await running.client.get("/api/v1/flights")).json()

    assert (twice.status_code, while_active.status_code) == (409, 409)
    assert not stopped.json()["active"]
    assert (flight["problem"], flight["has_video"], flight["name"]) == (None, True, "live")


async def test_a_click_without_a_known_position_says_why(tmp_path: Path) -> None:
    async with flying(tmp_path) as (running, _, stream):
        await next_of(stream, "gps")
        async with running.video("cam-1") as pictures:
            frame = await frame_header(pictures)
        click = {"vehicle_id": "1", "frame_id": frame["frame_id"], "u_px": 10, "v_px": 10}
        early = await running.client.post("/api/v1/targets", json=click)
        unknown = await running.client.post("/api/v1/targets", json={**click, "frame_id": 10**6})

    assert early.status_code in (201, 409)  # whether the estimator has aligned by now is a matter of milliseconds
    assert early.status_code == 201 or early.json()["detail"]
    assert unknown.status_code == 404


async def test_a_lost_link_alarms(tmp_path: Path) -> None:
    async with flying(tmp_path) as (running, aircraft, stream):
        await next_of(stream, "gps")
        aircraft.step = lambda: None  # type: ignore[method-assign]
        codes: set[str] = set()
        while "link_lost" not in codes or "video_stopped" not in codes:
            alarm = await next_of(stream, "alarm")
            if alarm["active"]:
                codes.add(alarm["code"])
        lost = (await running.client.get("/api/v1/vehicles/1")).json()

    assert not lost["connected"]
