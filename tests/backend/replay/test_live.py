"""A flight folder played into a running station: what is sent when, and what the station makes of it."""

from __future__ import annotations

import asyncio
import itertools
import signal
import sys
from functools import partial
from pathlib import Path

import cv2
import pytest

from backend import cli
from backend.demo import free_udp_ports
from backend.replay.live import Moment, moments, play
from backend.video.annexb import is_key
from geodata.flight import FlightFolder
from geodata.flight_meta import VideoMeta
from geodata.flight_write import write_flight_json
from tests.backend.aircraft import frame_header
from tests.backend.flight_maker import LAT_DEG, SIZE, T0_US, write_flight
from tests.backend.link.wire import Sender, parsed
from tests.backend.replay.flown import packets, write_known_flight
from tests.backend.station_runner import PATIENCE_S, next_of, running_station
from tests.backend.video.pictures_with_numbers import picture_with_number


def recorded(folder: Path, seconds: float = 4.0) -> FlightFolder:
    write_flight(folder, seconds)
    return FlightFolder.open(folder)


def test_everything_is_sent_in_the_order_and_at_the_pace_of_the_flight(tmp_path: Path) -> None:
    flight = recorded(tmp_path / "f")
    sent: list[bytes] = []
    shown: list[int] = []
    waits: list[int] = []
    count = play(moments(flight), sent.append, lambda frame: shown.append(frame.t_us), waits.append)

    assert sent == [packet for _, packet in flight.telemetry()]
    assert shown == [T0_US + 40_000 * n for n in range(100)]
    assert count == len(sent) + len(shown) == len(waits)
    assert waits == sorted(waits)
    assert (waits[0], waits[-1]) == (0, 3_960_000)


def test_a_beginning_in_mid_flight_is_at_a_key_frame(tmp_path: Path) -> None:
    schedule = list(moments(recorded(tmp_path / "f"), start_s=1.5))
    frames = [moment.frame for moment in schedule if moment.frame is not None]

    assert schedule[0].t_us >= T0_US + 1_500_000
    assert frames[0].key
    assert frames[0].t_us == T0_US + 50 * 40_000  # key frames are a second apart


def test_neither_a_ground_station_nor_another_vehicle_speaks_for_the_aircraft(tmp_path: Path) -> None:
    gcs, other = Sender(system_id=255, component_id=190), Sender(system_id=7)
    log = [(t, data) for t, whole in packets(3.0) for data in (gcs.heartbeat(6), whole, other.heartbeat())]
    flight = write_known_flight(tmp_path / "f", log=log)
    senders = {message.get_srcSystem() for m in moments(flight) if m.packet for message in parsed([m.packet])}

    assert senders == {1}


def test_pictures_are_coded_for_the_link(tmp_path: Path) -> None:
    """A folder of JPEG pictures: a live aircraft sends H.264."""
    flight = write_known_flight(tmp_path / "f", 4.0)
    (flight.path / "frames").mkdir()
    for n in range(60):
        cv2.imwrite(str(flight.path / "frames" / f"{n:06d}.jpg"), picture_with_number(n, SIZE))
    lines = "".join(f"{n},{T0_US + n * 40_000}\n" for n in range(60))
    (flight.path / "frames.csv").write_text("frame,time_us\n" + lines)
    write_flight_json(flight.path, flight.meta.model_copy(update={"video": VideoMeta(file="frames")}))
    frames = [m.frame for m in moments(FlightFolder.open(flight.path)) if m.frame is not None]

    assert [frame.t_us for frame in frames] == [T0_US + n * 40_000 for n in range(60)]
    assert [n for n, frame in enumerate(frames) if frame.key] == [0, 25, 50]
    assert all(is_key(frame.payload) == frame.key for frame in frames)


