import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.ports import Correlation
from estimator.registration.likelihood import LikelihoodCalibration, likelihood, log_ratio

CALIBRATION = LikelihoodCalibration(effective_fraction=0.1, map_std_m=0.5, map_std_px=0.0, floor=0.01)


def _correlation(
    peak_ne_m: tuple[float, float], width_m: float, height: float = 0.8, step_m: float = 1.0
) -> Correlation:
    """A single smooth peak on a surface of +-20 m."""
    north, east = 20.0 - np.arange(41.0), -20.0 + np.arange(41.0)
    distance2 = (north[:, None] - peak_ne_m[0]) ** 2 + (east[None] - peak_ne_m[1]) ** 2
    surface = (0.8 * np.exp(-0.5 * distance2 / width_m**2)).astype(np.float32)
    return Correlation(surface, 20.0, -20.0, 1.0, 10_000)


def _moments(
    values: np.ndarray, north_max_m: float, east_min_m: float, step_m: float, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    inlier = values - floor
    inlier = inlier / inlier.sum()
    north = north_max_m - step_m * np.arange(values.shape[0])
    east = east_min_m + step_m * np.arange(values.shape[1])
    mean = np.array([inlier.sum(axis=1) @ north, inlier.sum(axis=0) @ east])
    var = np.array([inlier.sum(axis=1) @ (north - mean[0]) ** 2, inlier.sum(axis=0) @ (east - mean[1]) ** 2])
    return mean, var


def test_log_ratio_of_known_values() -> None:
    """-n/2 log(1 - C^2): 50 samples at C = 0.6 give -25 log 0.64; anticorrelation and unknown give nothing."""
    ratio = log_ratio(np.array([0.6, 0.0, -0.9, np.nan]), 50.0)

    assert_allclose(ratio, [-25.0 * np.log(0.64), 0.0, 0.0, 0.0])
    assert np.isfinite(log_ratio(np.array([1.0]), 1e4)).all()


@pytest.mark.parametrize("step_m", [0.25, 0.5, 1.0])
def test_peak_lies_where_the_similarity_does(step_m: float) -> None:
    """North is up and east is right, at any resampling."""
    values, north_max, east_min = likelihood(_correlation((6.0, -9.0), 2.0), CALIBRATION, 0.02, step_m)

    row, col = np.unravel_index(np.argmax(values), values.shape)
    assert north_max - row * step_m == pytest.approx(6.0, abs=0.5 * step_m)
    assert east_min + col * step_m == pytest.approx(-9.0, abs=0.5 * step_m)
    assert values.mean() == pytest.approx(1.0, rel=1e-6)
    mean, _ = _moments(values, north_max, east_min, step_m, 0.02)
    assert_allclose(mean, [6.0, -9.0], atol=0.05)


def test_off_the_peak_the_outlier_probability_remains() -> None:
    values, _, _ = likelihood(_correlation((0.0, 0.0), 2.0), CALIBRATION, 0.2, 0.5)

    assert values.min() == pytest.approx(0.2, abs=1e-6)


def test_floor_bounds_the_certainty() -> None:
    values, _, _ = likelihood(_correlation((0.0, 0.0), 2.0), CALIBRATION, 0.0, 0.5)

    assert values.min() == pytest.approx(CALIBRATION.floor, abs=1e-6)


def test_maps_own_error_widens_the_peak() -> None:
    """A sharp peak keeps at least the map's variance; a map error of 2 m adds 4 m2 to it."""
    sharp = _correlation((0.0, 0.0), 1.5)
    wide = LikelihoodCalibration(effective_fraction=0.1, map_std_m=2.0, map_std_px=0.0)

    _, var = _moments(*likelihood(sharp, CALIBRATION, 0.01, 0.25), 0.25, 0.01)
    _, var_wide = _moments(*likelihood(sharp, wide, 0.01, 0.25), 0.25, 0.01)

    # the blur's kernel ends at four sigmas and loses a thousandth
    assert (var > 0.99 * 0.25).all()
    assert_allclose(var_wide - var, 4.0 - 0.25, rtol=0.03)


def test_tempering_widens_by_its_weight_and_leaves_the_floor() -> None:
    """A picture counted for a quarter has four times the variance, and the same chance of being wrong."""
    full = likelihood(_correlation((0.0, 0.0), 4.0), CALIBRATION, 0.05, 0.25)
    quarter = likelihood(_correlation((0.0, 0.0), 4.0), CALIBRATION, 0.05, 0.25, weight=0.25)

    _, var = _moments(*full, 0.25, 0.05)
    _, var_quarter = _moments(*quarter, 0.25, 0.05)
    assert_allclose(var_quarter / var, 4.0, rtol=0.1)
    assert quarter[0].min() == pytest.approx(0.05, abs=1e-4)


def test_unknown_map_gets_no_more_than_the_floor() -> None:
    correlation = _correlation((0.0, 0.0), 2.0)
    surface = correlation.surface.copy()
    surface[:, :8] = np.nan

    values, _, _ = likelihood(Correlation(surface, 20.0, -20.0, 1.0, 10_000), CALIBRATION, 0.05, 1.0)

    assert np.isfinite(values).all()
    assert_allclose(values[:, :7], 0.05, atol=1e-6)


def test_featureless_surface_gives_a_flat_likelihood() -> None:
    blank = Correlation(np.full((31, 31), 0.2, dtype=np.float32), 15.0, -15.0, 1.0, 10_000)

    values, _, _ = likelihood(blank, CALIBRATION, 0.3, 0.5)

    # away from the rim, where the blur reaches past the surface
    assert_allclose(values[6:-6, 6:-6], 1.0, atol=0.05)
