"""A real station process: the port, the end, the kill."""

import json
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import structlog

from backend.clock import unix_us
from backend.demo import free_udp_ports
from backend.errors import StartError
from backend.server import address_of, configure_logging, listening_socket, refuse_open_bind
from backend.video.recorded import RecordedVideo
from geodata.flight import FlightFolder
from simulator.video_out import H264TsSender
from tests.backend.flight_maker import SIZE
from tests.backend.link.wire import Sender
from tests.backend.video.pictures_with_numbers import picture_with_number

PATIENCE_S = 60.0


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def start(data_dir: Path, port: int, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "backend.cli", "serve", "--port", str(port), "--data-dir", str(data_dir)]
    command += options or ("--video", "none", "--mavlink", "none")
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def await_words(process: subprocess.Popen[str], words: str) -> str:
    """Read standard error up to a line with some words."""
    assert process.stderr is not None
    seen = ""
    for line in process.stderr:
        seen += line
        if words in line:
            return seen
    raise AssertionError(f"ended without saying {words!r}: {seen}")


def request(address: str, path: str, body: dict[str, object] | None = None) -> dict[str, object]:
    data = None if body is None else json.dumps(body).encode()
    made = urllib.request.Request(address + path, data, {"Content-Type": "application/json"})  # noqa: S310
    with urllib.request.urlopen(made, timeout=PATIENCE_S) as answer:  # noqa: S310
        return dict(json.load(answer))


@pytest.fixture
def processes() -> Iterator[list[subprocess.Popen[str]]]:
    started: list[subprocess.Popen[str]] = []
    yield started
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


class Downlink:
    """Sends telemetry and video to a station until told to end, from a thread of its own."""

    def __init__(self, mavlink_port: int, video_port: int) -> None:
        self._ending = threading.Event()
        self._ports = mavlink_port, video_port
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._thread.join(PATIENCE_S)

    def _run(self) -> None:
        wire, count = Sender(), 0
        mavlink = ("127.0.0.1", self._ports[0])
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out,
            H264TsSender("127.0.0.1", self._ports[1], *SIZE, fps=25.0) as video,
        ):
            while not self._ending.wait(0.02):
                if count % 25 == 0:
                    out.sendto(wire.heartbeat(), mavlink)
                out.sendto(wire.attitude(count * 20), mavlink)
                video.send(picture_with_number(count % 100, SIZE), unix_us())
                count += 1


def test_kill_loses_no_acknowledged_target_and_no_recording(
    tmp_path: Path, processes: list[subprocess.Popen[str]]
) -> None:
    """
    Fault: kill -9 while eight clients create targets as fast as they can and a recording runs.
    Expected: every target that was acknowledged is there afterwards, and the recording so far opens as a flight with
    telemetry and video.
    """
    port, (mavlink_port, video_port) = free_port(), free_udp_ports(2)
    links = ("--mavlink", f"udpin:127.0.0.1:{mavlink_port}", "--video", f"udp://127.0.0.1:{video_port}")
    process = start(tmp_path, port, "--record", *links)
    processes.append(process)
    await_words(process, "Pilotage")
    address = f"http://127.0.0.1:{port}"
    acknowledged: list[str] = []
    killed = threading.Event()

    def create(client: int) -> None:
        for n in range(10_000):
            try:
                made = request(address, "/api/v1/targets", {"lat_deg": 47, "lon_deg": 8, "name": f"{client}-{n}"})
            except OSError:
                return
            acknowledged.append(str(made["id"]))
            recorded = request(address, "/api/v1/recording") if n % 5 == 0 and not killed.is_set() else {}
            if len(acknowledged) >= 60 and int(str(recorded.get("bytes", 0))) > 30_000:
                killed.set()
                process.send_signal(signal.SIGKILL)
                return

    downlink = Downlink(mavlink_port, video_port)
    try:
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(create, range(8)))
        assert process.wait(PATIENCE_S) == -signal.SIGKILL
    finally:
        downlink.close()

    again = start(tmp_path, port)
    processes.append(again)
    await_words(again, "Pilotage")
    listed = request(address, "/api/v1/targets")["features"]
    again.send_signal(signal.SIGTERM)
    (folder,) = (tmp_path / "flights").iterdir()
    flight = FlightFolder.open(folder)
    video = RecordedVideo.open(flight.video_path or Path())

    assert isinstance(listed, list)
    assert len(acknowledged) >= 60
    assert set(acknowledged) <= {feature["id"] for feature in listed}
    assert len(list(flight.telemetry())) > 10
    assert sum(1 for _ in video.frames()) > 5
    assert flight.frame_times() is not None
    assert again.wait(PATIENCE_S) == 0


def test_a_second_station_on_the_port_says_so_and_leaves_the_first_alone(
    tmp_path: Path, processes: list[subprocess.Popen[str]]
) -> None:
    port = free_port()
    first = start(tmp_path / "a", port)
    processes.append(first)
    await_words(first, "Pilotage")
    second = start(tmp_path / "b", port)
    processes.append(second)
    _, said = second.communicate(timeout=PATIENCE_S)
    third = start(tmp_path / "a", free_port())
    processes.append(third)
    _, said_of_folder = third.communicate(timeout=PATIENCE_S)

    assert second.returncode == 1
    assert f"port {port}" in said
    assert "--port" in said
    assert third.returncode == 1
    assert "in use by another station" in said_of_folder
    assert "Traceback" not in said + said_of_folder
    assert request(f"http://127.0.0.1:{port}", "/healthz")["status"] == "ok"
    first.send_signal(signal.SIGINT)
    assert first.wait(PATIENCE_S) == 0


def test_two_stations_run_side_by_side(tmp_path: Path, processes: list[subprocess.Popen[str]]) -> None:
    ports = [free_port(), free_port()]
    for port in ports:
        processes.append(start(tmp_path / str(port), port))
    for process in processes:
        await_words(process, "Pilotage")
    for port in ports:
        request(f"http://127.0.0.1:{port}", "/api/v1/targets", {"lat_deg": 1, "lon_deg": 2, "name": str(port)})

    for port in ports:
        features = request(f"http://127.0.0.1:{port}", "/api/v1/targets")["features"]
        assert isinstance(features, list)
        assert [feature["properties"]["name"] for feature in features] == [str(port)]


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "::"])  # noqa: S104
def test_an_address_that_others_reach_is_refused(host: str) -> None:
    with pytest.raises(StartError, match="login"):
        refuse_open_bind(host)


def test_a_taken_port_and_a_foreign_address_are_named() -> None:
    with listening_socket("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        assert address_of(taken) == f"http://127.0.0.1:{port}"
        with pytest.raises(StartError, match=f"port {port}"):
            listening_socket("127.0.0.1", port)
    with pytest.raises(StartError, match=r"192\.0\.2\.1"):
        listening_socket("192.0.2.1", 0)


def test_a_terminal_that_has_gone_ends_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    class Gone:
        def write(self, _: str) -> int:
            raise BrokenPipeError(32, "Broken pipe")

        flush = isatty = lambda self: False

    before = structlog.get_config()
    monkeypatch.setattr(sys, "stderr", Gone())
    configure_logging()
    try:
        structlog.get_logger("test").info("anybody there")
    finally:
        structlog.configure(**before)
