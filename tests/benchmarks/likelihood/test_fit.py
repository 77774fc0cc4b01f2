"""The fit finds again what samples were drawn from, and the check says how good that is."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.likelihood.fit import CELL_M, Quality, auc, fit, fit_likelihood, fit_outlier, inlier_density, quality
from benchmarks.likelihood.samples import Sample
from estimator.ports import Correlation
from estimator.registration.calibration import calibration_of
from estimator.registration.likelihood import LikelihoodCalibration, likelihood
from estimator.registration.verify import FEATURES, Peak, find_peak

HAND = calibration_of("double_angle")
TRUE = LikelihoodCalibration(temperature=0.9, power=0.5, map_std_m=1.2, map_std_px=0.0, floor=0.1, doubt=0.0)


def _surface(rng: np.random.Generator, half: int = 24) -> np.ndarray:
    """Smooth clutter with a bump somewhere."""
    clutter = 0.03 * cv2.GaussianBlur(rng.normal(size=(2 * half + 1, 2 * half + 1)), (0, 0), 1.5) * 5.0
    i, j = np.mgrid[-half : half + 1, -half : half + 1]
    north, east = rng.uniform(-12, 12, size=2)
    return (clutter + 0.25 * np.exp(-0.5 * ((i - north) ** 2 + (j - east) ** 2) / 2.5**2)).astype(np.float32)


def _drawn(rng: np.random.Generator, step_m: float, outlier: float = 0.0, true: LikelihoodCalibration = TRUE) -> Sample:
    """A surface, and a truth drawn from what a calibration makes of it."""
    surface = _surface(rng)
    peak = find_peak(surface)
    assert peak is not None
    half_m = 24 * step_m
    correlation = Correlation(surface, half_m, -half_m, step_m, 5000)
    values, north_max, east_min = likelihood(correlation, peak, true, outlier, CELL_M)
    cell = rng.choice(values.size, p=(values / values.sum()).ravel())
    row, col = np.unravel_index(cell, values.shape)
    truth = np.array([north_max - row * CELL_M, east_min + col * CELL_M])
    return Sample(1, np.zeros(len(FEATURES)), False, peak, correlation, truth)


@pytest.fixture(scope="module")
def drawn() -> list[Sample]:
    rng = np.random.default_rng(7)
    return [_drawn(rng, step_m) for step_m in (0.5, 1.0) for _ in range(150)]


def test_likelihood_is_found_again(drawn: list[Sample]) -> None:
    found = fit_likelihood(drawn, np.zeros(len(drawn)), HAND.likelihood)

    # nothing fits what was drawn as well as the fit: temperature and power alone are hardly told from each other
    samples = [*drawn, replace(drawn[0], wrong=True, correlation=None, displacement_ne_m=None)]
    nats = [quality(samples, replace(HAND, likelihood=which)).nats for which in (found, TRUE, HAND.likelihood)]
    assert nats[0] >= nats[1] - 0.005
    assert nats[0] > nats[2] + 0.05
    # 300 samples, a tenth of them on the floor: the spread is known to some 5 %, the floor to 2 %
    spread_m = [float(np.hypot(found.map_std_m, found.map_std_px * step_m)) for step_m in (0.5, 1.0)]
    assert spread_m == pytest.approx([TRUE.map_std_m] * 2, rel=0.2)
    assert found.floor == pytest.approx(TRUE.floor, abs=0.06)


def test_doubt_is_told_from_the_floor() -> None:
    """Half the samples have an outlier probability of 0.8 and are drawn with a doubt of a half, the rest are sure."""
    rng = np.random.default_rng(9)
    drawn = [_drawn(rng, 0.5, 0.8 * (k % 2), replace(TRUE, floor=0.02, doubt=0.5)) for k in range(200)]

    found = fit_likelihood(drawn, np.array([0.8 * (k % 2) for k in range(200)]), HAND.likelihood)

    # 100 samples of which two fifths are off: 5 %, over 0.8
    assert found.doubt == pytest.approx(0.5, abs=0.18)
    assert found.floor < 0.08


def test_regions_of_the_true_calibration_hold_their_share(drawn: list[Sample]) -> None:
    samples = [*drawn, replace(drawn[0], wrong=True, correlation=None, displacement_ne_m=None)]

    right = quality(samples, replace(HAND, likelihood=TRUE))
    narrow = quality(samples, replace(HAND, likelihood=replace(TRUE, map_std_m=0.2, temperature=1.0, floor=0.01)))

    # binomial deviation of 300: 3 %
    assert right.inside == pytest.approx((0.5, 0.9, 0.95), abs=0.07)
    assert narrow.inside[1] < 0.75
    assert narrow.nats < right.nats


def test_density_at_the_truth_is_the_estimators(drawn: list[Sample]) -> None:
    """The fit's short cut against the likelihood on the density's own grid, where the pixels are the cells."""
    sure = replace(TRUE, floor=1e-6)
    for sample in drawn[:20]:
        assert sample.correlation is not None
        assert sample.displacement_ne_m is not None
        values, north_max, east_min = likelihood(sample.correlation, sample.peak, sure, 0.0, CELL_M)
        at = (
            round((north_max - sample.displacement_ne_m[0]) / CELL_M),
            round((sample.displacement_ne_m[1] - east_min) / CELL_M),
        )
        # the blur cuts its kernel off at four deviations
        assert inlier_density(sample, sure) == pytest.approx(float(values[at]), rel=0.03, abs=1e-3)


def test_truth_beyond_the_surface_is_on_the_floor(drawn: list[Sample]) -> None:
    beyond = replace(drawn[0], displacement_ne_m=np.array([500.0, 0.0]))

    assert inlier_density(beyond, TRUE) == 0.0
    assert quality([beyond], replace(HAND, likelihood=TRUE)).inside == (0.0, 0.0, 0.0)


def _judged(rng: np.random.Generator, count: int) -> list[Sample]:
    """Right places whose log odds of being wrong are -1 + 2 (psr - 6) of nothing but the second feature."""
    peak = Peak(5.0, 5.0, 0.4, 5.0, 0.8, False, 0.25, 0.05)
    blank = Correlation(np.zeros((41, 41), dtype=np.float32), 20.0, -20.0, 1.0, 100)
    samples = []
    for _ in range(count):
        rows = rng.normal(size=len(FEATURES))
        wrong = bool(rng.uniform() < 1.0 / (1.0 + np.exp(1.0 - 2.0 * rows[1])))
        samples.append(Sample(1, rows, wrong, peak, blank, np.zeros(2)))
    return samples


def test_outlier_weights_are_found_again_and_reliable_on_others() -> None:
    rng = np.random.default_rng(11)
    weights = fit_outlier(_judged(rng, 3000))

    assert weights.bias == pytest.approx(-1.0, abs=0.2)
    assert weights.weights[1] == pytest.approx(2.0, abs=0.25)
    assert np.abs(np.delete(weights.weights, 1)).max() < 0.2
    found: Quality = quality(_judged(rng, 3000), replace(HAND, outlier=weights))
    # ten bins of 300: 2.5 % each at the most
    assert found.reliability < 0.04
    assert found.auc > 0.8


def test_the_likelihood_can_be_kept() -> None:
    samples = _judged(np.random.default_rng(5), 200)

    made = fit(samples, HAND, "double_angle/9", {"command": "test"}, keep_likelihood=True)

    assert made.likelihood == HAND.likelihood
    assert made.outlier == fit_outlier(samples)
    assert (made.version, made.channel) == ("double_angle/9", "double_angle")


def test_one_kind_of_match_alone_cannot_be_fitted() -> None:
    samples = [replace(s, wrong=False) for s in _judged(np.random.default_rng(2), 10)]

    with pytest.raises(ValueError, match="0 of 10 matches are wrong"):
        fit(samples, HAND, "double_angle/9", {})


def test_area_under_the_curve_counts_pairs() -> None:
    stated = np.array([0.1, 0.4, 0.4, 0.9])
    wrong = np.array([False, False, True, True])

    # of four pairs three are in order and one is a tie
    assert auc(stated, wrong) == pytest.approx(3.5 / 4.0)
    assert np.isnan(auc(stated, np.zeros(4, dtype=np.bool_)))
