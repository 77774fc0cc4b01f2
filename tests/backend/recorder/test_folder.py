"""A recorded folder opens as a flight at any moment, and holds what was handed in."""

from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from backend.playback.estimate import EstimateTable
from backend.recorder.folder import ClickRow, FlightWriter
from backend.video.recorded import RecordedVideo
from backend.video.timing import ExposureClock
from estimator.types import Mode, OffsetSource, VideoOffset
from geodata.flight import FlightFolder
from tests.backend.flight_maker import CAMERA, SIZE, T0_US, plan, state, telemetry, write_flight
from tests.backend.video.coded import encoded_frames
from tests.backend.video.pictures_with_numbers import number_in


@pytest.mark.parametrize("closed", [True, False])
def test_what_was_recorded_comes_back_closed_or_not(tmp_path: Path, closed: bool) -> None:
    writer = write_flight(tmp_path / "f", close=closed)
    flight = FlightFolder.open(tmp_path / "f")
    video = RecordedVideo.open(flight.video_path or Path())

    assert list(flight.telemetry()) == telemetry(4.0)
    times = flight.frame_times()
    assert times is not None
    assert times.t_video_us.tolist() == [T0_US + 40_000 * n for n in range(100)]
    assert [number_in(frame.image) for frame in video.frames()] == list(range(video.frame_count))
    assert video.frame_count >= 99  # an unclosed file may still hold back its last picture
    assert flight.camera == CAMERA
    assert flight.meta.video.time_offset_s == 0.0
    assert flight.meta.home is not None
    if not closed:
        writer.close()


def test_a_folder_without_video_yet_is_a_flight_too(tmp_path: Path) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    writer = FlightWriter(folder, plan(), "f")
    for t_us, data in telemetry(1.0):
        writer.packet(t_us, data)

    assert FlightFolder.open(folder).video_path is None
    writer.close()


def test_frames_before_the_first_key_frame_are_left_out(tmp_path: Path) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    writer = FlightWriter(folder, plan(), "f")
    for frame in encoded_frames(40, SIZE, gop=25, t0_us=T0_US)[5:]:
        writer.frame(frame)
    for t_us, data in telemetry(2.0):
        writer.packet(t_us, data)
    writer.close()

    times = FlightFolder.open(folder).frame_times()
    assert times is not None
    assert times.t_video_us[0] == T0_US + 25 * 40_000
    assert len(times.frame) == 15


def test_frame_times_that_run_backwards_are_not_listed_but_the_pictures_are_kept(tmp_path: Path) -> None:
    """
    Fault: under load the first pictures come late; when a later one comes in time, the exposures after it are moved to
    before those of its predecessors.
    Expected: the flight opens without a warning, its listed times rise and are right, no picture is lost.
    """
    late_us = [300_000, 260_000, 220_000, 180_000, 5_000, *([9_000] * 15)]
    clock = ExposureClock()
    frames = [
        replace(frame, t_us=clock.exposure_us(None, 40_000 * n, T0_US + 40_000 * n + late_us[n]))
        for n, frame in enumerate(encoded_frames(20, SIZE, t0_us=T0_US))
    ]
    assert frames[4].t_us < frames[3].t_us  # what this is about
    folder = tmp_path / "f"
    folder.mkdir()
    writer = FlightWriter(folder, plan(), "f")
    for t_us, data in telemetry(2.0):
        writer.packet(t_us, data)
    for frame in frames:
        writer.frame(frame)
    writer.close()

    flight = FlightFolder.open(folder)
    times = flight.frame_times()
    assert times is not None
    assert flight.warnings == []
    assert times.frame.tolist() == [0, *range(8, 20)]
    assert times.t_video_us[1:].tolist() == [T0_US + 40_000 * n + 5_000 for n in range(8, 20)]
    assert RecordedVideo.open(flight.video_path or Path()).frame_count == 20


