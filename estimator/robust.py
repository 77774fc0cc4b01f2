"""Statistics that a minority of outliers does not move."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

NORMAL_BY_MAD = 1.4826
"""A normal distribution's standard deviation over its median absolute deviation."""


def robust_std(values: ArrayLike) -> float:
    """Standard deviation of values (n,) about their median, from the median absolute deviation; NaN of none."""
    spread = np.asarray(values)
    return NORMAL_BY_MAD * float(np.median(np.abs(spread - np.median(spread)))) if spread.size else float("nan")
