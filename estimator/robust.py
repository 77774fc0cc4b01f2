"""Standard deviations of samples, which a minority of outliers does not move, and of covariances."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

NORMAL_BY_MAD = 1.4826
"""A normal distribution's standard deviation over its median absolute deviation."""


def robust_std(values: ArrayLike) -> float:
    """Standard deviation of values (n,) about their median, from the median absolute deviation; NaN of none."""
    spread = np.asarray(values)
    return NORMAL_BY_MAD * float(np.median(np.abs(spread - np.median(spread)))) if spread.size else float("nan")


def largest_std(cov: NDArray[np.float64]) -> float:
    """Standard deviation along the direction in which a covariance (n, n) is largest."""
    return float(np.sqrt(np.linalg.eigvalsh(cov)[-1]))
