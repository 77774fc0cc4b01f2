"""Pressure altitude as a measurement of height with a wandering zero."""

from __future__ import annotations

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.measurements.innovation import Innovation


def pressure_altitude(
    eskf: ErrorStateFilter, pressure_alt_m: float, origin_alt_amsl_m: float, std_m: float
) -> Innovation:
    """Innovation of a pressure altitude: altitude above sea level plus the barometer's bias."""
    expected = origin_alt_amsl_m - eskf.nominal.motion.pos_ned_m[2] + eskf.nominal.barometer_bias_m
    H = eskf.layout.jacobian(1, position=np.array([[0.0, 0.0, -1.0]]), barometer_bias=np.ones((1, 1)))
    return Innovation(np.array([pressure_alt_m - expected]), H, np.array([[std_m**2]]))
