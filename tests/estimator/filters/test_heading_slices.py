"""Slices over heading against brute-force Bayes in numpy, and against Gaussians."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.heading_slices import HeadingSlices
from estimator.filters.point_mass import Moments, PointMassConfig, information_increment

CONFIG = PointMassConfig(cell_m=0.5, lost_leak=0.0)
HEADINGS = np.radians(np.arange(-10.0, 10.1, 2.0))
MEAN = np.array([100.0, -50.0])
# the heading was wrong for 60 m of flight to the north: it drove the place east with it
COV = np.array([[6.0, 0.0, 0.0], [0.0, 6.0 + (60.0 * 0.08) ** 2, 60.0 * 0.08**2], [0.0, 60.0 * 0.08**2, 0.08**2]])
STEP = np.array([30.0, 8.0])
STEP_COV = np.diag([1.0, 0.49])


def _likelihood(north: np.ndarray, east: np.ndarray, heading: float) -> np.ndarray:
    """Two places that pictures confuse, the one at another heading; neither is Gaussian."""
    first = np.exp(-0.5 * (((north - 104.0) / 1.5) ** 2 + ((east + 44.0) / 2.5) ** 2 + ((heading - 0.09) / 0.05) ** 2))
    second = np.exp(-0.5 * (((north - 96.0) / 3.0) ** 2 + ((east + 58.0) / 1.5) ** 2 + ((heading + 0.05) / 0.06) ** 2))
    return 40.0 * first + 25.0 * second + 0.2


def _second(north: np.ndarray, east: np.ndarray, heading: float) -> np.ndarray:
    """After the move: a ridge along a road, which a heading goes with."""
    return 9.0 * np.exp(-0.5 * ((0.6 * (north - 133.0) - 0.8 * (east + 33.0)) / 3.0) ** 2 - (heading / 0.1) ** 2) + 0.1


def _offer(slices: HeadingSlices, function) -> None:
    north, east = 180.0 - 0.5 * np.arange(301), -130.0 + 0.5 * np.arange(321)
    values = [function(north[:, None], east[None], h) for h in slices.headings_rad]
    slices.update(values, 180.0, -130.0, 0.5)


class BruteForce:
    """Bayes' rule on a fixed lattice of half metres, every move summed over all places it can come from."""

    def __init__(self) -> None:
        self.n, self.e = np.arange(60.0, 180.0, 0.5), np.arange(-120.0, 20.0, 0.5)
        at = np.stack(np.meshgrid(self.n, self.e, HEADINGS, indexing="ij"), axis=-1) - [*MEAN, 0.0]
        self.p = np.exp(-0.5 * np.einsum("...i,ij,...j->...", at, np.linalg.inv(COV), at))
        self.p /= self.p.sum()

    def move(self) -> None:
        for k, heading in enumerate(HEADINGS):
            cos, sin = np.cos(heading), np.sin(heading)
            by = np.array([cos * STEP[0] - sin * STEP[1], sin * STEP[0] + cos * STEP[1]])
            kernels = [
                np.exp(-0.5 * (axis[:, None] - axis[None] - d) ** 2 / var)
                for axis, d, var in zip((self.n, self.e), by, np.diag(STEP_COV), strict=True)
            ]
            self.p[:, :, k] = kernels[0] @ self.p[:, :, k] @ kernels[1].T
        self.p /= self.p.sum()

    def update(self, function) -> float:
        values = np.stack([function(self.n[:, None], self.e[None], h) for h in HEADINGS], axis=-1)
        evidence = float((self.p * values).sum())
        self.p = self.p * values / evidence
        return evidence

    def moments(self) -> Moments:
        at = np.stack(np.meshgrid(self.n, self.e, HEADINGS, indexing="ij"), axis=-1)
        mean = np.einsum("abc,abci->i", self.p, at)
        return Moments(mean, np.einsum("abc,abci,abcj->ij", self.p, at - mean, at - mean))


def _assert_same(slices: HeadingSlices, brute: BruteForce) -> None:
    found, true = slices.moments(), brute.moments()
    assert_allclose(slices.probabilities, brute.p.sum(axis=(0, 1)), atol=0.005)
    # a tenth of a cell; linear interpolation between the lattices blurs by a fraction of a cell
    assert_allclose(found.mean_ne_m, true.mean_ne_m, atol=0.05)
    std = np.sqrt(np.diag(found.cov_ne_m2) - [0.0, 0.0, (HEADINGS[1] - HEADINGS[0]) ** 2 / 12.0])
    assert_allclose(std, np.sqrt(np.diag(true.cov_ne_m2)), rtol=0.03)
    assert_allclose(found.cov_ne_m2[:2, 2], true.cov_ne_m2[:2, 2], atol=0.01)


