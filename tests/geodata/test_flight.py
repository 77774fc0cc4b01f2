from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from geodata.errors import FlightFolderError
from geodata.flight import FlightFolder
from geodata.tlog import TlogWriter
from tests.geodata.test_tlog import T0_US, packets
from tests.shared_data import shared_data

SPAN_US = 99 * 20_000  # of the telemetry below


def make(folder: Path, meta: dict[str, Any] | None = None, frames: str | None = None) -> Path:
    """The least that replays: a description, telemetry, a video file, times."""
    folder.mkdir(exist_ok=True)
    with TlogWriter(folder / "telemetry.tlog") as writer:
        for item in packets(100):
            writer.write(*item)
    (folder / "video.mp4").write_bytes(b"not looked into here")
    content = {
        "schema": "pilotage.flight/1", "camera": {"width_px": 640, "height_px": 480, "fx_px": 500},
        "video": {"file": "video.mp4", "start_time_us": T0_US}, **(meta or {}),
    }  # fmt: skip
    (folder / "flight.json").write_text(json.dumps(content))
    if frames is not None:
        (folder / "frames.csv").write_text(frames)
    return folder


@pytest.mark.parametrize(
    ("name", "frames", "clicks", "targets"),
    [("copter_120m", 2500, 84, 14), ("plane_80m", 2076, 73, 13), ("ariel_b", 118, 104, 40)],
)
def test_folders_of_others_open_without_a_warning(name: str, frames: int, clicks: int, targets: int) -> None:
    flight = FlightFolder.open(shared_data(f"flights/{name}"))

    times = flight.frame_times()

    assert flight.truth() is not None
    assert (len(flight.clicks()), len(flight.targets_truth())) == (clicks, targets)
    assert times is not None
    assert len(times.frame) == frames
    assert flight.reference_path is not None
    assert (flight.elevation_path is not None) == (name == "ariel_b")
    assert flight.time_offset_us == (None if name == "plane_80m" else 0)
    assert flight.warnings == []
    if name == "ariel_b":
        assert list(flight.frame_files()) == list(range(118))
        assert flight.frame_files()[7].name == "000007.jpg"


def test_denied_interval_is_known(tmp_path: Path) -> None:
    flight = FlightFolder.open(make(tmp_path / "f", {"gps_denied": [[T0_US + 10, T0_US + 20]]}))
    assert [flight.is_gps_denied(T0_US + dt_us) for dt_us in (9, 10, 15, 20, 21)] == [False, True, True, True, False]


def test_without_frames_csv_start_time_and_pts_count(tmp_path: Path) -> None:
    flight = FlightFolder.open(make(tmp_path / "f"))
    assert flight.frame_times() is None
    assert flight.frame_time_us(3, 0.12) == T0_US + 120_000
    assert flight.frame_time_us(3) is None


def test_frames_csv_wins_over_the_start_time(tmp_path: Path) -> None:
    flight = FlightFolder.open(make(tmp_path / "f", frames=f"frame,time_us\n0,{T0_US + 5}\n1,{T0_US + 40_005}\n"))
    assert flight.frame_time_us(1, 0.5) == T0_US + 40_005
    assert flight.frame_time_us(2, 0.5) is None


def test_description_with_a_byte_order_mark_and_given_by_its_own_path(tmp_path: Path) -> None:
    folder = make(tmp_path / "f")
    content = (folder / "flight.json").read_bytes()
    (folder / "flight.json").write_bytes(b"\xef\xbb\xbf" + content.replace(b", ", b",\r\n"))
    assert FlightFolder.open(folder / "flight.json").path == folder
    assert FlightFolder.open(folder).name == "f"


def test_flight_without_camera_and_video_opens(tmp_path: Path) -> None:
    """Telemetry alone is worth replaying; whoever needs the camera is told what is missing."""
    folder = make(tmp_path / "f", {"camera": None, "video": None})
    (folder / "video.mp4").unlink()

    flight = FlightFolder.open(folder)

    assert flight.video_path is None
    assert "has no video" in flight.warnings[0]
    with pytest.raises(FlightFolderError, match=r"flight\.json: camera: is missing; give at least width_px"):
        _ = flight.camera


def test_unnamed_video_is_found(tmp_path: Path) -> None:
    folder = make(tmp_path / "f", {"video": {"start_time_us": T0_US}})
    (folder / "video.mp4").rename(folder / "video.ts")
    assert FlightFolder.open(folder).video_path == folder / "video.ts"


def pictures(folder: Path, numbers: list[int]) -> None:
    (folder / "frames").mkdir()
    for number in numbers:
        (folder / "frames" / f"{number:06d}.jpg").touch()
    (folder / "frames" / "Thumbs.db").touch()


def test_pictures_with_gaps_are_tolerated(tmp_path: Path) -> None:
    rows = "".join(f"{frame},{T0_US + frame * 40_000}\n" for frame in (0, 1, 2, 5, 9))
    folder = make(tmp_path / "f", {"video": {"file": "frames"}}, "frame,time_us\n" + rows)
    pictures(folder, [0, 2, 5, 7, 9])

    flight = FlightFolder.open(folder)

    assert list(flight.frame_files()) == [0, 2, 5, 7, 9]
    assert any("1 pictures that frames.csv lists are missing" in warning for warning in flight.warnings)
    assert any("1 pictures have no time" in warning for warning in flight.warnings)