def test_pictures_without_a_time_go_along(tmp_path: Path) -> None:
    flight = recorded(tmp_path / "f")
    lines = (flight.path / "frames.csv").read_text().splitlines()
    (flight.path / "frames.csv").write_text("\n".join([*lines[:11], *lines[21:]]) + "\n")
    frames = [m.frame for m in moments(FlightFolder.open(flight.path)) if m.frame is not None]

    assert [frame.frame_id for frame in frames] == list(range(100))
    assert {frame.t_us for frame in frames[9:20]} == {T0_US + 9 * 40_000}


def test_a_swapped_packet_is_sent_at_once(tmp_path: Path) -> None:
    waits: list[int] = []
    play([Moment(5, packet=b"a"), Moment(3, packet=b"b")], lambda _: None, lambda _: None, waits.append)

    assert waits == [0, 0]


async def test_a_running_station_hears_and_sees_the_flight(tmp_path: Path) -> None:
    """The command as a user types it; the station takes it for an aircraft."""
    flight = recorded(tmp_path / "f", seconds=6.0)
    mavlink_port, video_port = free_udp_ports(2)
    command = [sys.executable, "-m", "backend.cli", "replay", str(flight.path), "--live"]
    command += ["--mavlink", f"udpout:127.0.0.1:{mavlink_port}", "--video", f"udp://127.0.0.1:{video_port}"]
    async with running_station(
        tmp_path / "data", mavlink=(f"udpin:127.0.0.1:{mavlink_port}",), video=f"udp://127.0.0.1:{video_port}"
    ) as running, running.stream() as stream:  # fmt: skip
        await next_of(stream, "hello")
        player = await asyncio.create_subprocess_exec(*command, stdout=-1, stderr=-1)
        gps = [await next_of(stream, "gps") for _ in range(3)]
        async with running.video("cam-1") as video:
            headers = [await frame_header(video) for _ in range(60)]
        said, errors = await asyncio.wait_for(player.communicate(), PATIENCE_S)
        (vehicle,) = (await running.client.get("/api/v1/vehicles")).json()

    assert player.returncode == 0, errors.decode()
    assert f"{150 + len(list(flight.telemetry()))} packets and pictures sent" in said.decode()
    assert (vehicle["id"], vehicle["vehicle_type"]) == ("1", "helicopter")
    assert all(abs(reading["lat_deg"] - LAT_DEG) < 1e-3 for reading in gps)
    assert (headers[0]["width"], headers[0]["height"]) == SIZE
    steps = [b["t_unix_us"] - a["t_unix_us"] for a, b in itertools.pairwise(headers)]
    # the pictures' own pace, by the sender's clock and not by when the machine found time for them
    assert sorted(steps)[len(steps) // 2] == pytest.approx(40_000, abs=20)


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["--live", "--out", "x"], 2, "--live goes with"),
        (["--live", "--mavlink", "serial:/dev/null"], 1, "over UDP"),
        (["--live", "--mavlink", "udpout:127.0.0.1"], 1, "--mavlink"),
        (["--live", "--video", "rtsp://127.0.0.1:1/x"], 1, "--video"),
        (["--live", "--start-s", "1000"], 1, "after its end"),
        (["--live", "--start-s", "-1"], 2, "--start-s"),
    ],
)
def test_what_cannot_be_played_is_told(
    tmp_path: Path, arguments: list[str], status: int, words: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setenv("COLUMNS", "200")
    write_known_flight(tmp_path / "f", 2.0)

    assert cli.run(["replay", str(tmp_path / "f"), *arguments]) == status
    said = capsys.readouterr().err
    assert words in said.replace("\n", " ")
    assert "Traceback" not in said


async def test_the_station_is_asked_to_deny_gps_when_the_flight_was_without(tmp_path: Path) -> None:
    """The station hears GPS all the time and keeps it from the estimator in the flight's interval, no longer."""
    flight = recorded(tmp_path / "f", seconds=6.0)
    spans = ((T0_US + 2_000_000, T0_US + 3_000_000), (T0_US + 2_500_000, T0_US + 4_000_000))
    write_flight_json(flight.path, flight.meta.model_copy(update={"gps_denied": spans}))
    mavlink_port, video_port = free_udp_ports(2)
    async with running_station(
        tmp_path / "data", mavlink=(f"udpin:127.0.0.1:{mavlink_port}",), video=f"udp://127.0.0.1:{video_port}"
    ) as running, running.stream() as stream:  # fmt: skip
        await next_of(stream, "hello")
        command = [sys.executable, "-m", "backend.cli", "replay", str(flight.path), "--live"]
        command += ["--mavlink", f"udpout:127.0.0.1:{mavlink_port}", "--video", f"udp://127.0.0.1:{video_port}"]
        player = await asyncio.create_subprocess_exec(*command, "--station", running.address, stdout=-1, stderr=-1)
        denied, readings = False, []
        while len(readings) < 25:
            message = await next_of(stream, "gps", "vehicle")
            if message["type"] == "vehicle":
                denied = message["vehicle"]["gps_denied"]
            else:
                readings.append((denied, message["t_gps_unix_us"]))
        _, errors = await asyncio.wait_for(player.communicate(), PATIENCE_S)
        (vehicle,) = (await running.client.get("/api/v1/vehicles")).json()

    assert player.returncode == 0, errors.decode()
    assert not vehicle["gps_denied"]
    without = [t_us for was_denied, t_us in readings if was_denied]
    # 5 a second, over two seconds; asking takes a moment
    assert 6 <= len(without) <= 13
    first_us = readings[0][1]
    assert 1.8e6 < without[0] - first_us < 3.0e6
    assert [was_denied for was_denied, _ in readings[-4:]] == [False] * 4


async def test_gps_is_given_back_where_the_playing_is_broken_off(tmp_path: Path) -> None:
    """Also: it begins inside the interval, before the station has heard of the vehicle."""
    flight = recorded(tmp_path / "f", seconds=25.0)
    write_flight_json(flight.path, flight.meta.model_copy(update={"gps_denied": ((T0_US, T0_US + 60_000_000),)}))
    (mavlink_port,) = free_udp_ports(1)
    async with running_station(tmp_path / "data", mavlink=(f"udpin:127.0.0.1:{mavlink_port}",)) as running:
        command = [sys.executable, "-m", "backend.cli", "replay", str(flight.path), "--live", "--video", "none"]
        command += ["--mavlink", f"udpout:127.0.0.1:{mavlink_port}", "--station", running.address]
        # begun from a background job, the tests themselves may have been told to ignore an interrupt
        heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
        player = await asyncio.create_subprocess_exec(*command, stdout=-1, stderr=-1, preexec_fn=heeds)
        async with running.stream() as stream:
            while not (await next_of(stream, "vehicle"))["vehicle"]["gps_denied"]:
                pass
            player.send_signal(signal.SIGINT)
            while (await next_of(stream, "vehicle"))["vehicle"]["gps_denied"]:
                pass
        await asyncio.wait_for(player.communicate(), PATIENCE_S)

    assert player.returncode == 130


@pytest.mark.parametrize(
    ("station", "words"),
    [
        ("127.0.0.1:1", "is not http://HOST:PORT"),
        ("http://127.0.0.1:x", "is not http://HOST:PORT"),
        ("http://127.0.0.1:1", "no station answers"),
    ],
)
def test_a_flight_without_gps_is_not_played_with_it_unasked(
    tmp_path: Path, station: str, words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    write_known_flight(tmp_path / "f", 2.0, gps_denied=((T0_US, T0_US + 1_000_000),))

    assert cli.run(["replay", str(tmp_path / "f"), "--live", "--video", "none", "--station", station]) == 1
    assert words in capsys.readouterr().err.replace("\n", " ")


def test_a_flight_may_be_played_with_gps_on_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_known_flight(tmp_path / "f", 0.5, gps_denied=((T0_US, T0_US + 200_000),))
    (port,) = free_udp_ports(1)
    arguments = ["--live", "--video", "none", "--station", "none", "--mavlink", f"udpout:127.0.0.1:{port}"]

    assert cli.run(["replay", str(tmp_path / "f"), *arguments]) == 0
    assert "keeps its GPS" in capsys.readouterr().err.replace("\n", " ")