def test_density_follows_brute_force_bayes() -> None:
    slices, brute = HeadingSlices(MEAN, COV, HEADINGS, CONFIG), BruteForce()
    _assert_same(slices, brute)

    _offer(slices, _likelihood)
    brute.update(_likelihood)
    _assert_same(slices, brute)
    marginal = slices.marginal()
    peak = np.unravel_index(np.argmax(brute.p.sum(axis=2)), brute.p.shape[:2])
    assert_allclose(marginal.mode_ne_m(), [brute.n[peak[0]], brute.e[peak[1]]], atol=1.0)

    slices.predict(STEP, STEP_COV)
    brute.move()
    _assert_same(slices, brute)

    _offer(slices, _second)
    brute.update(_second)
    _assert_same(slices, brute)


def test_gaussian_pictures_give_the_kalman_posterior() -> None:
    """A picture that measures place and heading together: the increment is that measurement, in all three axes."""
    headings = np.radians(np.arange(-24.0, 24.1, 1.0))
    R = np.array([[2.0, 0.3, 0.0], [0.3, 3.0, 0.04], [0.0, 0.04, 0.04**2]])
    z = np.array([MEAN[0] + 2.0, MEAN[1] + 5.0, 0.06])

    def picture(north: np.ndarray, east: np.ndarray, heading: float) -> np.ndarray:
        at = np.stack(np.broadcast_arrays(north - z[0], east - z[1], heading - z[2]), axis=-1)
        return 50.0 * np.exp(-0.5 * np.einsum("...i,ij,...j->...", at, np.linalg.inv(R), at))

    slices = HeadingSlices(MEAN, COV, headings, CONFIG)
    _offer(slices, picture)
    gain = COV @ np.linalg.inv(COV + R)
    mean = np.array([*MEAN, 0.0]) + gain @ (z - [*MEAN, 0.0])
    cov = COV - gain @ COV

    found = slices.moments()
    assert_allclose(found.mean_ne_m, mean, atol=0.03)
    assert_allclose(np.sqrt(np.diag(found.cov_ne_m2)), np.sqrt(np.diag(cov)), rtol=0.03)
    increment = information_increment(Moments(np.array([*MEAN, 0.0]), COV), found)
    assert increment is not None
    assert_allclose(increment.position_ne_m, z, atol=0.4)
    assert_allclose(np.sqrt(np.diag(increment.cov_ne_m2)), np.sqrt(np.diag(R)), rtol=0.12)


def test_wrong_headings_fail_by_the_way_they_are_carried() -> None:
    """Pictures that say nothing of the heading themselves tell it by where it led."""
    slices = HeadingSlices(MEAN, np.diag([1.0, 1.0, 0.08**2]), HEADINGS, CONFIG)
    true_heading = HEADINGS[8]
    cos, sin = np.cos(true_heading), np.sin(true_heading)
    place = MEAN.copy()

    for _ in range(3):
        place = place + np.array([cos * 20.0, sin * 20.0])
        slices.predict(np.array([20.0, 0.0]), np.eye(2) * 0.04)

        def seen(north: np.ndarray, east: np.ndarray, heading: float, at: np.ndarray = place) -> np.ndarray:
            return 30.0 * np.exp(-0.5 * ((north - at[0]) ** 2 + (east - at[1]) ** 2) / 1.5**2) + 0.05

        _offer(slices, seen)

    assert slices.headings_rad[int(np.argmax(slices.probabilities))] == true_heading
    assert_allclose(slices.moments().mean_ne_m[:2], place, atol=1.0)
    assert slices.unimodality() > 0.95


def test_picture_that_fits_no_slice_makes_lost() -> None:
    slices = HeadingSlices(MEAN, np.diag([4.0, 4.0, 0.01]), HEADINGS, PointMassConfig(lost_leak=1e-3))
    for _ in range(3):
        # mean one over the surface, its peak far beyond the density
        _offer(slices, lambda n, e, h: np.where((n > 170.0) & (e < -100.0), 60.0, 0.02) * np.ones_like(n + e))

    assert slices.lost_probability > 0.9
    assert slices.probabilities.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("headings", "variance"), [(np.zeros(1), 0.01), (HEADINGS, 0.0)])
def test_a_heading_that_is_certain_needs_no_slices(headings: np.ndarray, variance: float) -> None:
    with pytest.raises(ValueError, match="at least two headings"):
        HeadingSlices(MEAN, np.diag([1.0, 1.0, variance]), headings, CONFIG)