def test_the_estimate_is_kept_at_ten_a_second(tmp_path: Path) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    writer = FlightWriter(folder, plan(), "f")
    for n in range(100):
        writer.state(state(T0_US + n * 20_000, north_m=n * 0.1, mode=Mode.VISION))
    writer.close()

    table = EstimateTable.read(folder / "estimate.csv")
    assert 19 <= len(table.t_us) <= 21  # two seconds
    assert set(table.modes) == {Mode.VISION}
    assert_allclose(table.values[0, 9:12], [1.0, 2.0, 1.5])


def test_denial_of_gps_is_noted_also_while_it_lasts(tmp_path: Path) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    writer = FlightWriter(folder, plan(), "f")
    packets = telemetry(10.0)
    for t_us, data in packets[:40]:
        writer.packet(t_us, data)
    writer.gps_denied(T0_US + 1_000_000, True)
    writer.gps_denied(T0_US + 2_000_000, False)
    writer.gps_denied(T0_US + 2_500_000, True)
    for t_us, data in packets[40:]:
        writer.packet(t_us, data)
    writer.flush()
    lasting = FlightFolder.open(folder).meta.gps_denied
    writer.close()

    assert lasting[0] == (T0_US + 1_000_000, T0_US + 2_000_000)
    assert lasting[1][0] == T0_US + 2_500_000
    assert lasting[1][1] == packets[-1][0]


def test_clicks_and_the_map_are_in_the_folder(tmp_path: Path) -> None:
    reference = tmp_path / "map.tif"
    reference.write_bytes(b"picture")
    folder = tmp_path / "f"
    folder.mkdir()
    writer = FlightWriter(folder, plan(reference=reference, map_offset_ne_m=(1.0, 2.0)), "f")
    for t_us, data in telemetry(1.0):
        writer.packet(t_us, data)
    writer.click(ClickRow(T0_US + 5, 12.5, 33.0, "a, b"))
    writer.close()

    flight = FlightFolder.open(folder)
    assert flight.reference_path is not None
    assert flight.reference_path.read_bytes() == b"picture"
    assert flight.meta.map.offset_ne_m == (1.0, 2.0)
    (click,) = flight.clicks()
    assert (click.t_video_us, click.u_px, click.v_px, click.target) == (T0_US + 5, 12.5, 33.0, "a, b")


@pytest.mark.parametrize("found", [True, False])
def test_an_offset_of_the_videos_clock_is_recorded_when_it_is_found(tmp_path: Path, found: bool) -> None:
    """Frame times are the video's own: who opens the flight adds the offset, or finds it where it says null."""
    folder = tmp_path / "f"
    folder.mkdir()
    writer = FlightWriter(folder, plan(time_offset_s=None), "f")
    frames = encoded_frames(20, SIZE, t0_us=T0_US)
    for frame in frames:
        writer.frame(frame)
    for t_us, data in telemetry(1.0):
        writer.packet(t_us, data)
    writer.flush()
    before = FlightFolder.open(folder)
    assert before.meta.video.time_offset_s is None
    searching = replace(state(T0_US), video_offset=VideoOffset(OffsetSource.SEARCHING))
    writer.state(searching)
    if found:
        writer.state(replace(state(T0_US + 100_000), video_offset=VideoOffset(OffsetSource.FOUND, -0.12, 0.004)))
    writer.flush()
    killed = FlightFolder.open(folder)
    writer.close()

    assert killed.meta.video.time_offset_s == (-0.12 if found else None)
    times = FlightFolder.open(folder).frame_times()
    assert times is not None
    assert times.t_video_us.tolist() == [frame.t_us for frame in frames]


def test_stamped_pictures_need_no_offset(tmp_path: Path) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    writer = FlightWriter(folder, plan(time_offset_s=None), "f")
    for frame in encoded_frames(20, SIZE, t0_us=T0_US):
        writer.frame(replace(frame, stamped=True))
    for t_us, data in telemetry(1.0):
        writer.packet(t_us, data)
    writer.close()

    assert FlightFolder.open(folder).meta.video.time_offset_s == 0.0
