"""Estimates between their lines."""

import math
from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from backend.playback.estimate import NUMBERS, EstimateTable, RecordedStates
from estimator.geometry.camera import Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q
from estimator.types import Mode
from geodata.elevation import FlatGround

HEADER = ",".join(("time_us", *NUMBERS, "mode")) + "\n"
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
