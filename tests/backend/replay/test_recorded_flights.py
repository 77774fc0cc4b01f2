"""Real imagery under real autopilots' telemetry, GPS denied: the figures that the README states, with room to spare."""

from pathlib import Path

import pytest

from backend.link.dialect import message_layouts
from backend.replay.offline import ReplayOptions, replay_flight
from geodata.flight import FlightFolder
from tests.shared_data import shared_data

INERTIAL = frozenset(i for i, layout in message_layouts().items() if layout.name in {"HIGHRES_IMU", "RAW_IMU"})


@pytest.mark.parametrize(
    ("flight", "leave_out", "rms_m"),
    [
        ("copter_120m", frozenset(), 0.6),
        ("copter_120m", INERTIAL, 1.5),
        # banks of 56 degrees, a clock and a misalignment that nobody states
        ("plane_80m", frozenset(), 2.0),
    ],
)
def test_flight_without_gps_stays_on_the_map(
    tmp_path: Path, flight: str, leave_out: frozenset[int], rms_m: float
) -> None:
    result = replay_flight(
        FlightFolder.open(shared_data(f"flights/{flight}")), tmp_path, None, ReplayOptions(leave_out=leave_out)
    )

    assert result.evaluation is not None
    assert result.evaluation.horizontal_m.rms < rms_m
    assert result.evaluation.inside_95_ellipse > 0.75
    # a picture every tenth of a second
    assert result.evaluation.longest_gap_s < 0.5
    if flight == "plane_80m":
        clock = result.report["video_clock"]
        # against the true attitude, once, by other means: -0.120 s
        assert clock["time_offset_s"] == pytest.approx(-0.120, abs=0.012)


def test_oblique_pictures_once_a_second_stay_on_the_map(tmp_path: Path) -> None:
    """45 degrees oblique over hills, a map of another season, no inertial data: the ellipse must say how bad it is."""
    result = replay_flight(FlightFolder.open(shared_data("flights/ariel_b")), tmp_path)

    assert result.evaluation is not None
    assert result.evaluation.horizontal_m.p50 < 8.0
    assert result.evaluation.inside_95_ellipse > 0.8
