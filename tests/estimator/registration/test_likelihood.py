from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.ports import Correlation
from estimator.registration.likelihood import (
    LikelihoodCalibration,
    LikelihoodForm,
    likelihood,
    likelihoods,
    log_matched,
)
from estimator.registration.verify import Peak, find_peak

CALIBRATION = LikelihoodCalibration(temperature=0.5, power=1.0, map_std_m=0.5, map_std_px=0.0, floor=0.01, doubt=1.0)
CLUTTER = 0.1


def _correlation(
    peak_ne_m: tuple[float, float], width_m: float | tuple[float, float], step_m: float = 1.0, half_m: float = 20.0
) -> Correlation:
    """A single smooth peak of 0.8 on a surface of +-``half_m``, with its widths to the north and to the east."""
    count = round(2.0 * half_m / step_m) + 1
    north, east = half_m - step_m * np.arange(count), -half_m + step_m * np.arange(count)
    width_n, width_e = np.broadcast_to(width_m, 2)
    exponent = ((north[:, None] - peak_ne_m[0]) / width_n) ** 2 + ((east[None] - peak_ne_m[1]) / width_e) ** 2
    return Correlation((0.8 * np.exp(-0.5 * exponent)).astype(np.float32), half_m, -half_m, step_m, 10_000)


def _peak(value: float = 0.8, clutter_std: float = CLUTTER) -> Peak:
    """The peak of such a surface, as if its surroundings had clutter of that size."""
    return Peak(20.0, 20.0, value, value / clutter_std, 0.3, False, value, clutter_std)


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


def _blurless(temperature: float = 0.5) -> LikelihoodCalibration:
    """A map without errors of its own, to see the similarity's own width."""
    return LikelihoodCalibration(
        temperature=temperature, power=1.0, map_std_m=0.0, map_std_px=0.0, floor=0.01, doubt=1.0
    )


def test_log_likelihood_of_known_values() -> None:
    """t z0 z: a peak of six deviations against places at 0.6, 0 and -0.3 with a clutter of 0.1, tempered by a half."""
    log_p = log_matched(np.array([0.6, 0.0, -0.3]), _peak(0.6), CALIBRATION)

    assert_allclose(log_p, [0.5 * 6.0 * 6.0, 0.0, -0.5 * 6.0 * 3.0])
    assert log_p.dtype == np.float64
    # no clutter at all must not divide by zero
    assert np.isfinite(log_matched(np.array([0.6]), replace(_peak(), clutter_std=0.0), CALIBRATION)).all()


@pytest.mark.parametrize(("power", "sharpness"), [(1.0, 4.0), (0.5, 2.0), (0.0, 1.0), (-0.5, 0.5)])
def test_power_says_how_much_sharper_a_high_peak_is(power: float, sharpness: float) -> None:
    """Peaks of four deviations of a clutter of 0.1; what stands out by less than one is worth its height alone."""
    calibration = replace(CALIBRATION, temperature=1.0, power=power)
    one_deviation = np.array([0.1])

    assert_allclose(log_matched(one_deviation, _peak(0.4), calibration), sharpness)
    assert_allclose(log_matched(one_deviation, _peak(0.03), calibration), 0.3)
    assert_allclose(log_matched(one_deviation, _peak(-0.03), calibration), 0.0)


def test_log_likelihood_is_that_of_a_known_signal_in_gaussian_clutter() -> None:
    """
    The place of a signal c0 in clutter s: log p(c | here) - log p(c | not here) = c0 c / s^2 - c0^2 / 2 s^2.

    Written out from the two Gaussians; the difference between places does not hold the constant.
    """
    c, c0, s = np.array([0.55, 0.4, 0.1]), 0.55, 0.08
    log_ratio = -((c - c0) ** 2) / (2.0 * s**2) + c**2 / (2.0 * s**2)

    log_p = log_matched(c, _peak(c0, s), replace(CALIBRATION, temperature=1.0))

    assert_allclose(log_p - log_p[0], log_ratio - log_ratio[0], rtol=1e-9)


@pytest.mark.parametrize("step_m", [0.25, 0.5, 1.0])
def test_peak_lies_where_the_similarity_does(step_m: float) -> None:
    """North is up and east is right, at any resampling."""
    values, north_max, east_min = likelihood(_correlation((6.0, -9.0), 2.0), _peak(), CALIBRATION, 0.01, step_m)

    row, col = np.unravel_index(np.argmax(values), values.shape)
    assert north_max - row * step_m == pytest.approx(6.0, abs=0.5 * step_m)
    assert east_min + col * step_m == pytest.approx(-9.0, abs=0.5 * step_m)
    assert values.mean() == pytest.approx(1.0, rel=1e-6)
    mean, _ = _moments(values, north_max, east_min, step_m, 0.02)
    assert_allclose(mean, [6.0, -9.0], atol=0.05)


