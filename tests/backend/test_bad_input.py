"""Bad input at a whole station: each fault is told, none stops the service, the other streams go on."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
import random
import socket
import tty
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.demo import free_udp_ports
from simulator.video_out import H264TsSender
from tests.backend.aircraft import flying, frame_header
from tests.backend.flight_maker import LAT_DEG, LON_DEG, SIZE
from tests.backend.link.wire import Sender
from tests.backend.station_process import free_port
from tests.backend.station_runner import PATIENCE_S, RunningStation, next_of, running_station
from tests.backend.video.pictures_with_numbers import picture_with_number

Send = Callable[[bytes], object]


def gps_of(wire: Sender, t_ms: int) -> bytes:
    return wire.pack(dialect.MAVLink_gps_raw_int_message(
        t_ms * 1000, 3, round(LAT_DEG * 1e7), round(LON_DEG * 1e7), 500_000, 80, 80, 0, 0, 12
    ))  # fmt: skip


@contextlib.asynccontextmanager
async def three_links(tmp_path: Path) -> AsyncIterator[tuple[RunningStation, Any, dict[str, Send]]]:
    """A station that listens on UDP, TCP and a serial line, and a way to send into each."""
    (udp_port,), tcp_port = free_udp_ports(1), free_port()
    ours, device = pty.openpty()
    tty.setraw(device)
    links = (f"udpin:127.0.0.1:{udp_port}", f"tcpin:127.0.0.1:{tcp_port}", f"serial:{os.ttyname(device)}:57600")
    try:
        async with running_station(tmp_path, mavlink=links) as running, running.stream() as stream:
            _, tcp = await asyncio.open_connection("127.0.0.1", tcp_port)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
                udp.connect(("127.0.0.1", udp_port))
                yield running, stream, {"1": udp.send, "2": tcp.write, "3": lambda data: os.write(ours, data)}
            tcp.close()
    finally:
        os.close(ours)
        os.close(device)


async def test_random_bytes_and_cut_packets_on_every_kind_of_link(tmp_path: Path) -> None:
    """
    Fault: on UDP, TCP and serial, random bytes (start marks among them) and packets cut anywhere, between whole ones.
    Expected: the vehicle of each link is heard to the end, its noise is counted and told.
    """
    chance = random.Random(11)
    wires = {name: Sender(system_id=int(name)) for name in ("1", "2", "3")}
    heard: dict[str, int] = dict.fromkeys(wires, 0)
    noise: dict[str, int] = dict.fromkeys(wires, 0)
    async with three_links(tmp_path) as (running, stream, sends):

        async def send() -> None:
            for n in range(100_000):
                for name, wire in wires.items():
                    whole = wire.attitude(n * 20)
                    garbage = chance.randbytes(chance.randrange(0, 60)) + b"\xfd" * chance.randrange(0, 3)
                    parts = [garbage, whole[: chance.randrange(0, len(whole))], wire.heartbeat(), gps_of(wire, n * 20)]
                    for part in parts:
                        if part:
                            sends[name](part)
                await asyncio.sleep(0.02)

        sending = asyncio.create_task(send())
        while min(heard.values()) < 5 or not all(noise.values()):
            message = await next_of(stream, "gps", "link")
            if message["type"] == "gps":
                heard[message["vehicle_id"]] += 1
            else:
                noise[message["vehicle_id"]] = message["noise_bytes"]
        sending.cancel()
        vehicles = (await running.client.get("/api/v1/vehicles")).json()
        health = await running.client.get("/healthz")

    assert {vehicle["id"] for vehicle in vehicles} == {"1", "2", "3"}
    assert all(vehicle["connected"] for vehicle in vehicles)
    assert health.status_code == 200


async def test_random_bytes_at_the_console_port(tmp_path: Path) -> None:
    """Fault: a hundred connections that speak no HTTP. Expected: refused or closed, a browser sees nothing of it."""
    chance = random.Random(5)
    beginnings = (
        b"",
        b"GET / HTTP/1.1\r\n",
        b"GET /api/v1/stream HTTP/1.1\r\nUpgrade: websocket\r\n\r\n",
        b"\x16\x03\x01",
    )
    async with running_station(tmp_path) as running, running.stream() as stream:
        await next_of(stream, "hello")
        port = int(running.address.rsplit(":", 1)[1])
        for n in range(100):
            _, out = await asyncio.open_connection("127.0.0.1", port)
            out.write(beginnings[n % 4] + chance.randbytes(chance.randrange(1, 5000)))
            with contextlib.suppress(ConnectionError):
                await out.drain()
            out.close()
        await stream.send('{"type": "ping"}')
        await next_of(stream, "pong")
        health = await running.client.get("/healthz")

    assert health.status_code == 200


async def test_video_that_changes_size_in_flight(tmp_path: Path) -> None:
    """
    Fault: the pictures become larger but alike, then of another shape than the camera file's, then as before.
    Expected: each is shown, in an epoch of its own; the other shape raises an alarm that names both sizes and ends
    with it; telemetry goes on.
    """
    async with flying(tmp_path) as (running, aircraft, stream):
        await next_of(stream, "gps")
        port = int((running.station.settings.video or "").rsplit(":", 1)[1])

        def change(size: tuple[int, int]) -> None:
            if aircraft.video is not None:
                aircraft.video.close()
            aircraft.video = H264TsSender("127.0.0.1", port, *size, fps=25.0)
            aircraft.picture = lambda count: picture_with_number(count % 100, size)

        epochs: dict[tuple[int, int], int] = {}
        async with running.video("cam-1") as video:
            for size in ((640, 480), (352, 288), SIZE):
                change(size)
                header = await frame_header(video)
                while (header["width"], header["height"]) != size:
                    header = await frame_header(video)
                epochs[size] = header["epoch"]
                if size == (352, 288):
                    alarm = await next_of(stream, "alarm")
                    while alarm["code"] != "video_size":
                        alarm = await next_of(stream, "alarm")
        over = await next_of(stream, "alarm")
        while over["code"] != "video_size" or over["active"]:
            over = await next_of(stream, "alarm")
        await next_of(stream, "gps")

    assert list(epochs.values()) == sorted(set(epochs.values()))
    assert alarm["active"]
    assert "352 x 288" in alarm["text"]
    assert "320 x 240" in alarm["text"]


async def test_video_that_freezes_and_stops_in_flight(tmp_path: Path) -> None:
    """
    Fault: the same picture again and again; then none.
    Expected: an alarm for each with its reason, each over when its cause is; telemetry goes on throughout.
    """
    async with flying(tmp_path) as (_, aircraft, stream):
        await next_of(stream, "gps")

        async def told(code: str, active: bool) -> str:
            while True:
                alarm = await next_of(stream, "alarm")
                if (alarm["code"], alarm["active"]) == (code, active):
                    return str(alarm["text"])

        moving = aircraft.picture
        aircraft.picture = lambda _: picture_with_number(7, SIZE)
        frozen = await told("video_frozen", True)
        aircraft.picture = moving
        await told("video_frozen", False)
        sender, aircraft.video = aircraft.video, None
        stopped = await told("video_stopped", True)
        gps = await next_of(stream, "gps")
        aircraft.video = sender
        await told("video_stopped", False)

    assert "has not changed" in frozen
    assert "no picture" in stopped
    assert gps["fix_type"] == 3


async def test_a_vehicle_whose_time_runs_backwards(tmp_path: Path) -> None:
    """
    Fault: the autopilot's clock jumps back in flight, as after a reboot; then single packets are older than the last.
    Expected: GPS, telemetry and the estimate go on.
    """
    async with flying(tmp_path) as (running, aircraft, stream):
        while aircraft.count < 60:
            await next_of(stream, "gps")
        aircraft.count = 0
        for n in range(5):
            aircraft.send(aircraft.wire.attitude(40 - n))
        for _ in range(12):
            gps = await next_of(stream, "gps")
        telemetry = await next_of(stream, "telemetry")
        vehicle = (await running.client.get("/api/v1/vehicles/1")).json()
        health = (await running.client.get("/healthz")).status_code

    assert gps["fix_type"] == 3
    assert telemetry["vehicle_type"] == "helicopter"
    assert vehicle["connected"]
    assert health == 200


@pytest.mark.parametrize("kind", ["udp", "rtp"])
async def test_garbage_on_the_video_port_leaves_the_rest_alone(tmp_path: Path, kind: str) -> None:
    """Fault: nothing but random bytes comes for video. Expected: the station says so, and the vehicle is heard."""
    (mavlink_port, video_port) = free_udp_ports(2)
    sdp = tmp_path / "camera.sdp"
    sdp.write_text(f"v=0\r\nc=IN IP4 127.0.0.1\r\nm=video {video_port} RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n")
    video = f"udp://127.0.0.1:{video_port}" if kind == "udp" else f"rtp:{sdp}"
    chance, wire = random.Random(2), Sender()
    async with running_station(
        tmp_path / "data", mavlink=(f"udpin:127.0.0.1:{mavlink_port}",), video=video
    ) as running, running.stream() as stream:  # fmt: skip
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            async with asyncio.timeout(PATIENCE_S):
                told = ""
                for n in range(100_000):
                    out.sendto(chance.randbytes(chance.randrange(1, 1400)), ("127.0.0.1", video_port))
                    out.sendto(wire.heartbeat() + gps_of(wire, n * 20), ("127.0.0.1", mavlink_port))
                    told = "; ".join(running.station.waiting_for())
                    if "bytes came" in told:
                        break
                    await asyncio.sleep(0.01)
        gps = await next_of(stream, "gps")

    assert ("no MPEG-TS" if kind == "udp" else "not the RTP") in told
    assert gps["fix_type"] == 3
