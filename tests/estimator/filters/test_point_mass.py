import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.point_mass import Moments, PointMassConfig, PointMassFilter, information_increment

CONFIG = PointMassConfig(cell_m=0.5)
MEAN = np.array([120.25, -40.5])


def _gaussian(pmf: PointMassFilter, mean_ne_m: np.ndarray, cov_ne_m2: np.ndarray) -> np.ndarray:
    """A Gaussian likelihood of mean one on the filter's own grid."""
    rows, cols = pmf.density.shape
    north = pmf.north_max_m - pmf.cell_m * np.arange(rows)
    east = pmf.east_min_m + pmf.cell_m * np.arange(cols)
    offset = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1) - mean_ne_m
    values = np.exp(-0.5 * np.einsum("...i,ij,...j->...", offset, np.linalg.inv(cov_ne_m2), offset))
    return values / values.mean()


def test_starts_as_the_gaussian_asked_for() -> None:
    cov = np.array([[16.0, 6.0], [6.0, 9.0]])

    moments = PointMassFilter(MEAN, cov, CONFIG).moments()

    assert_allclose(moments.mean_ne_m, MEAN, atol=1e-3)
    # cut off at five sigmas
    assert_allclose(moments.cov_ne_m2, cov, atol=0.05)


def test_large_uncertainty_makes_cells_coarser_not_more() -> None:
    pmf = PointMassFilter(MEAN, np.eye(2) * 200.0**2, CONFIG)

    assert max(pmf.density.shape) <= CONFIG.max_cells + 2
    assert_allclose(np.sqrt(np.diag(pmf.moments().cov_ne_m2)), 200.0, rtol=0.01)


def test_move_carries_the_mean_and_leaves_the_spread() -> None:
    pmf = PointMassFilter(MEAN, np.diag([9.0, 4.0]), CONFIG)

    pmf.predict(np.array([7.3, -2.9]), np.zeros((2, 2)))

    moments = pmf.moments()
    assert_allclose(moments.mean_ne_m, MEAN + np.array([7.3, -2.9]), atol=1e-3)
    assert_allclose(np.diag(moments.cov_ne_m2), [9.0, 4.0], atol=0.05)


def test_blur_adds_the_displacement_variance_per_axis() -> None:
    pmf = PointMassFilter(MEAN, np.diag([9.0, 4.0]), CONFIG)

    for _ in range(4):
        pmf.predict(np.zeros(2), np.diag([2.25, 0.64]))

    assert_allclose(np.diag(pmf.moments().cov_ne_m2), [9.0 + 9.0, 4.0 + 2.56], rtol=0.02)
    assert pmf.density.sum() == pytest.approx(1.0)


def test_grid_stays_bounded_while_uncertainty_grows() -> None:
    pmf = PointMassFilter(MEAN, np.eye(2) * 25.0, CONFIG)

    for _ in range(400):
        pmf.predict(np.array([5.0, 1.0]), np.eye(2) * 4.0)

    assert max(pmf.density.shape) <= CONFIG.max_cells
    moments = pmf.moments()
    assert_allclose(moments.mean_ne_m, MEAN + np.array([2000.0, 400.0]), atol=2.0)
    # 25 + 400 * 4; borders below 1e-7 are cut, and coarser cells interpolate
    assert_allclose(np.diag(moments.cov_ne_m2), 1625.0, rtol=0.05)


def test_update_is_the_product_of_gaussians() -> None:
    prior_cov, cov = np.diag([25.0, 16.0]), np.array([[4.0, 1.0], [1.0, 9.0]])
    pmf = PointMassFilter(MEAN, prior_cov, CONFIG)
    at = MEAN + np.array([3.0, -2.0])

    pmf.update(_gaussian(pmf, at, cov), pmf.north_max_m, pmf.east_min_m)

    information = np.linalg.inv(prior_cov) + np.linalg.inv(cov)
    expected = np.linalg.solve(information, np.linalg.solve(prior_cov, MEAN) + np.linalg.solve(cov, at))
    assert_allclose(pmf.moments().mean_ne_m, expected, atol=0.01)
    assert_allclose(pmf.moments().cov_ne_m2, np.linalg.inv(information), atol=0.05)


def test_likelihood_on_a_shifted_grid_means_the_same() -> None:
    """The likelihood's grid begins elsewhere and off the filter's cells; only places count, not indices."""
    here = PointMassFilter(MEAN, np.eye(2) * 9.0, CONFIG)
    there = PointMassFilter(MEAN, np.eye(2) * 9.0, CONFIG)
    other = PointMassFilter(MEAN + np.array([1.35, -0.85]), np.eye(2) * 16.0, CONFIG)
    at, cov = MEAN + np.array([2.0, 1.0]), np.eye(2) * 2.0

    here.update(_gaussian(here, at, cov), here.north_max_m, here.east_min_m)
    there.update(_gaussian(other, at, cov), other.north_max_m, other.east_min_m)

    assert_allclose(there.moments().mean_ne_m, here.moments().mean_ne_m, atol=0.03)
    # linear interpolation between cells adds up to a quarter of a cell squared
    assert_allclose(there.moments().cov_ne_m2, here.moments().cov_ne_m2, atol=0.08)