@pytest.mark.parametrize("clutter_std", [0.05, 0.07, 0.1])
def test_width_grows_with_the_clutter(clutter_std: float) -> None:
    """
    Near its top, a bump of height c0 and width w gives -t (c0/s)^2 d^2 / 2 w^2: sigma = w s / (c0 sqrt t).

    Twice the clutter, twice the deviation. The bump is flatter than its parabola further out: 1 / (t z0^2) more.
    """
    width_m = 8.0
    surface = _correlation((0.0, 0.0), width_m, half_m=30.0)

    _, var = _moments(*likelihood(surface, _peak(clutter_std=clutter_std), _blurless(), 0.0, 0.25), 0.25, 0.01)

    z0 = 0.8 / clutter_std
    # the least blur is 0.3 cells of 0.25 m
    expected = width_m**2 / (0.5 * z0**2) + (0.3 * 0.25) ** 2
    assert_allclose(var, expected, rtol=0.03 + 3.0 / (0.5 * z0**2))


def test_temperature_and_clutter_trade_as_the_square() -> None:
    """t / s^2 is all that counts: twice the clutter is a quarter of the temperature."""
    surface = _correlation((2.0, 3.0), 3.0)

    noisy, _, _ = likelihood(surface, _peak(clutter_std=0.2), _blurless(0.8), 0.05, 0.5)
    tempered, _, _ = likelihood(surface, _peak(clutter_std=0.1), _blurless(0.2), 0.05, 0.5)

    assert_allclose(noisy, tempered, rtol=1e-9)


def test_clutter_found_on_the_surface_decides() -> None:
    """The same peak over more clutter says less, with the clutter measured and not told."""
    rng = np.random.default_rng(4)
    clean = _correlation((0.0, 0.0), 2.5)
    stds = []
    for clutter_std in (0.04, 0.12):
        surface = clean.surface + clutter_std * rng.normal(size=clean.surface.shape).astype(np.float32)
        # neighbouring displacements are alike on the bump; the noise there would only move the top
        surface[14:27, 14:27] = clean.surface[14:27, 14:27]
        peak = find_peak(surface)
        assert peak is not None
        values = likelihood(Correlation(surface, 20.0, -20.0, 1.0, 10_000), peak, _blurless(), 0.0, 0.5)
        stds.append(np.sqrt(_moments(*values, 0.5, 0.01)[1]))

    # three times the clutter: three times the deviation, and more where the parabola ends
    assert (stds[1] > 2.5 * stds[0]).all()


def test_ridge_stays_long_along_and_narrow_across() -> None:
    """A road to the east: the deviation along it over that across it is that of the similarity, 8 to 1."""
    values = likelihood(_correlation((0.0, 0.0), (1.0, 8.0)), _peak(clutter_std=0.12), _blurless(), 0.0, 0.25)

    _, (var_north, var_east) = _moments(*values, 0.25, 0.01)

    assert np.sqrt(var_east / var_north) == pytest.approx(8.0, rel=0.1)


