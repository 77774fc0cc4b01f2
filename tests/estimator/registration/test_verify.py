from dataclasses import replace

import numpy as np
import pytest

from estimator.registration.calibration import calibration_of
from estimator.registration.verify import (
    FEATURES,
    MatchEvidence,
    OutlierWeights,
    Peak,
    features,
    find_peak,
    outlier_probability,
)

WEIGHTS = calibration_of("double_angle").outlier


def _judged(peak: Peak, other: float = 0.3) -> float:
    """Outlier probability of a peak that needs a middling turn; the tones are somewhat alike."""
    return outlier_probability(MatchEvidence(peak, 0.3, other), WEIGHTS)


def _surface(row: float, col: float, height: float = 0.7, noise: float = 0.03) -> np.ndarray:
    i, j = np.mgrid[:41, :51]
    bump = height * np.exp(-0.5 * ((i - row) ** 2 + (j - col) ** 2) / 2.0**2)
    return bump + noise * np.random.default_rng(1).normal(size=bump.shape)


@pytest.mark.parametrize(("row", "col"), [(20.0, 25.0), (12.3, 30.6), (7.5, 9.8)])
def test_peak_is_found_between_the_pixels(row: float, col: float) -> None:
    peak = find_peak(_surface(row, col, noise=0.0))

    assert peak is not None
    # a parabola through three samples of a Gaussian of two pixels
    assert peak.row == pytest.approx(row, abs=0.03)
    assert peak.col == pytest.approx(col, abs=0.03)
    assert not peak.at_edge


def test_clear_peak_is_believed_and_noise_is_not() -> None:
    clear, noise = find_peak(_surface(20.0, 25.0)), find_peak(_surface(20.0, 25.0, height=0.0))

    assert clear is not None
    assert noise is not None
    assert _judged(clear) < 0.02
    # of noise the tones are not alike either
    assert _judged(noise, other=0.0) > 0.5


def test_second_peak_is_measured_and_makes_less_sure() -> None:
    alone = find_peak(_surface(20.0, 12.0))
    doubled = find_peak(np.maximum(_surface(20.0, 12.0), _surface(20.0, 40.0, height=0.63, noise=0.0)))

    assert alone is not None
    assert doubled is not None
    assert doubled.second_ratio == pytest.approx(0.63 / alone.value, abs=0.08)
    assert alone.second_ratio < 0.3
    assert _judged(doubled) > _judged(alone)


def test_peak_at_the_edge_is_not_believed() -> None:
    """The true place may lie beyond the search."""
    peak = find_peak(_surface(0.0, 25.0, height=0.95))

    assert peak is not None
    assert peak.at_edge
    assert _judged(peak) > _judged(replace(peak, at_edge=False))


def test_unknown_parts_are_passed_over() -> None:
    surface = _surface(20.0, 25.0)
    surface[:, 22:29] = np.nan
    surface[5, 5] = 0.5

    peak = find_peak(surface)

    assert peak is not None
    assert (round(peak.row), round(peak.col)) == (5, 5)
    assert np.isfinite([peak.psr, peak.second_ratio]).all()
    assert find_peak(np.full((9, 9), np.nan)) is None


@pytest.mark.parametrize("channel", ["double_angle", "intensity", "edge_overlap", "mind"])
def test_probability_falls_where_all_signs_are_better(channel: str) -> None:
    weights = calibration_of(channel).outlier
    poor = Peak(5.0, 5.0, 0.05, 4.0, 0.95, False, 0.06, 0.015)
    good = Peak(5.0, 5.0, 0.4, 10.0, 0.4, False, 0.4, 0.03)

    wrong = outlier_probability(MatchEvidence(poor, 1.0, 0.0), weights)
    right = outlier_probability(MatchEvidence(good, 0.0, 0.6), weights)

    assert right < 0.1
    assert wrong > 0.4


def test_log_odds_are_linear_in_the_features() -> None:
    peak = Peak(row=5.0, col=5.0, value=0.4, psr=5.0, second_ratio=0.8, at_edge=True, height=0.25, clutter_std=0.05)
    evidence = MatchEvidence(peak, 0.5, -0.2)
    weights = OutlierWeights(0.3, tuple(0.1 * k for k in range(len(FEATURES))))

    log_odds = 0.3 + float(features(evidence) @ weights.weights)

    assert outlier_probability(evidence, weights) == pytest.approx(1.0 / (1.0 + np.exp(-log_odds)))
    by_name = dict(zip(FEATURES, features(evidence), strict=True))
    assert (by_name["at_edge"], by_name["turn"], by_name["other"]) == (1.0, pytest.approx(0.25), -0.2)


@pytest.mark.parametrize("noise", [0.02, 0.06])
def test_clutter_is_the_scatter_away_from_the_peak(noise: float) -> None:
    """The peak of 0.7 itself would raise it to 0.08; the ratio is the height over the rest's mean in its deviations."""
    surface = _surface(20.0, 25.0, noise=noise)

    peak = find_peak(surface)

    assert peak is not None
    # 2000 samples: their deviation is known to 1.6 %; the bump's flank outside the excluded square adds some
    assert peak.clutter_std == pytest.approx(noise, rel=0.1)
    away = np.ones(surface.shape, dtype=np.bool_)
    away[15:26, 20:31] = False
    assert peak.psr == pytest.approx((peak.value - surface[away].mean()) / surface[away].std(), rel=1e-6)


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_ratio_to_the_clutter_does_not_depend_on_the_scale(factor: float) -> None:
    plain, scaled = find_peak(_surface(20.0, 25.0)), find_peak(factor * _surface(20.0, 25.0))

    assert plain is not None
    assert scaled is not None
    assert scaled.psr == pytest.approx(plain.psr, rel=1e-9)
    assert scaled.clutter_std == pytest.approx(factor * plain.clutter_std, rel=1e-9)


def test_surface_of_the_peak_alone_has_no_clutter_to_compare_with() -> None:
    """All lies within the excluded square: nothing speaks for the peak, and nothing is divided by zero."""
    peak = find_peak(_surface(4.0, 4.0)[:10, :10])

    assert peak is not None
    assert peak.psr == 0.0
    assert peak.clutter_std > 0.0


def test_flat_surroundings_leave_a_finite_ratio() -> None:
    surface = np.zeros((41, 51))
    surface[20, 25] = 0.7

    peak = find_peak(surface)

    assert peak is not None
    assert np.isfinite(peak.psr)
    assert peak.clutter_std > 0.0
