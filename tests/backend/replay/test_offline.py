"""Offline replays: the known flight comes back, GPS stays out where denied, faults of a folder are told in words."""

from __future__ import annotations

import itertools
import json
import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.link.dialect import message_layouts
from backend.navigation.setup import NavigationSetup
from backend.replay.offline import ReplayError, ReplayOptions, ReplayResult, errors_against_truth, replay_flight
from estimator.types import BarometerSample, GnssSample, Mode, Sample
from geodata.flight import FlightFolder, write_truth_csv
from tests.backend.flight_maker import SIZE, T0_US, plan, write_flight, write_recording_with_faulty_video
from tests.backend.replay.flown import SPEED_M_S, packets, write_known_flight

S_US = 1_000_000
Log = list[tuple[int, bytes]]


def ids_of(*names: str) -> frozenset[int]:
    return frozenset(number for number, layout in message_layouts().items() if layout.name in names)


def test_a_known_flight_comes_back(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "f")
    told: list[float] = []
    result = replay_flight(flight, tmp_path / "out", told.append)
    last = result.states[-1]

    # 1 cm: sixteen bits of the wire's 1e-7 degrees, and nothing else errs in this flight
    assert_allclose(last.pos_ned_m, [SPEED_M_S * (last.t_us - T0_US) / 1e6, 0.0, -100.0], atol=0.02)
    assert_allclose(last.vel_ned_m_s, [SPEED_M_S, 0.0, 0.0], atol=0.01)
    assert last.mode is Mode.GPS
    assert result.evaluation is not None
    assert result.evaluation.horizontal_m.rms < 0.02
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "estimate.csv", "smoothed.csv", "fixes.csv", "sightings.csv", "targets.csv", "report.json", "report.html",
    }  # fmt: skip
    written = json.loads((tmp_path / "out" / "report.json").read_text())
    assert written["errors"]["rows"] == result.evaluation.rows
    lines = (tmp_path / "out" / "estimate.csv").read_text().splitlines()
    assert len(lines) == 1 + len(result.states)