def test_unimodality_tells_one_mode_from_two() -> None:
    pmf = PointMassFilter(MEAN, np.eye(2) * 100.0, CONFIG)
    one = _gaussian(pmf, MEAN + np.array([5.0, 0.0]), np.eye(2))
    two = 0.6 * one + 0.4 * _gaussian(pmf, MEAN - [5.0, 20.0], np.eye(2))
    start = pmf.density.copy()

    pmf.update(one, pmf.north_max_m, pmf.east_min_m)
    single = pmf.unimodality()
    pmf.density = start
    pmf.update(two, pmf.north_max_m, pmf.east_min_m)

    assert single > 0.98
    assert 0.5 < pmf.unimodality() < 0.95


def _ridge(length_m: float, width_m: float, bearing_rad: float) -> np.ndarray:
    cos, sin = np.cos(bearing_rad), np.sin(bearing_rad)
    axes = np.array([[cos, -sin], [sin, cos]])
    return axes @ np.diag([length_m**2, width_m**2]) @ axes.T


@pytest.mark.parametrize("bearing_deg", [0.0, 35.0, 90.0, 160.0])
def test_elongated_ridge_is_one_mode(bearing_deg: float) -> None:
    """A road: twelve metres along it, seven tenths across, at any bearing. 3.7 sigma hold 0.999 of a Gaussian."""
    pmf = PointMassFilter(MEAN, np.eye(2) * 20.0**2, CONFIG)

    pmf.update(
        _gaussian(pmf, MEAN + np.array([2.0, -3.0]), _ridge(12.0, 0.7, np.deg2rad(bearing_deg))),
        pmf.north_max_m,
        pmf.east_min_m,
    )

    assert pmf.unimodality() > 0.99


@pytest.mark.parametrize("std_m", [0.1, 0.5, 8.0])
def test_gaussian_of_any_width_is_one_mode(std_m: float) -> None:
    """Also one of a single cell."""
    assert PointMassFilter(MEAN, np.eye(2) * std_m**2, CONFIG).unimodality() > 0.99


@pytest.mark.parametrize("share", [0.5, 0.3, 0.1])
def test_separate_peaks_are_not_one_mode(share: float) -> None:
    """The share of the second is missing, whichever way it lies."""
    pmf = PointMassFilter(MEAN, np.eye(2) * 100.0, CONFIG)
    for away in (np.array([12.0, 0.0]), np.array([0.0, -12.0]), np.array([8.0, 9.0])):
        one, two = (
            PointMassFilter(MEAN, np.eye(2) * 100.0, CONFIG).density * _gaussian(pmf, at, np.eye(2))
            for at in (MEAN - 0.5 * away, MEAN + 0.5 * away)
        )
        pmf.density = (1.0 - share) * one / one.sum() + share * two / two.sum()

        assert pmf.unimodality() == pytest.approx(1.0 - share, abs=0.01)


def test_parallel_ridges_are_not_one_mode() -> None:
    """Two roads beside each other, fifteen metres apart: each is a mode, together they are not."""
    pmf = PointMassFilter(MEAN, np.eye(2) * 15.0**2, CONFIG)
    along = _ridge(12.0, 0.8, np.deg2rad(70.0))
    across = 15.0 * np.array([-np.sin(np.deg2rad(70.0)), np.cos(np.deg2rad(70.0))])

    pmf.update(
        _gaussian(pmf, MEAN + 0.5 * across, along) + 0.8 * _gaussian(pmf, MEAN - 0.5 * across, along),
        pmf.north_max_m,
        pmf.east_min_m,
    )

    assert 0.5 < pmf.unimodality() < 0.6


def test_mode_is_the_highest_place_and_not_the_mean() -> None:
    pmf = PointMassFilter(MEAN, np.eye(2) * 400.0, CONFIG)
    high, low = MEAN + np.array([9.0, 4.0]), MEAN - np.array([6.0, 11.0])

    pmf.update(
        _gaussian(pmf, high, np.eye(2)) + 0.6 * _gaussian(pmf, low, np.eye(2) * 4.0), pmf.north_max_m, pmf.east_min_m
    )
    pmf.predict(np.array([3.0, -2.0]), np.zeros((2, 2)))

    # half a cell, and the prior of 20 m pulls by a few centimetres
    assert_allclose(pmf.mode_ne_m(), high + np.array([3.0, -2.0]), atol=0.3)
    assert np.hypot(*(pmf.moments().mean_ne_m - pmf.mode_ne_m())) > 4.0


