import numpy as np
import pytest

from estimator.registration.verify import Peak, VerificationWeights, find_peak, outlier_probability

WEIGHTS = VerificationWeights()


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
    assert outlier_probability(clear, WEIGHTS) < 0.02
    # the limit of acceptance
    assert outlier_probability(noise, WEIGHTS) > 0.5


def test_second_peak_is_measured_and_makes_less_sure() -> None:
    alone = find_peak(_surface(20.0, 12.0))
    doubled = find_peak(np.maximum(_surface(20.0, 12.0), _surface(20.0, 40.0, height=0.63, noise=0.0)))

    assert alone is not None
    assert doubled is not None
    assert doubled.second_ratio == pytest.approx(0.63 / alone.value, abs=0.08)
    assert alone.second_ratio < 0.3
    assert outlier_probability(doubled, WEIGHTS) > outlier_probability(alone, WEIGHTS)


def test_peak_at_the_edge_is_not_believed() -> None:
    """The true place may lie beyond the search."""
    peak = find_peak(_surface(0.0, 25.0, height=0.95))

    assert peak is not None
    assert peak.at_edge
    assert outlier_probability(peak, WEIGHTS) > 0.9


def test_unknown_parts_are_passed_over() -> None:
    surface = _surface(20.0, 25.0)
    surface[:, 22:29] = np.nan
    surface[5, 5] = 0.5

    peak = find_peak(surface)

    assert peak is not None
    assert (round(peak.row), round(peak.col)) == (5, 5)
    assert np.isfinite([peak.psr, peak.second_ratio]).all()
    assert find_peak(np.full((9, 9), np.nan)) is None


def test_probability_falls_with_every_sign_of_quality() -> None:
    base = Peak(5.0, 5.0, 0.4, 5.0, 0.8, False)
    better = [
        Peak(5.0, 5.0, 0.6, 5.0, 0.8, False), Peak(5.0, 5.0, 0.4, 8.0, 0.8, False), Peak(5.0, 5.0, 0.4, 5.0, 0.5, False)
    ]  # fmt: skip

    for peak in better:
        assert outlier_probability(peak, WEIGHTS) < outlier_probability(base, WEIGHTS)
