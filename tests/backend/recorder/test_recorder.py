"""The recorder never makes anybody wait, and says when the disk does not keep up."""

import csv
import threading
from pathlib import Path

import pytest

from backend.errors import ConflictError
from backend.recorder import recorder as recorder_module
from backend.recorder.folder import FlightWriter
from backend.recorder.followed import FollowedRow
from backend.recorder.recorder import Recorder
from geodata.flight import FlightFolder
from tests.backend.flight_maker import SIZE, T0_US, plan, state, telemetry
from tests.backend.video.coded import encoded_frames


def test_a_stopped_recording_is_complete(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    flight_id = recorder.start(plan(), "Field 7, east")
    packets = telemetry(3.0)
    for t_us, data in packets:
        recorder.packet(t_us, data)
    for frame in encoded_frames(50, SIZE, t0_us=T0_US):
        recorder.frame(frame)
    recorder.state(state(T0_US))
    active = recorder.status
    stopped = recorder.stop()

    flight = FlightFolder.open(tmp_path / flight_id)
    assert active.active
    assert stopped == flight_id
    assert flight_id.endswith("-field-7-east")
    assert flight.name == "Field 7, east"
    assert len(list(flight.telemetry())) == len(packets)
    assert not recorder.status.active


def test_what_was_followed_has_a_table_of_its_own(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    flight_id = recorder.start(plan())
    for t_us, data in telemetry(1.0):
        recorder.packet(t_us, data)
    place = (T0_US, 47.0, 8.0, 400.0, (1.5, 0.5), 0.25)
    seen = FollowedRow(T0_US, "van", "seen", None, (10.25, 20.5), 0.9, *place, True, (3.0, -4.0))
    lost = FollowedRow(T0_US + 200_000, "van", "lost", "not seen", None, None, *place, None, (3.0, -4.0))
    recorder.followed(seen)
    recorder.followed(lost)
    recorder.stop()
    other = recorder.start(plan())
    recorder.stop()
    first, second = csv.DictReader((tmp_path / flight_id / "followed.csv").open())

    assert FlightFolder.open(tmp_path / flight_id).name == flight_id
    assert (first["u_px"], first["moving"], first["vel_e_m_s"], first["reason"]) == ("10.25", "1", "-4.000", "")
    assert (second["u_px"], second["moving"], second["reason"]) == ("", "", "not seen")
    assert not (tmp_path / other / "followed.csv").exists()


def test_only_one_recording_at_a_time(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    recorder.start(plan())
    with pytest.raises(ConflictError, match="being recorded already"):
        recorder.start(plan())
    recorder.stop()
    assert recorder.stop() is None


def test_two_recordings_of_one_second_have_two_folders(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    names = set()
    for _ in range(3):
        names.add(recorder.start(plan(), "same"))
        recorder.stop()

    assert len(names) == 3


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConflictError, match="file"):
        Recorder(tmp_path / "file").start(plan())


def test_a_stuck_disk_loses_records_but_holds_nobody_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """
    Fault: the disk takes nothing for a while.
    Expected: handing in returns at once, what does not fit is counted, and what waits is written in the end.
    """
    free, stuck = threading.Event(), threading.Event()
    write = FlightWriter.packet

    def slow(self: FlightWriter, t_unix_us: int, data: bytes) -> None:
        stuck.set()
        assert free.wait(20)
        write(self, t_unix_us, data)

    monkeypatch.setattr(FlightWriter, "packet", slow)
    monkeypatch.setattr(recorder_module, "MAX_WAITING", 50)
    recorder = Recorder(tmp_path)
    flight_id = recorder.start(plan())
    packets = telemetry(10.0)
    recorder.packet(*packets[0])
    assert stuck.wait(20)
    for packet in packets[1:]:
        recorder.packet(*packet)  # would hang the test if it waited
    dropped = recorder.dropped
    free.set()
    recorder.stop()

    kept = len(list(FlightFolder.open(tmp_path / flight_id).telemetry()))
    assert kept == 51
    assert dropped == len(packets) - 51


def test_a_full_disk_is_told_and_writing_goes_on_when_it_can(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = FlightWriter.packet
    failing = [True]

    def full(self: FlightWriter, t_unix_us: int, data: bytes) -> None:
        if failing[0]:
            failing[0] = False
            raise OSError(28, "No space left on device")
        write(self, t_unix_us, data)

    monkeypatch.setattr(FlightWriter, "packet", full)
    recorder = Recorder(tmp_path)
    flight_id = recorder.start(plan())
    packets = telemetry(2.0)
    for packet in packets:
        recorder.packet(*packet)
    session = recorder._session
    recorder.stop()

    assert session is not None
    assert "No space left" in (session.failure or "")
    assert len(list(FlightFolder.open(tmp_path / flight_id).telemetry())) == len(packets) - 1
