"""A real station process: the port, the end, the kill."""

import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import structlog

from backend.demo import free_udp_ports
from backend.errors import StartError
from backend.server import address_of, configure_logging, listening_socket, refuse_open_bind
from backend.video.recorded import RecordedVideo
from geodata.flight import FlightFolder
from tests.backend.station_process import PATIENCE_S, Downlink, await_words, free_port, request, start

MIN_PACKETS = 10


def recorded_enough(data_dir: Path) -> bool:
    """Whether what the disk holds of the running recording is worth reading back."""
    sizes = {path.name: path.stat().st_size for path in (data_dir / "flights").glob("*/*") if path.is_file()}
    video = max((size for name, size in sizes.items() if name.startswith("video.")), default=0)
    return sizes.get("telemetry.tlog", 0) > 4_000 and video > 20_000


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
            if len(acknowledged) >= 60 and n % 5 == 0 and not killed.is_set() and recorded_enough(tmp_path):
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
    assert len(list(flight.telemetry())) > MIN_PACKETS
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
