"""Covariances in words an operator reads: error ellipses and circular errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from estimator.evaluate import CHI2_95_2DOF
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class Ellipse:
    """A horizontal error ellipse; the azimuth of its major axis is clockwise from north, 0 to 180 degrees."""

    semi_major_m: float
    semi_minor_m: float
    azimuth_deg: float


def ellipse95(cov_ne_m2: Float) -> Ellipse:
    """The ellipse that holds 95 % of a normal distribution with a (2, 2) covariance over north and east."""
    values, vectors = np.linalg.eigh(np.asarray(cov_ne_m2, dtype=np.float64))
    minor, major = np.sqrt(np.maximum(values, 0.0) * CHI2_95_2DOF)
    north, east = vectors[:, 1]
    azimuth_deg = math.degrees(math.atan2(east, north)) % 180.0
    return Ellipse(float(major), float(minor), azimuth_deg)


def circular_error_m(cov_ne_m2: Float, probability: float = 0.9) -> float:
    """Radius of the circle about the estimate that holds the truth with a probability (CE90 by default).

    Exact for a normal distribution: the mass outside a circle is integrated over the angle, and the radius found by
    bisection between the bounds that the larger axis alone and both axes equal to it give.
    """
    values = np.maximum(np.linalg.eigvalsh(np.asarray(cov_ne_m2, dtype=np.float64)), 0.0)
    major = math.sqrt(float(values[1]))
    if major == 0.0:
        return 0.0
    # A needle-thin ellipse would need too fine an angle step; 1e-3 of the major axis changes CE90 by less than 1e-6.
    return _radius_m(major, max(math.sqrt(float(values[0])), 1e-3 * major), probability)


@lru_cache(maxsize=10_000)  # a list of all targets is made anew for everyone who connects
def _radius_m(major: float, minor: float, probability: float) -> float:
    # The midpoint rule converges geometrically on a periodic integrand; how fast depends on the ratio of the axes.
    count = math.ceil(20.0 * major / minor)
    angle = (np.arange(count) + 0.5) * (math.pi / 2 / count)
    inverse = (np.cos(angle) / major) ** 2 + (np.sin(angle) / minor) ** 2
    low, high = 0.0, major * math.sqrt(-2.0 * math.log(1.0 - probability)) * 1.000001
    for _ in range(50):
        radius = 0.5 * (low + high)
        outside = float(np.mean(np.exp(-0.5 * radius**2 * inverse) / inverse)) / (major * minor)
        low, high = (radius, high) if outside > 1.0 - probability else (low, radius)
    return 0.5 * (low + high)


def worst_std(cov: Float) -> float:
    """One sigma along the direction in which it is largest; NaN where the covariance is not known."""
    if not np.all(np.isfinite(cov)):
        return math.nan
    return math.sqrt(max(float(np.linalg.eigvalsh(cov)[-1]), 0.0))
