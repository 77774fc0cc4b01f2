"""Ctrl-C at a real station in full work: it ends by itself, the recording is whole, nobody is left behind."""

from __future__ import annotations

import itertools
import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from websockets.sync.client import connect

from backend.demo import free_udp_ports
from backend.video.recorded import RecordedVideo
from geodata.flight import FlightFolder
from tests.backend.flight_maker import CAMERA, write_flight
from tests.backend.station_process import PATIENCE_S, Downlink, await_words, free_port, request, start
from tests.backend.video.pictures_with_numbers import number_in
from tests.e2e.demo_process import OUTPUT

# The station's own limit is three seconds; on a machine that does other things too it may wait for its turn.
ENDS_S = 15.0


def children_of(pid: int) -> set[int]:
    """Processes below one, by the kernel's own list."""
    found: set[int] = set()
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            found |= {int(child)} | children_of(int(child))
    return found


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def deaf_viewer(port: int, path: str) -> socket.socket:
    """A viewer that opens a WebSocket and then neither reads nor answers."""
    viewer = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    viewer.sendall(
        f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    assert viewer.recv(12) == b"HTTP/1.1 101"
    return viewer


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_busy_station_ends_and_closes_its_recording(
    tmp_path: Path, processes: list[subprocess.Popen[str]], number: signal.Signals
) -> None:
    """
    A recording runs, telemetry and video come, viewers watch both sockets (two of them deaf), an estimate is being
    computed in a process of its own; then a signal comes.
    """
    port, (mavlink_port, video_port) = free_port(), free_udp_ports(2)
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({"camera": CAMERA.model_dump(), "map": {"ground_alt_amsl_m": 400.0}}))
    write_flight(tmp_path / "others" / "alpha", seconds=60.0, with_estimate=False)
    (tmp_path / "others" / "alpha" / "estimate.csv").unlink()
    process = start(
        tmp_path / "data", port, "--record", "--camera", str(camera), "--flights", str(tmp_path / "others"),
        "--mavlink", f"udpin:127.0.0.1:{mavlink_port}", "--video", f"udp://127.0.0.1:{video_port}",
    )  # fmt: skip
    processes.append(process)
    await_words(process, "Pilotage")
    address, sockets = f"http://127.0.0.1:{port}", f"ws://127.0.0.1:{port}/api/v1"
    downlink = Downlink(mavlink_port, video_port)
    try:
        with ExitStack() as viewers:
            stream = viewers.enter_context(connect(f"{sockets}/stream", close_timeout=1.0))
            while "cam-" not in (said := str(stream.recv(PATIENCE_S))) or '"fps":0' in said:
                pass
            video = viewers.enter_context(connect(f"{sockets}/video/cam-1", close_timeout=1.0))
            for _ in range(30):
                video.recv(PATIENCE_S)
            for path in ("/api/v1/stream", "/api/v1/video/cam-1"):
                viewers.enter_context(deaf_viewer(port, path))
            request(address, "/api/v1/flights/alpha/replay", {"speed": 1.0})
            below = children_of(process.pid)
            process.send_signal(number)
            status = process.wait(ENDS_S)
    finally:
        downlink.close()
    said = process.communicate()[1]
    (folder,) = (tmp_path / "data" / "flights").iterdir()
    flight = FlightFolder.open(folder)
    recorded = RecordedVideo.open(flight.video_path or Path())
    times = flight.frame_times()

    assert status == 0, said
    assert "Traceback" not in said
    assert not [pid for pid in below if is_running(pid)]
    assert flight.warnings == []
    assert len(list(flight.telemetry())) > 10
    assert times is not None
    numbers = [number_in(frame.image) for frame in recorded.frames()]
    assert len(numbers) == recorded.frame_count >= 30
    assert all(1 <= (b - a) % 100 < 50 for a, b in itertools.pairwise(numbers))


def test_a_second_ctrl_c_does_no_harm(tmp_path: Path, processes: list[subprocess.Popen[str]]) -> None:
    port = free_port()
    process = start(tmp_path, port, "--record", "--video", "none", "--mavlink", "none")
    processes.append(process)
    await_words(process, "Pilotage")
    with connect(f"ws://127.0.0.1:{port}/api/v1/stream", close_timeout=1.0):
        for _ in range(3):
            process.send_signal(signal.SIGINT)
        status = process.wait(ENDS_S)
    said = process.communicate()[1]

    assert status == 0, said
    assert "Traceback" not in said
    (folder,) = (tmp_path / "flights").iterdir()
    assert json.loads((folder / "flight.json").read_text())["schema"] == "pilotage.flight/1"


def test_ctrl_c_in_a_terminal_ends_the_demonstration_and_its_simulator(
    tmp_path: Path, processes: list[subprocess.Popen[str]]
) -> None:
    """Ctrl-C reaches all processes of the terminal at once: station and simulator end, whoever is first."""
    command = [sys.executable, "-m", "backend.cli", "demo", "--no-browser", "--port", "0", "--seed", "5"]
    command += ["--data-dir", str(tmp_path)]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "XDG_CACHE_HOME": str(OUTPUT / "worlds")},
    )  # fmt: skip
    processes.append(process)
    words = await_words(process, "http://127.0.0.1:")
    address = words[words.index("http://127.0.0.1:") :].split()[0]
    with connect(f"{address.replace('http', 'ws')}/api/v1/stream", close_timeout=1.0) as stream:
        while '"fps"' not in str(stream.recv(PATIENCE_S)):
            pass
        request(address, "/api/v1/recording", {"active": True})
        below = children_of(process.pid)
        os.killpg(process.pid, signal.SIGINT)
        status = process.wait(ENDS_S)
    said = process.communicate()[1]

    assert below
    assert status == 0, said
    assert "Traceback" not in said
    assert not [pid for pid in below if is_running(pid)]
    (folder,) = (tmp_path / "flights").iterdir()
    assert (folder / "telemetry.tlog").exists()