def test_ridge_keeps_its_whole_length() -> None:
    """A surface that is level along a line is as likely at its ends, inside the blur, as in its middle."""
    surface = _correlation((0.0, 0.0), (1.5, 1e6))

    values, _, _ = likelihood(surface, _peak(), CALIBRATION, 0.01, 0.5)

    along = values[values.shape[0] // 2]
    assert_allclose(along[6:-6], along.max(), rtol=0.01)
    assert values[5].max() == pytest.approx(0.02, abs=1e-3)


def test_off_the_peak_the_outlier_probability_remains() -> None:
    values, _, _ = likelihood(_correlation((0.0, 0.0), 2.0), _peak(), CALIBRATION, 0.19, 0.5)

    assert values.min() == pytest.approx(0.2, abs=1e-6)


def test_floor_bounds_the_certainty() -> None:
    values, _, _ = likelihood(_correlation((0.0, 0.0), 2.0), _peak(), CALIBRATION, 0.0, 0.5)

    assert values.min() == pytest.approx(CALIBRATION.floor, abs=1e-6)


def test_maps_own_error_widens_the_peak() -> None:
    """A sharp peak keeps at least the map's variance; a map error of 2 m adds 4 m2 to it."""
    sharp = _correlation((0.0, 0.0), 1.5)
    wide = replace(CALIBRATION, map_std_m=2.0)

    _, var = _moments(*likelihood(sharp, _peak(), CALIBRATION, 0.0, 0.25), 0.25, 0.01)
    _, var_wide = _moments(*likelihood(sharp, _peak(), wide, 0.0, 0.25), 0.25, 0.01)

    # the blur's kernel ends at four sigmas and loses a thousandth
    assert (var > 0.99 * 0.25).all()
    assert_allclose(var_wide - var, 4.0 - 0.25, rtol=0.03)


@pytest.mark.parametrize("step_m", [0.5, 2.0])
def test_maps_error_in_pixels_follows_the_correlations_step(step_m: float) -> None:
    """Eight tenths of a pixel of half a metre or of two, beside the same error in metres."""
    in_pixels = replace(CALIBRATION, map_std_m=0.3, map_std_px=0.8)
    in_metres = replace(CALIBRATION, map_std_m=float(np.hypot(0.3, 0.8 * step_m)))
    surface = _correlation((0.0, 0.0), 4.0, step_m, half_m=24.0)

    values, _, _ = likelihood(surface, _peak(), in_pixels, 0.02, 0.5)

    assert_allclose(values, likelihood(surface, _peak(), in_metres, 0.02, 0.5)[0], rtol=1e-9)


def test_tempering_widens_by_its_weight_and_leaves_the_floor() -> None:
    """A picture counted for a quarter has four times the variance, and the same chance of being wrong."""
    surface, peak = _correlation((0.0, 0.0), 8.0, half_m=30.0), _peak(clutter_std=0.06)
    full = likelihood(surface, peak, CALIBRATION, 0.04, 0.25)
    quarter = likelihood(surface, peak, CALIBRATION, 0.04, 0.25, weight=0.25)

    _, var = _moments(*full, 0.25, 0.05)
    _, var_quarter = _moments(*quarter, 0.25, 0.05)
    assert_allclose(var_quarter / var, 4.0, rtol=0.1)
    assert quarter[0].min() == pytest.approx(0.05, abs=1e-3)


def test_unknown_map_gets_no_more_than_the_floor() -> None:
    correlation = _correlation((0.0, 0.0), 2.0)
    surface = correlation.surface.copy()
    surface[:, :8] = np.nan

    values, _, _ = likelihood(Correlation(surface, 20.0, -20.0, 1.0, 10_000), _peak(), CALIBRATION, 0.04, 1.0)

    assert np.isfinite(values).all()
    assert_allclose(values[:, :7], 0.05, atol=1e-6)


def test_featureless_surface_gives_a_flat_likelihood() -> None:
    blank = Correlation(np.full((31, 31), 0.2, dtype=np.float32), 15.0, -15.0, 1.0, 10_000)
    peak = find_peak(blank.surface)
    assert peak is not None

    values, _, _ = likelihood(blank, peak, CALIBRATION, 0.3, 0.5)

    # away from the rim, where the blur reaches past the surface
    assert_allclose(values[6:-6, 6:-6], 1.0, atol=0.05)


def test_similarity_taken_as_a_density_is_itself() -> None:
    """The 2009 form: proportional to the correlation where that is positive, nothing where it is not."""
    calibration = replace(CALIBRATION, form=LikelihoodForm.SIMILARITY)
    correlation = _correlation((3.0, -2.0), 4.0)
    below = replace(correlation, surface=correlation.surface - np.float32(0.2))

    values, north_max, east_min = likelihood(below, _peak(), calibration, 0.9, 1.0)

    assert (north_max, east_min) == (20.0, -20.0)
    assert values.mean() == pytest.approx(1.0)
    ratio = values[17, 18] / values[17, 20]
    assert ratio == pytest.approx(float(below.surface[17, 18] / below.surface[17, 20]), rel=1e-4)
    assert values[0, 0] < 1e-4


def test_hypotheses_share_one_density() -> None:
    """A surface that is alike in the peak's own deviations gets its share, and one alone is as by itself."""
    surface = _correlation((0.0, 0.0), 3.0)
    weaker = replace(surface, surface=surface.surface - np.float32(0.02))

    both = likelihoods(surface, [surface.surface, weaker.surface], _peak(), CALIBRATION, 0.0, 0.5)
    (alone,) = likelihoods(surface, [surface.surface], _peak(), CALIBRATION, 0.0, 0.5)

    assert np.mean(both) == pytest.approx(1.0)
    inlier = [each - CALIBRATION.floor for each in both]
    # 0.02 is a fifth of a deviation of the clutter, the peak eight of them high, the temperature a half
    assert inlier[1].sum() / inlier[0].sum() == pytest.approx(np.exp(-0.5 * 8.0 * 0.2), rel=1e-3)
    assert_allclose(alone, likelihood(surface, _peak(), CALIBRATION, 0.0, 0.5)[0])
