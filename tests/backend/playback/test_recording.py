"""A flight read for playback: what was known when, at the boundaries and with telemetry out of order."""

from __future__ import annotations

from pathlib import Path

import pytest

from backend.playback.recording import FlightRecording, read_recording
from geodata.flight import FlightFolder
from tests.backend.flight_maker import T0_US, write_flight
from tests.backend.replay.flown import packets, write_known_flight

S_US = 1_000_000


def read(path: Path) -> FlightRecording:
    told: list[float] = []
    found = read_recording(path, told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    return found


def test_intervals_are_open_at_the_beginning_and_closed_at_the_end(tmp_path: Path) -> None:
    write_known_flight(tmp_path / "f")
    recording = read(tmp_path / "f")
    first, second = recording.gps[:2]

    assert recording.gps_between(first.t_us - 1, first.t_us) == [first]
    assert recording.gps_between(first.t_us, second.t_us) == [second]
    assert recording.gps_between(second.t_us, first.t_us) == []
    assert recording.telemetry_at(T0_US - 1).vehicle_type == "unknown" or not recording.telemetry_at(T0_US - 1).armed
    assert recording.telemetry_at(T0_US + 99 * S_US).vehicle_type == "helicopter"


def test_frames_are_found_by_number_and_by_time(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", seconds=2.0)
    recording = read(tmp_path / "f")

    assert recording.frame_time_us(0) == T0_US
    assert recording.frame_time_us(49) == T0_US + 49 * 40_000
    assert [recording.frame_time_us(n) for n in (-1, 50)] == [None, None]
    assert [recording.frame_at(T0_US + t) for t in (-1, 0, 39_999, 40_000, 99 * S_US)] == [0, 0, 0, 1, 49]


def test_telemetry_out_of_order_is_put_in_order(tmp_path: Path) -> None:
    """
    Fault: neighbouring packets swapped, single ones dated by other clocks.
    Expected: the span is the flight's, readings ascend, a warning says what was left out.
    """
    log = packets(12.0)
    log = [log[n ^ 1] if n ^ 1 < len(log) else log[n] for n in range(len(log))]
    log[0] = (0, log[0][1])
    log[50] = (log[50][0] + 3600 * S_US, log[50][1])
    write_known_flight(tmp_path / "f", log=log)
    recording = read(tmp_path / "f")
    times = [reading.t_us for reading in recording.gps]

    assert T0_US <= recording.start_us < recording.end_us < T0_US + 12 * S_US
    assert times == sorted(times)
    assert len(times) == 55  # the lost heartbeat was the first: the vehicle is known from the next one on
    assert any("2 packets are left out" in warning for warning in recording.folder.warnings)


def test_a_flight_that_tells_no_place_plays_without_one(tmp_path: Path) -> None:
    log = [(t, data) for t, data in packets(4.0) if data[7:10] != (24).to_bytes(3, "little")]  # GPS_RAW_INT
    flight = write_known_flight(tmp_path / "f", log=log)
    text = (flight.path / "flight.json").read_text()
    (flight.path / "flight.json").write_text(text.replace('"home"', '"elsewhere"'))
    recording = read(tmp_path / "f")

    assert FlightFolder.open(tmp_path / "f").meta.home is None
    assert recording.setup is None
    assert recording.gps == []


def test_telemetry_of_another_vehicle_is_not_shown(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "f")
    text = (flight.path / "flight.json").read_text()
    (flight.path / "flight.json").write_text(text.replace('"system_id": 1', '"system_id": 9'))

    assert read(tmp_path / "f").gps == []


@pytest.mark.parametrize("cut", [1, 5, 19])
def test_a_log_cut_off_anywhere_plays_up_to_there(tmp_path: Path, cut: int) -> None:
    flight = write_known_flight(tmp_path / "f")
    whole = (flight.path / "telemetry.tlog").read_bytes()
    (flight.path / "telemetry.tlog").write_bytes(whole[:-cut])

    assert read(tmp_path / "f").end_us > T0_US + 11 * S_US
