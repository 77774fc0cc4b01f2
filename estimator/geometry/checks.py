"""Checks of numbers that come from elsewhere, for what is stepped through time."""

from __future__ import annotations

import numpy as np

from estimator.geometry.earth import Float


def check_vectors(**vectors: Float) -> None:
    """ValueError with the name of the first that is not three finite numbers."""
    for name, vector in vectors.items():
        if np.shape(vector) != (3,) or not np.all(np.isfinite(vector)):
            message = f"{name} must be three finite numbers, not {vector}"
            raise ValueError(message)


def check_step(dt_s: float, longest_s: float) -> None:
    """ValueError for a step of time that is not above 0 and at most ``longest_s``."""
    if not 0.0 < dt_s <= longest_s:
        message = f"dt_s must be above 0 and at most {longest_s} s, not {dt_s}"
        raise ValueError(message)
