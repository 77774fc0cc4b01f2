"""Estimates between their lines."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from backend.playback.estimate import EstimateTable, RecordedStates
from backend.recorder.estimate import ESTIMATE_COLUMNS, NUMBER_COLUMNS, estimate_cells
from estimator.geometry.camera import Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q, q_from_euler
from estimator.types import Mode, NavigationState
from geodata.elevation import FlatGround
from geodata.flight_write import CsvAppender
from tests.backend.flight_maker import T0_US, state

HEADER = ",".join(("time_us", *NUMBER_COLUMNS, "mode")) + "\n"
LINES = (
    "1000000,47.0,8.0,500,0,0,350,1,0,0,1,2,3,0.5,gps\n"
    "2000000,47.001,8.0,510,0,0,10,1,0,0,1,2,3,0.5,vision\n"
    "9000000,47.002,8.0,510,0,0,10,1,0,0,1,2,3,0.5,lost\n"
)


def table(tmp_path: Path, text: str) -> EstimateTable:
    path = tmp_path / "estimate.csv"
    path.write_text(HEADER + text)
    return EstimateTable.read(path)


def test_angles_go_the_short_way_round(tmp_path: Path) -> None:
    found = table(tmp_path, LINES).at(1_500_000)

    assert found is not None
    values, mode = found
    assert_allclose(values[:3], [47.0005, 8.0, 505.0])
    assert values[5] % 360.0 in (0.0, 360.0)
    assert mode is Mode.GPS


def test_there_is_no_answer_in_gaps_and_outside(tmp_path: Path) -> None:
    estimate = table(tmp_path, LINES)

    assert [estimate.at(t) is None for t in (0, 999_999, 1_000_000, 5_000_000, 9_300_000, 9_300_001)] == [
        True, True, False, True, False, True,
    ]  # fmt: skip


def test_lines_cut_off_or_senseless_are_left_out(tmp_path: Path) -> None:
    text = LINES + "9100000,nan,8,1,0,0,0,0,0,0,1,1,1,0,gps\n9200000,47,8,1,0,0,0,0,0,0,1,1,1,0,wild\n9300000,47.0"
    estimate = table(tmp_path, text)

    assert estimate.t_us.tolist() == [1_000_000, 2_000_000, 9_000_000]


def recorded(path: Path, states: list[NavigationState]) -> RecordedStates:
    """Recorded by the station, read for a replay."""
    with CsvAppender(path, ESTIMATE_COLUMNS) as table:
        for known in states:
            table.write(*estimate_cells(known))
    frame = LocalFrame(math.radians(47.0), math.radians(8.0), 400.0)
    nadir = Mount(0.0, -math.pi / 2, 0.0, np.zeros(3))
    return RecordedStates(EstimateTable.read(path), frame, FlatGround(400.0), nadir, "fixed", [])


def test_a_recorded_state_is_as_sure_of_its_camera_as_the_estimator_was(tmp_path: Path) -> None:
    """Direction with the boresight that was estimated, and errors with their correlations; between two lines too."""
    draws = np.random.default_rng(5).normal(size=(6, 6)) * [3.0, 3.0, 3.0, 0.01, 0.01, 0.01]
    cov = draws.T @ draws
    first = replace(state(T0_US), q_ned_from_camera=q_from_euler(0.0, 0.0, 1.0), cov_camera_pose=cov)
    second = replace(state(T0_US + 100_000), q_ned_from_camera=-q_from_euler(0.0, 0.0, 1.02), cov_camera_pose=3.0 * cov)
    states = recorded(tmp_path / "estimate.csv", [first, second])
    at_first, between = states.at(T0_US), states.at(T0_US + 50_000)

    assert at_first is not None
    assert between is not None
    assert_allclose(at_first.q_ned_from_camera, first.q_ned_from_camera, atol=1e-7)
    assert_allclose(at_first.cov_camera_pose, cov, rtol=1e-7)
    assert_allclose(between.q_ned_from_camera, q_from_euler(0.0, 0.0, 1.01), atol=1e-6)
    assert_allclose(between.cov_camera_pose, 2.0 * cov, rtol=1e-7)
    assert states.assumption_at(T0_US + 50_000) is None


def test_a_recorded_state_has_the_ground_where_the_estimator_had_it(tmp_path: Path) -> None:
    """Without it a ray is cut with the model's ground, metres too high; broken and missing cells are none."""
    cov = np.array([0.1, 0.2, 1.5, 0.01, 0.02, 0.0, 4.0])
    first = replace(state(T0_US), ground_bias_m=3.0, cov_ground_bias=cov)
    second = replace(state(T0_US + 100_000), ground_bias_m=5.0, cov_ground_bias=3.0 * cov)
    states = recorded(tmp_path / "estimate.csv", [first, second, state(T0_US + 200_000)])
    at_first, between, none = (states.at(T0_US + after_us) for after_us in (0, 50_000, 200_000))

    assert at_first is not None
    assert between is not None
    assert none is not None
    assert (at_first.ground_bias_m, between.ground_bias_m, none.ground_bias_m) == (3.0, 4.0, 0.0)
    assert_allclose(at_first.cov_ground_bias, cov, rtol=1e-7)
    assert_allclose(between.cov_ground_bias, 2.0 * cov, rtol=1e-7)
    assert none.cov_ground_bias is None
    assert_allclose((at_first.alt_agl_m, none.alt_agl_m), (103.0, 100.0), atol=0.01)


def test_a_table_that_tells_no_attitude_errors_has_them_assumed_in_words(tmp_path: Path) -> None:
    frame = LocalFrame(math.radians(47.0), math.radians(8.0), 400.0)
    nadir = Mount(0.0, -math.pi / 2, 0.0, np.zeros(3))
    states = RecordedStates(table(tmp_path, LINES), frame, FlatGround(400.0), nadir, "fixed", [])
    known = states.at(2_000_000)

    assert known is not None
    assert_allclose(np.degrees(np.sqrt(np.diag(known.cov_attitude_rad2))), 1.0)
    assert states.assumption_at(2_000_000) == "attitude 1 deg assumed"


def test_a_nadir_camera_looks_down_with_its_top_forward(tmp_path: Path) -> None:
    frame = LocalFrame(math.radians(47.0), math.radians(8.0), 400.0)
    states = RecordedStates(
        table(tmp_path, LINES), frame, FlatGround(400.0), Mount(0.0, -math.pi / 2, 0.0, np.zeros(3)), "fixed", []
    )
    state = states.at(2_000_000)

    assert state is not None
    ned_from_camera = matrix_from_q(state.q_ned_from_camera)
    assert_allclose(ned_from_camera @ [0, 0, 1], [0, 0, 1], atol=1e-12)
    heading = math.radians(10.0)
    assert_allclose(ned_from_camera @ [0, -1, 0], [math.cos(heading), math.sin(heading), 0], atol=1e-12)
    assert_allclose(state.alt_agl_m, 110.0, atol=0.01)
    assert_allclose(state.cov_pos_ned_m2[:2, :2], [[1.0, 0.5], [0.5, 4.0]])
