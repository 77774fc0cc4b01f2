"""Lines of estimate.csv: everything a click needs comes back, and broken cells are nothing."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.recorder.estimate import CAMERA_COLUMNS, ESTIMATE_COLUMNS, camera_pose, estimate_cells, ground_bias
from estimator.geometry.rotation import q_from_euler
from tests.backend.flight_maker import T0_US, state


def test_the_columns_of_the_contract_come_first() -> None:
    """The design's table, which other programs read, is not touched by what is added behind it."""
    contract = (
        "time_us,lat_deg,lon_deg,alt_amsl_m,roll_deg,pitch_deg,yaw_deg,vn_mps,ve_mps,vd_mps,std_n_m,std_e_m,std_d_m"
    )

    assert ",".join(ESTIMATE_COLUMNS).startswith(contract + ",cov_ne_m2,mode,")
    assert len(estimate_cells(state(T0_US))) == len(ESTIMATE_COLUMNS)


def test_the_cameras_pose_survives_the_table() -> None:
    draws = np.random.default_rng(5).normal(size=(6, 6)) * [3.0, 3.0, 3.0, 0.01, 0.01, 0.01]
    known = replace(state(T0_US), q_ned_from_camera=q_from_euler(0.1, -1.4, 2.0), cov_camera_pose=draws.T @ draws)
    cells = dict(zip(ESTIMATE_COLUMNS, estimate_cells(known), strict=True))
    found = camera_pose(*(str(cells[name]) for name in CAMERA_COLUMNS))

    assert found is not None
    assert_allclose(found[0], known.q_ned_from_camera, atol=1e-8)
    assert_allclose(found[1], known.cov_camera_pose, rtol=1e-7)


@pytest.mark.parametrize(
    ("q", "cov"),
    [
        (None, None), ("", ""), ("1 0 0 0", None), ("1 0 0", "1 " * 21), ("0 0 0 0", "1 " * 21),
        ("nan 0 0 1", "1 " * 21), ("1 0 0 0", "x " * 21), ("1 0 0 0", "-1 " * 21), ("1 0 0 0", "1 " * 20),
    ],
)  # fmt: skip
def test_a_pose_that_makes_no_sense_is_none(q: str | None, cov: str | None) -> None:
    assert camera_pose(q, cov) is None


@pytest.mark.parametrize(
    ("bias", "cov"),
    [(None, None), ("", ""), ("1", None), ("x", "1 " * 7), ("1", "1 " * 6), ("nan", "1 " * 7), ("1", "1 " * 6 + "-1")],
)
def test_a_ground_that_makes_no_sense_is_none(bias: str | None, cov: str | None) -> None:
    assert ground_bias(bias, cov) is None
