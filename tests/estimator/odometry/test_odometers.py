"""Every odometer against the same outside truth: points on known ground seen from known places."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.odometry.odometers import ODOMETERS, odometer
from estimator.odometry.planar import DisplacementResidual

FIRST = np.array([0.0, 0.0, -100.0])
SECOND = np.array([6.0, -4.0, -99.0])
PIXEL_RAD = 5e-4
METHODS = sorted(ODOMETERS)


def flat(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
    return np.zeros_like(north_m)


def sloped(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
    """A tenth down to the north."""
    return 0.1 * north_m + 0.0 * east_m


def ground(count: int, seed: int, down_at=flat) -> np.ndarray:
    north, east = np.random.default_rng(seed).uniform(-45.0, 45.0, size=(2, count))
    return np.stack((north, east, down_at(north, east)), axis=-1)


def rays(points: np.ndarray, origin: np.ndarray, noise_rad: float = 0.0, rng=None) -> np.ndarray:
    seen = points - origin
    seen = seen / seen[:, 2:]
    if rng is not None:
        seen[:, :2] += rng.normal(0.0, noise_rad, size=(len(seen), 2))
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)


def residual(
    method: str, first: np.ndarray, second: np.ndarray, predicted=SECOND, down_at=flat, relative_std: float = 0.0
) -> DisplacementResidual:
    found = odometer(method)(first, second, FIRST, predicted, down_at, PIXEL_RAD, relative_std)
    assert found is not None
    return found


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("error_ne_m", [(0.0, 0.0), (1.5, 0.0), (-2.0, 3.0)])
def test_wrong_displacement_comes_back_with_its_sign(method: str, error_ne_m: tuple[float, float]) -> None:
    points = ground(80, 1)
    found = residual(method, rays(points, FIRST), rays(points, SECOND), SECOND + np.array([*error_ne_m, 0.0]))

    to_truth = np.linalg.solve(found.by_pos_second[:, :2], -found.residual_ne_m)
    # a centimetre: the homography is solved in single steps
    assert_allclose(to_truth, -np.array(error_ne_m), atol=0.01)
    assert found.inlier_fraction == 1.0


def test_a_homography_knows_slopes_and_a_single_depth_does_not() -> None:
    points = ground(80, 2, sloped) + np.array([20.0, 0.0, 2.0])
    first, second = rays(points, FIRST), rays(points, SECOND)
    missed = {name: np.hypot(*residual(name, first, second, down_at=sloped).residual_ne_m) for name in METHODS}

    assert missed["homography"] < 0.01
    # ground 2 m lower on the average makes 2 % of 7.2 m
    assert missed["depth_average"] == pytest.approx(0.02 * np.hypot(6.0, 4.0), rel=0.4)


def test_outliers_pull_the_mean_and_nothing_else() -> None:
    """Fault: a fifth of the tracks follow something that moved by 14 m."""
    points = ground(100, 3)
    moved = points.copy()
    moved[:20] += np.array([8.0, 11.0, 0.0])
    missed = {
        name: np.hypot(*residual(name, rays(points, FIRST), rays(moved, SECOND)).residual_ne_m) for name in METHODS
    }

    assert missed["rays"] < 0.02
    assert missed["homography"] < 0.02
    assert missed["depth_average"] == pytest.approx(0.2 * np.hypot(8.0, 11.0), rel=0.02)


@pytest.mark.parametrize("method", METHODS)
def test_jacobians_agree_with_finite_differences(method: str) -> None:
    """By rotations of either camera about the NED axes, by either position, by the ground."""
    points = ground(200, 4)
    first, second = rays(points, FIRST), rays(points, SECOND)
    base = residual(method, first, second)

    def by(turn_first=(0.0, 0.0, 0.0), turn_second=(0.0, 0.0, 0.0), first_m=FIRST, second_m=SECOND, lower_m=0.0):
        turned = [
            seen @ matrix_from_q(q_from_rotvec(np.array(turn))).T
            for seen, turn in ((first, turn_first), (second, turn_second))
        ]
        found = odometer(method)(*turned, first_m, second_m, lambda n, _: np.full_like(n, lower_m), PIXEL_RAD, 0.0)
        assert found is not None
        return found.residual_ne_m - base.residual_ne_m

    step = 1e-4
    for axis in range(3):
        turn = np.eye(3)[axis] * step
        # of a lever of 100 m; what the motion, 7 m, adds is left out where the lever is taken straight down
        assert_allclose(by(turn_first=turn) / step, base.by_rotation_first[:, axis], atol=2.5)
        assert_allclose(by(turn_second=turn) / step, base.by_rotation_second[:, axis], atol=2.5)
    for axis in range(2):
        move = np.eye(3)[axis] * 0.01
        assert_allclose(by(first_m=FIRST + move) / 0.01, base.by_pos_first[:, axis], atol=0.02)
        assert_allclose(by(second_m=SECOND + move) / 0.01, base.by_pos_second[:, axis], atol=0.02)
    assert_allclose(by(lower_m=0.1) / 0.1, base.by_ground[:, 0], atol=0.005)


@pytest.mark.parametrize("method", METHODS)
def test_errors_match_the_stated_covariance(method: str) -> None:
    """Independent pixel noise alone; errors that neighbours share are allowed for besides."""
    squares = []
    for seed in range(200):
        rng = np.random.default_rng(1000 + seed)
        points = ground(60, seed)
        found = residual(method, rays(points, FIRST, PIXEL_RAD, rng), rays(points, SECOND, PIXEL_RAD, rng))
        squares.append(found.residual_ne_m @ np.linalg.solve(found.cov_m2, found.residual_ne_m))

    # a third of the tracks counted, and a floor of a centimetre; the plain mean counts all and has its floor twice
    assert 0.3 < np.mean(squares) < 2.2


def test_noise_falls_with_the_number_of_tracks_and_rises_with_their_noise() -> None:
    """Conte 2009, figure 5.6: translation noise of the homography at unit depth over features and pixel noise."""

    def std(count: int, noise_rad: float) -> float:
        found = []
        for seed in range(120):
            rng = np.random.default_rng(seed)
            points = ground(count, seed)
            seen = rays(points, FIRST, noise_rad, rng), rays(points, FIRST, noise_rad, rng)
            result = odometer("homography")(*seen, FIRST, FIRST, flat, noise_rad, 0.0)
            if result is not None:
                found.append(result.residual_ne_m[0] / 100.0)
        return float(np.std(found))

    assert std(50, 1e-3) < std(20, 1e-3)
    # linear in the noise
    assert std(50, 2e-3) == pytest.approx(2.0 * std(50, 1e-3), rel=0.25)


@pytest.mark.parametrize("method", METHODS)
def test_what_cannot_be_said_is_not_said(method: str) -> None:
    points = ground(60, 6)
    first, second = rays(points, FIRST), rays(points, SECOND)
    sideways = np.roll(first, 1, axis=1)

    def nowhere(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.full_like(north_m, np.nan)

    assert odometer(method)(first[:5], second[:5], FIRST, SECOND, flat, PIXEL_RAD, 0.0) is None
    assert odometer(method)(sideways * [1, 1, 0.1], second, FIRST, SECOND, flat, PIXEL_RAD, 0.0) is None
    assert odometer(method)(first, second, FIRST, SECOND, nowhere, PIXEL_RAD, 0.0) is None
    # below the ground
    assert odometer(method)(first, second, -FIRST, -SECOND, flat, PIXEL_RAD, 0.0) is None


def test_an_unknown_odometer_is_named_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="rays, homography, depth_average"):
        odometer("optical_flow")
