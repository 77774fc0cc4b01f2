"""Against the clock: what comes out of the sockets, and how it ends. No assertion on the machine's speed."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from geodata.flight import FlightFolder
from simulator.datagrams import DatagramLink
from simulator.mavlink_input import messages_in
from simulator.realtime import RealTimeRun
from simulator.scenario import Scenario
from simulator.world.world import World

ROOT = Path(__file__).resolve().parents[2]

SCENARIO = """
[world]
half_size_m = 150.0
gsd_m = 0.5
reference_gsd_m = 1.0
[camera]
width_px = 160
height_px = 120
[flight]
height_agl_m = [60.0, 70.0]
"""


def listener() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", 0))
    opened.settimeout(60.0)
    return opened


def test_speaks_listens_and_records(scenario: Scenario, world: World, tmp_path: Path) -> None:
    with listener() as station, listener() as video:
        link = DatagramLink(f"udpout:127.0.0.1:{station.getsockname()[1]}")
        run = RealTimeRun(scenario, world, 7, link, video.getsockname(), tmp_path / "live")
        stop = threading.Event()
        flying = threading.Thread(target=run.run, args=(stop, None))
        flying.start()
        try:
            heard, asked = set(), False
            for _ in range(3000):
                data, vehicle = station.recvfrom(4096)
                heard |= {message.get_type() for message in messages_in(data)}
                if "HEARTBEAT" in heard and not asked:
                    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
                    order = mavlink.MAVLink_command_long_message(1, 1, 420, 0, 4, 1, 0, 0, 0, 0, 0)
                    station.sendto(b"\xfd\x01noise", vehicle)
                    station.sendto(bytes(order.pack(sender)), vehicle)
                    asked = True
                if {"COMMAND_ACK", "STATUSTEXT", "GPS_RAW_INT"} <= heard:
                    break
            assert {"COMMAND_ACK", "ATTITUDE", "HIGHRES_IMU", "GPS_RAW_INT"} <= heard
            datagram = video.recv(4096)
            assert len(datagram) % 188 == 0
            assert datagram[0] == 0x47
        finally:
            stop.set()
            flying.join(30.0)
        assert not flying.is_alive()
        link.close()
    flight = FlightFolder.open(tmp_path / "live")
    assert flight.frame_times() is not None
    assert run.statistics.packets > 0


def test_a_dead_picture_thread_does_not_stop_telemetry(scenario: Scenario, world: World) -> None:
    """
    Fault: rendering hangs until the flight is over.
    Expected: telemetry goes on, pictures are counted as skipped.
    """
    release = threading.Event()
    run = RealTimeRun(scenario, world, 7, None, None, None)

    def hang(*_: object) -> None:
        release.wait(60.0)
        message = "the lens fell off"
        raise RuntimeError(message)

    run._view.render = hang  # type: ignore[method-assign,assignment]
    stop = threading.Event()

    def end_when_enough_is_skipped() -> None:
        for _ in range(3000):
            enough = run.statistics.pictures_skipped > 5 and run.statistics.packets > 50
            if enough or stop.wait(0.02):
                break
        stop.set()
        release.set()

    watcher = threading.Thread(target=end_when_enough_is_skipped)
    watcher.start()
    done = run.run(stop, None)
    watcher.join()
    assert done.pictures == 0
    assert done.pictures_skipped > 5
    assert done.packets > 50
    assert "the lens fell off" in done.failures[0]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_asked_to_end_it_closes_the_recording(tmp_path: Path, number: signal.Signals) -> None:
    scenario = tmp_path / "small.toml"
    scenario.write_text(SCENARIO)
    with listener() as station, listener() as video:
        command = [sys.executable, "-c", "from simulator.cli import app; app()", str(scenario)]
        command += ["--mavlink", f"udpout:127.0.0.1:{station.getsockname()[1]}"]
        command += ["--video", f"udp://127.0.0.1:{video.getsockname()[1]}"]
        command += ["--record", str(tmp_path / "out"), "--cache", str(tmp_path / "cache")]
        with subprocess.Popen(command, cwd=ROOT, env=dict(os.environ), stderr=subprocess.PIPE) as process:
            video.recv(4096)
            for _ in range(60):
                station.recv(4096)
            process.send_signal(number)
            _, errors = process.communicate(timeout=60)
    assert process.returncode == 0
    assert b"Traceback" not in errors
    flight = FlightFolder.open(tmp_path / "out")
    times = flight.frame_times()
    assert times is not None
    assert len(times.frame) >= 1
    assert flight.video_path is not None