def test_broken_optional_tables_are_done_without(tmp_path: Path) -> None:
    folder = make(tmp_path / "f")
    (folder / "truth.csv").write_text("when,where\n1,2\n")
    (folder / "clicks.csv").write_bytes(b"\xff\xfe\x00\x01")
    (folder / "targets_truth.csv").write_text("target,lat_deg,lon_deg,alt_amsl_m\nA,95,0,0\nB,1,2,3\n")
    flight = FlightFolder.open(folder)

    assert flight.truth() is None
    assert flight.clicks() == []
    assert list(flight.targets_truth()) == ["B"]
    assert len(flight.warnings) == 3
    for name, warning in zip(("truth.csv", "clicks.csv", "targets_truth.csv"), flight.warnings, strict=True):
        assert name in warning


def _remove(name: str) -> Any:
    return lambda folder: (folder / name).unlink()


def _write(name: str, content: bytes) -> Any:
    return lambda folder: (folder / name).write_bytes(content)


def _meta(**sections: Any) -> Any:
    return lambda folder: make(folder, sections)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_remove("flight.json"), ["flight.json: is missing"]),
        (_remove("telemetry.tlog"), ["telemetry.tlog: is missing"]),
        (_remove("video.mp4"), ["video.file", "names 'video.mp4'", "it holds flight.json, telemetry.tlog"]),
        (_write("flight.json", b'{"schema": "pilotage.flight/1",\n "camera": }'), ["line 2, column 12", "is not JSON"]),
        (_write("flight.json", b"\xff\xff"), ["flight.json", "UTF-8"]),
        (_write("flight.json", b"[]"), ["holds no JSON object"]),
        (_write("flight.json", b"[" * 100_000), ["flight.json", "not JSON"]),
        (_write("telemetry.tlog", b"hello"), ["telemetry.tlog: holds no MAVLink packet"]),
        (_meta(schema="pilotage.flight/2"), ["schema", "pilotage.flight/1"]),
        (_meta(camera={"width_px": "wide", "height_px": 480, "fx_px": 500}), ["camera.width_px", "'wide'"]),
        (_meta(map={"reference": "map.tif"}), ["map.reference", "names 'map.tif'"]),
        (_meta(map={"elevation": "../../../etc/passwd"}), ["map.elevation", "outside the folder"]),
        (_meta(video={"file": "/etc/passwd"}), ["video.file", "outside the folder"]),
        (_meta(video={"file": "video.mp4"}), ["frames.csv", "start_time_us is null", "add frames.csv"]),
        (_meta(video={"file": "video.mp4", "start_time_us": T0_US + 9 * 10**9}), ["video.start_time_us", "overlap"]),
        (
            _write("frames.csv", f"frame,time_us\n0,{T0_US // 10**6}\n1,{T0_US // 10**6 + 1}\n".encode()),
            ["frames.csv", "look like seconds"],
        ),
    ],
)
def test_what_is_missing_or_contradictory_is_named_with_a_remedy(tmp_path: Path, spoil: Any, words: list[str]) -> None:
    folder = make(tmp_path / "f")
    spoil(folder)
    with pytest.raises(FlightFolderError) as caught:
        FlightFolder.open(folder)
    for word in words:
        assert word in str(caught.value)
    assert caught.value.remedy


def test_pictures_numbered_unlike_their_table_contradict_it(tmp_path: Path) -> None:
    folder = make(tmp_path / "f", {"video": {"file": "frames"}}, f"frame,time_us\n0,{T0_US}\n1,{T0_US + 1000}\n")
    pictures(folder, [500, 501])
    with pytest.raises(FlightFolderError, match="number both alike"):
        FlightFolder.open(folder)


def test_two_pictures_of_one_frame_contradict_each_other(tmp_path: Path) -> None:
    folder = make(tmp_path / "f", {"video": {"file": "frames"}}, f"frame,time_us\n0,{T0_US}\n")
    pictures(folder, [0])
    (folder / "frames" / "0.png").touch()
    with pytest.raises(FlightFolderError, match="are frame 0"):
        FlightFolder.open(folder)


def test_interval_outside_the_flight_is_a_warning(tmp_path: Path) -> None:
    flight = FlightFolder.open(make(tmp_path / "f", {"gps_denied": [[5, 10]]}))
    assert "gps_denied" in flight.warnings[0]


@pytest.mark.parametrize("path", ["nowhere", "file"])
def test_what_is_no_folder_is_refused(tmp_path: Path, path: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FlightFolderError, match="give the folder that holds"):
        FlightFolder.open(tmp_path / path)


def test_recording_that_was_killed_still_opens(tmp_path: Path) -> None:
    """Telemetry and frame table each end in the middle of a record."""
    folder = make(tmp_path / "f", frames=f"frame,time_us\n0,{T0_US}\n1,{T0_US + 40_000}\n2,{str(T0_US)[:9]}")
    log = (folder / "telemetry.tlog").read_bytes()
    (folder / "telemetry.tlog").write_bytes(log[:-11])

    flight = FlightFolder.open(folder)

    times = flight.frame_times()
    assert times is not None
    assert times.frame.tolist() == [0, 1]
    assert "unfinished" in flight.warnings[0]
    assert len(list(flight.telemetry())) == 99


def test_copy_of_a_real_flight_without_its_extras_opens(tmp_path: Path) -> None:
    source = shared_data("flights/ariel_b")
    for name in ("flight.json", "telemetry.tlog", "frames.csv", "reference.tif", "elevation.tif"):
        shutil.copy(source / name, tmp_path / name)
    (tmp_path / "frames").symlink_to(source / "frames")

    flight = FlightFolder.open(tmp_path)

    assert flight.truth() is None
    assert flight.clicks() == []
    assert flight.targets_truth() == {}
    assert flight.warnings == []