def test_two_runs_write_the_same_bytes(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "f")
    for name in ("a", "b"):
        replay_flight(flight, tmp_path / name)

    for name in ("estimate.csv", "fixes.csv", "targets.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_nothing_of_gps_passes_a_denied_interval(tmp_path: Path) -> None:
    """
    Fault: from second 8 on the receiver says that it is a kilometre to the east.
    Expected: denied from second 7 on, the estimate is the same to the last bit as with a receiver that says the truth.
    """

    def spoofed(t_us: int) -> float:
        return 1000.0 if t_us >= T0_US + 8 * S_US else 0.0

    denied = ((T0_US + 7 * S_US, T0_US + 60 * S_US),)
    honest = write_known_flight(tmp_path / "a", 20.0, gps_denied=denied)
    spoof = write_known_flight(tmp_path / "b", 20.0, gps_denied=denied, log=packets(20.0, spoofed))
    open_to_it = write_known_flight(tmp_path / "c", 20.0, log=packets(20.0, spoofed))
    results = [replay_flight(flight, tmp_path / "out" / flight.path.name) for flight in (honest, spoof, open_to_it)]
    estimates = [(tmp_path / "out" / name / "estimate.csv").read_bytes() for name in "abc"]

    assert estimates[0] == estimates[1] != estimates[2]
    assert results[0].states[-1].mode is Mode.DEAD_RECKONING
    assert results[0].evaluation is not None
    assert results[0].evaluation.rows < len(results[0].states)  # judged inside the interval only


def test_messages_can_be_taken_out(tmp_path: Path) -> None:
    """Those that are not there change nothing; without one that is needed there is no estimate, and it says why."""
    flight = write_known_flight(tmp_path / "f")
    whole = replay_flight(flight, tmp_path / "a")
    same = replay_flight(flight, tmp_path / "b", options=ReplayOptions(leave_out=ids_of("HIGHRES_IMU", "RAW_IMU")))

    assert same.report["samples"] == whole.report["samples"]
    with pytest.raises(ReplayError, match="waiting for the vehicle's attitude"):
        replay_flight(flight, tmp_path / "c", options=ReplayOptions(leave_out=ids_of("ATTITUDE")))
    with pytest.raises(ReplayError, match="waiting for a first position"):
        replay_flight(flight, tmp_path / "d", options=ReplayOptions(leave_out=ids_of("GPS_RAW_INT")))


def _swapped(log: Log) -> Log:
    return [log[n ^ 1] if n ^ 1 < len(log) else log[n] for n in range(len(log))]


def _jittered(log: Log) -> Log:
    delays = random.Random(1)
    return [(t_us + delays.randrange(0, 80_000), data) for t_us, data in log]


def _wrong_times(log: Log) -> Log:
    wrong = {30: 0, 90: T0_US + 3600 * S_US, 150: T0_US - 3600 * S_US}
    return [(wrong.get(n, t_us), data) for n, (t_us, data) in enumerate(log)]


def _repeated(log: Log) -> Log:
    return [entry for entry in log for _ in range(2)]


@pytest.mark.parametrize(
    ("spoil", "warns", "limit_m"),
    # A packet's time of arrival dates what has no time of its own: 80 ms at 5 m/s are 0.4 m.
    [(_swapped, False, 0.3), (_jittered, False, 0.5), (_wrong_times, True, 0.1), (_repeated, False, 0.1)],
)
def test_telemetry_that_runs_backwards_stops_nothing(
    tmp_path: Path, spoil: Callable[[Log], Log], warns: bool, limit_m: float
) -> None:
    """
    Fault: packets swapped, late, twice, or dated by another clock.
    Expected: states run forward to the end of the flight, close to the truth; what had to be left out is told.
    """
    flight = write_known_flight(tmp_path / "f", 20.0, log=spoil(packets(20.0)))
    result = replay_flight(flight, tmp_path / "out")
    times = [state.t_us for state in result.states]

    assert times == sorted(set(times))
    assert times[-1] > T0_US + 19 * S_US
    assert result.evaluation is not None
    assert result.evaluation.horizontal_m.rms < limit_m
    assert any("time does not run forward" in warning for warning in result.report["warnings"]) == warns


def test_a_clock_set_back_in_mid_flight_costs_the_rest_and_says_so(tmp_path: Path) -> None:
    log = packets(20.0)
    half = len(log) // 2
    flight = write_known_flight(
        tmp_path / "f", 20.0, log=[*log[:half], *((t_us - 3600 * S_US, data) for t_us, data in log[half:])]
    )
    result = replay_flight(flight, tmp_path / "out")

    assert result.states[-1].t_us > T0_US + 9 * S_US
    assert any(f"{len(log) - half} packets are left out" in warning for warning in result.report["warnings"])


def test_a_camera_that_contradicts_the_video_is_refused_with_both_sizes(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", seconds=2.0)
    meta = json.loads((tmp_path / "f" / "flight.json").read_text())
    camera = plan().camera
    assert camera is not None
    meta["camera"] = camera.model_copy(update={"width_px": 640, "height_px": 480}).model_dump()
    (tmp_path / "f" / "flight.json").write_text(json.dumps(meta))

    with pytest.raises(ReplayError, match=rf"{SIZE[0]} x {SIZE[1]} px but camera .* says 640 x 480"):
        _replayed(tmp_path)


def test_a_flight_that_never_says_where_it_is_names_the_remedy(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "f")
    meta = json.loads((flight.path / "flight.json").read_text())
    meta["home"] = None
    (flight.path / "flight.json").write_text(json.dumps(meta))
    result = _replayed(tmp_path)  # the first fix will do
    no_gps = ReplayOptions(leave_out=ids_of("GPS_RAW_INT"))

    assert result.evaluation is not None
    with pytest.raises(ReplayError, match="waiting for"):
        _replayed(tmp_path, no_gps)


def test_pictures_without_a_time_are_counted_and_left_out(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", seconds=2.0)
    lines = (tmp_path / "f" / "frames.csv").read_text().splitlines()
    (tmp_path / "f" / "frames.csv").write_text("\n".join([*lines[:11], *lines[21:]]) + "\n")
    write_known_flight(tmp_path / "known", 4.0)
    (tmp_path / "f" / "telemetry.tlog").write_bytes((tmp_path / "known" / "telemetry.tlog").read_bytes())
    result = _replayed(tmp_path)

    assert result.report["frames"] == {"used": 40, "without_time": 10, "of_another_shape": 0}


def test_video_that_changes_size_freezes_and_stops_is_replayed_to_the_end_of_the_telemetry(tmp_path: Path) -> None:
    """
    Fault: 2 s of pictures, 2 s twice as large, 2 s of another shape, 2 s as at first, 2 s of one still picture, then
    none while the telemetry goes on for 4 s.
    Expected: the larger ones are brought to size, the others left out with a warning; states run to the end.
    """
    write_recording_with_faulty_video(tmp_path / "f")
    result = _replayed(tmp_path)
    times = [state.t_us for state in result.states]

    assert result.report["frames"] == {"used": 200, "without_time": 0, "of_another_shape": 50}
    (warning,) = result.report["warnings"]
    assert "from picture 100 on" in warning
    assert "352 x 288" in warning
    assert times[-1] > T0_US + 13 * S_US
    assert max(b - a for a, b in itertools.pairwise(times)) < 500_000
    assert result.evaluation is None


def _replayed(tmp_path: Path, options: ReplayOptions | None = None) -> ReplayResult:
    return replay_flight(FlightFolder.open(tmp_path / "f"), tmp_path / "out", options=options)


@pytest.mark.parametrize(("truth_deg", "error_deg"), [(0.0, 0.0), (350.0, 10.0), (-170.0, 170.0), (12.0, -12.0)])
def test_heading_errors_are_within_half_a_turn(truth_deg: float, error_deg: float, tmp_path: Path) -> None:
    """The aircraft says north all the time; its truth is another column."""
    flight = write_known_flight(tmp_path / "f")
    states = replay_flight(flight, tmp_path / "out").states
    truth = flight.truth()
    assert truth is not None
    yaw = np.full(len(truth.t_unix_us), np.radians(truth_deg))
    yaw[60:63] = np.nan
    write_truth_csv(flight.path / "truth.csv", replace(truth, yaw_rad=yaw))

    errors = errors_against_truth(FlightFolder.open(flight.path), states)

    assert errors is not None
    known = np.isfinite(errors.heading_error_rad)
    assert 0.8 < known.mean() < 1.0, "a gap in the truth's heading is a gap, and no more"
    assert_allclose(np.degrees(errors.heading_error_rad[known]), error_deg, atol=0.5)
    assert_allclose(errors.error_ned_m, 0.0, atol=0.05)
    assert errors.spans_us == [(int(errors.t_us[0]), int(errors.t_us[-1]))]


class Higher:
    """An alteration: a barometer that reads ten metres more, and no satellites after three seconds."""

    def setup(self, setup: NavigationSetup) -> NavigationSetup:
        return replace(setup, map_id="altered")

    def sample(self, sample: Sample) -> Sample | None:
        if isinstance(sample, BarometerSample):
            return replace(sample, pressure_alt_m=sample.pressure_alt_m + 10.0)
        return None if isinstance(sample, GnssSample) and sample.t_us > T0_US + 3_000_000 else sample


def test_what_is_altered_is_what_the_estimator_gets(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "f")
    as_flown = replay_flight(flight, tmp_path / "a")
    altered = replay_flight(flight, tmp_path / "b", None, ReplayOptions(alteration=Higher()))

    assert altered.report["samples"]["gnss"] < as_flown.report["samples"]["gnss"]
    # a barometer's zero is learned from the first fixes: it is no error of the height
    assert_allclose(altered.states[0].alt_amsl_m, as_flown.states[0].alt_amsl_m, atol=0.5)
