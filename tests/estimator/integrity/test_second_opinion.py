"""The density beside the filter: products of Gaussians in closed form, aliases, and moves of the estimate."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.integrity.second_opinion import Opinion, SecondOpinion, SecondOpinionConfig

REACH_M = 25
AXIS_M = np.arange(-REACH_M, REACH_M + 1, dtype=np.float64)
NORTH, EAST = np.meshgrid(-AXIS_M, AXIS_M, indexing="ij")
WITHOUT_COMMON = SecondOpinionConfig(leak=0.0, common_std_m=1e-3)


def gaussian(at_ne_m: tuple[float, float], std_ne_m: tuple[float, float], floor: float = 0.0) -> np.ndarray:
    n, e = (NORTH - at_ne_m[0]) / std_ne_m[0], (EAST - at_ne_m[1]) / std_ne_m[1]
    peak = np.exp(-0.5 * (n**2 + e**2))
    return (1.0 - floor) * peak / peak.mean() + floor


def see(opinion: SecondOpinion, likelihood: np.ndarray, way_m: float = 0.0, fresh: float = 1.0) -> Opinion:
    opinion.see(likelihood, float(REACH_M), float(-REACH_M), fresh, way_m)
    found = opinion.opinion()
    assert found is not None
    return found


def test_a_gaussian_picture_gives_the_product_of_gaussians() -> None:
    """North 4 m and 3 m, east 2 m and 6 m: means and variances by the textbook, each axis for itself."""
    opinion = SecondOpinion(WITHOUT_COMMON)
    opinion.begin(np.diag([16.0, 4.0]))

    found = see(opinion, gaussian((5.0, -8.0), (3.0, 6.0)))

    assert_allclose(found.displacement_ne_m, [5.0 * 16 / 25, -8.0 * 4 / 40], atol=0.02)
    assert_allclose(found.cov_ne_m2, np.diag([16.0 * 9 / 25, 4.0 * 36 / 40]), atol=0.05)


def test_the_way_makes_it_unsure_by_what_odometry_strays() -> None:
    config = SecondOpinionConfig(leak=0.0, common_std_m=1e-3, drift_share=0.05, drift_alike_m=40.0)
    opinion = SecondOpinion(config)
    opinion.begin(np.diag([4.0, 4.0]))

    found = see(opinion, np.ones_like(NORTH), way_m=90.0)

    assert_allclose(found.cov_ne_m2, np.eye(2) * (4.0 + 0.05**2 * 40.0 * 90.0), rtol=0.02, atol=1e-6)


def test_it_stays_where_it_is_when_the_estimate_moves() -> None:
    opinion = SecondOpinion(WITHOUT_COMMON)
    opinion.begin(np.eye(2) * 9.0)
    see(opinion, gaussian((6.0, -3.0), (1.5, 1.5)))
    before = opinion.opinion()
    assert before is not None

    opinion.corrected(np.array([2.5, 1.25]))

    after = opinion.opinion()
    assert after is not None
    assert_allclose(after.displacement_ne_m, before.displacement_ne_m - (2.5, 1.25), atol=0.02)


def test_sure_pictures_of_another_place_prevail_and_unsure_ones_do_not() -> None:
    """Ten pictures 12 m off: with a twentieth anywhere they take over, with nine tenths they hardly count."""
    opinions = {}
    for floor in (0.05, 0.9):
        opinion = SecondOpinion()
        opinion.begin(np.eye(2))
        for _ in range(10):
            see(opinion, gaussian((12.0, 0.0), (1.0, 1.0), floor), way_m=10.0)
            # every picture shows the true place as well
            see(opinion, gaussian((0.0, 0.0), (1.0, 1.0), 0.5 if floor > 0.5 else 1.0), way_m=10.0)
        opinions[floor] = opinion.opinion()
    sure, unsure = opinions[0.05], opinions[0.9]
    assert sure is not None and unsure is not None
    assert_allclose(sure.displacement_ne_m, [12.0, 0.0], atol=0.3)
    assert sure.sigmas > 4.0
    assert sure.size_m == pytest.approx(12.0, abs=0.3)
    assert unsure.sigmas < 0.5


def test_pictures_of_the_estimates_own_place_leave_no_doubt() -> None:
    opinion = SecondOpinion()
    opinion.begin(np.eye(2) * 4.0)
    for _ in range(30):
        found = see(opinion, gaussian((0.4, -0.3), (1.0, 1.0), 0.3), way_m=5.0, fresh=0.3)
    assert found.sigmas < 0.5


def test_before_it_has_begun_and_after_it_was_forgotten_there_is_none() -> None:
    opinion = SecondOpinion()
    opinion.see(np.ones((3, 3)), 1.0, -1.0, 1.0, 0.0)
    opinion.corrected(np.ones(2))
    assert opinion.opinion() is None
    opinion.begin(np.eye(2))
    assert opinion.begun
    opinion.forget()
    assert not opinion.begun
