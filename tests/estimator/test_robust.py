import numpy as np
import pytest
from scipy import stats

from estimator.robust import robust_std


def test_it_agrees_with_scipy() -> None:
    values = np.random.default_rng(5).normal(3.0, 2.0, 501)

    assert robust_std(values) == pytest.approx(stats.median_abs_deviation(values, scale="normal"), rel=1e-4)


def test_a_quarter_of_outliers_hardly_moves_it() -> None:
    values = np.random.default_rng(6).normal(0.0, 1.0, 2000)
    values[:500] += 1000.0

    assert robust_std(values) < 2.0


def test_nothing_has_no_spread() -> None:
    assert np.isnan(robust_std([]))