def test_two_modes_survive_until_a_picture_decides() -> None:
    """After an ambiguous update the mean lies between the modes; the next likelihood must find both still there."""
    pmf = PointMassFilter(MEAN, np.eye(2) * 225.0, CONFIG)
    near, far = MEAN + np.array([0.0, 6.0]), MEAN - [0.0, 18.0]
    ambiguous = _gaussian(pmf, near, np.eye(2)) + _gaussian(pmf, far, np.eye(2))
    pmf.update(ambiguous, pmf.north_max_m, pmf.east_min_m)
    pmf.predict(np.array([10.0, 0.0]), np.eye(2) * 0.25)

    pmf.update(_gaussian(pmf, far + np.array([10.0, 0.0]), np.eye(2)), pmf.north_max_m, pmf.east_min_m)

    assert pmf.unimodality() > 0.95
    assert_allclose(pmf.moments().mean_ne_m, far + np.array([10.0, 0.0]), atol=0.3)


def test_information_increment_returns_the_gaussian_measurement() -> None:
    prior_cov, cov = np.array([[30.0, 8.0], [8.0, 12.0]]), np.array([[3.0, -1.0], [-1.0, 2.0]])
    at = MEAN + np.array([4.0, 3.0])
    information = np.linalg.inv(prior_cov) + np.linalg.inv(cov)
    posterior_mean = np.linalg.solve(information, np.linalg.solve(prior_cov, MEAN) + np.linalg.solve(cov, at))

    increment = information_increment(Moments(MEAN, prior_cov), Moments(posterior_mean, np.linalg.inv(information)))

    assert increment is not None
    assert_allclose(increment.position_ne_m, at, rtol=1e-9)
    assert_allclose(increment.cov_ne_m2, cov, rtol=1e-9)


def test_information_increment_of_a_density_is_the_measurement() -> None:
    """The same through the grid: handing on the increment to a filter with the prior gives the grid's posterior."""
    pmf = PointMassFilter(MEAN, np.diag([36.0, 25.0]), CONFIG)
    prior = pmf.moments()
    at, cov = MEAN + np.array([2.5, -4.0]), np.array([[4.0, 1.5], [1.5, 5.0]])
    pmf.update(_gaussian(pmf, at, cov), pmf.north_max_m, pmf.east_min_m)

    increment = information_increment(prior, pmf.moments())

    assert increment is not None
    # the grid's cells are half a metre
    assert_allclose(increment.position_ne_m, at, atol=0.05)
    assert_allclose(increment.cov_ne_m2, cov, atol=0.1)


def test_information_increment_along_one_direction_only() -> None:
    """A road seen along its course: north is measured, east keeps a useless variance."""
    prior_cov = np.eye(2) * 16.0

    increment = information_increment(
        Moments(MEAN, prior_cov), Moments(MEAN + np.array([1.0, 0.0]), np.diag([1.0, 16.0]))
    )

    assert increment is not None
    assert increment.cov_ne_m2[0, 0] == pytest.approx(16.0 / 15.0)
    assert increment.cov_ne_m2[1, 1] >= 1e5


def test_no_information_gives_no_increment() -> None:
    prior = Moments(MEAN, np.eye(2) * 4.0)

    assert information_increment(prior, prior) is None
    assert information_increment(prior, Moments(MEAN, np.eye(2) * 9.0)) is None


def test_lost_probability_rises_where_the_picture_speaks_against_the_density() -> None:
    """
    Fault: the likelihood sees nothing in the whole region of the density, its match lies beyond it.
    Expected: the probability to be elsewhere grows towards one, and falls again with matches inside.
    """
    pmf = PointMassFilter(MEAN, np.eye(2) * 4.0, CONFIG)
    flat = np.full((61, 61), 0.02)
    history = []
    for _ in range(5):
        pmf.update(flat, MEAN[0] + 15.0, MEAN[1] - 15.0)
        history.append(pmf.lost_probability)
    assert np.all(np.diff(history) > 0.0)
    assert history[0] < 0.1
    assert history[-1] > 0.9

    for _ in range(6):
        pmf.update(_gaussian(pmf, MEAN, np.eye(2)), pmf.north_max_m, pmf.east_min_m)

    assert pmf.lost_probability < 0.05


def test_flat_likelihood_teaches_no_position() -> None:
    """A likelihood of one everywhere: density and mean stay, lost rises by the leak alone."""
    pmf = PointMassFilter(MEAN, np.eye(2) * 4.0, CONFIG)
    before = pmf.moments()

    pmf.update(np.ones(pmf.density.shape), pmf.north_max_m, pmf.east_min_m)

    assert_allclose(pmf.moments().mean_ne_m, before.mean_ne_m, atol=1e-9)
    assert_allclose(pmf.moments().cov_ne_m2, before.cov_ne_m2, atol=1e-9)
    assert pmf.lost_probability == pytest.approx(CONFIG.lost_leak)
