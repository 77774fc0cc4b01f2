"""Satellite position and velocity."""

from __future__ import annotations

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.measurements.innovation import Innovation
from estimator.types import Float

HORIZONTAL_VELOCITY_STD_M_S = 0.2
VERTICAL_VELOCITY_STD_M_S = 0.8


def position(eskf: ErrorStateFilter, pos_ned_m: Float, std_horizontal_m: float, std_vertical_m: float) -> Innovation:
    """Innovation of a position (3,) in the local frame."""
    z = pos_ned_m - eskf.nominal.motion.pos_ned_m
    H = eskf.layout.jacobian(3, position=np.eye(3))
    return Innovation(z, H, np.diag([std_horizontal_m**2, std_horizontal_m**2, std_vertical_m**2]))


def velocity(eskf: ErrorStateFilter, vel_ned_m_s: Float) -> Innovation | None:
    """Innovation of a velocity (3,); components that are NaN are left out, None if all are."""
    known = np.isfinite(vel_ned_m_s)
    if not known.any():
        return None
    z = (vel_ned_m_s - eskf.nominal.motion.vel_ned_m_s)[known]
    H = eskf.layout.jacobian(3, velocity=np.eye(3))[known]
    std = np.array([HORIZONTAL_VELOCITY_STD_M_S, HORIZONTAL_VELOCITY_STD_M_S, VERTICAL_VELOCITY_STD_M_S])[known]
    return Innovation(z, H, np.diag(std**2))
