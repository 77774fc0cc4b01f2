"""Error ellipses and circular errors against outside answers."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.stats import norm

from backend.uncertainty import circular_error_m, ellipse95


def test_ellipse_of_axes_along_north_and_east() -> None:
    ellipse = ellipse95(np.diag([4.0, 1.0]))

    assert_allclose(ellipse.semi_major_m, 2.0 * 2.4477, rtol=1e-4)  # sqrt of the 95 % chi-squared quantile, 2 dof
    assert_allclose(ellipse.semi_minor_m, 2.4477, rtol=1e-4)
    assert ellipse.azimuth_deg == pytest.approx(0.0)


def test_azimuth_is_clockwise_from_north() -> None:
    assert ellipse95(np.diag([1.0, 4.0])).azimuth_deg == pytest.approx(90.0)
    # north and east grow together: the axis points north-east
    assert ellipse95(np.array([[2.0, 1.0], [1.0, 2.0]])).azimuth_deg == pytest.approx(45.0)
    assert ellipse95(np.array([[2.0, -1.0], [-1.0, 2.0]])).azimuth_deg == pytest.approx(135.0)


def test_circular_error_of_a_round_distribution_is_rayleighs_quantile() -> None:
    assert_allclose(circular_error_m(np.eye(2) * 9.0), 3.0 * math.sqrt(-2.0 * math.log(0.1)), rtol=1e-5)


def test_circular_error_of_a_thin_distribution_is_the_normal_quantile() -> None:
    assert_allclose(circular_error_m(np.diag([25.0, 0.0])), 5.0 * 1.6448536, rtol=1e-3)


@pytest.mark.parametrize("cov", [[[4.0, 1.5], [1.5, 1.0]], [[1.0, -0.2], [-0.2, 9.0]]])
def test_circle_holds_the_share_it_promises(cov: list[list[float]]) -> None:
    samples = np.random.default_rng(5).multivariate_normal([0.0, 0.0], cov, 200_000)

    inside = np.mean(np.linalg.norm(samples, axis=1) <= circular_error_m(np.array(cov), 0.9))

    assert_allclose(inside, 0.9, atol=0.003)  # four standard errors of the count


@pytest.mark.parametrize("minor", [1.0, 0.7, 0.3, 0.1, 0.02, 0.001])
def test_circle_holds_what_the_distribution_function_says(minor: float) -> None:
    """Against SciPy: x^2 + y^2 <= r^2, integrated over x with the normal distribution of y."""
    radius = circular_error_m(np.diag([1.0, minor**2]))

    def inside(x: float) -> float:
        return float(norm.pdf(x) * (2.0 * norm.cdf(math.sqrt(radius**2 - x**2) / minor) - 1.0))

    share, _ = quad(inside, -radius, radius, limit=500, points=[-radius * 0.999, radius * 0.999])
    assert_allclose(share, 0.9, atol=1e-5)


def test_no_uncertainty_is_no_circle() -> None:
    assert circular_error_m(np.zeros((2, 2))) == 0.0
