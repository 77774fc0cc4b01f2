"""Satellite position and velocity."""

from __future__ import annotations

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.rotation import matrix_from_q
from estimator.measurements.innovation import Innovation
from estimator.types import Float

HORIZONTAL_VELOCITY_STD_M_S = 0.2
VERTICAL_VELOCITY_STD_M_S = 0.8
LAG_S = 0.2
"""What a receiver's filter and the way to here leave unknown of a velocity's time."""
UNKNOWN_ACCELERATION_M_S2 = 1.5


def position(eskf: ErrorStateFilter, pos_ned_m: Float, std_ned_m: Float, alike: Float) -> Innovation:
    """Innovation of a position (3,) in the local frame, each with a sigma (3,) beside the slow error of the place.

    A receiver's errors wander slowly: ``alike`` (3,) fixes in a row say it once.
    """
    z = pos_ned_m - eskf.nominal.motion.pos_ned_m
    z[:2] -= eskf.nominal.gnss_bias_ne_m
    H = eskf.layout.jacobian(3, position=np.eye(3), gnss_bias=np.eye(3)[:, :2])
    R_one = np.diag(std_ned_m**2)
    return Innovation(z, H, R_one * np.maximum(alike, 1.0), R_one)


def velocity(
    eskf: ErrorStateFilter, vel_ned_m_s: Float, specific_force_body_m_s2: Float | None = None
) -> Innovation | None:
    """Innovation of a velocity (3,); components that are NaN are left out, None if all are.

    Its time is not known to better than ``LAG_S``, so that it counts less the more the aircraft accelerates, which the
    accelerometer's reading (3,) tells.
    """
    known = np.isfinite(vel_ned_m_s)
    if not known.any():
        return None
    late_m_s = LAG_S * _acceleration_m_s2(eskf, specific_force_body_m_s2)
    std = np.array([HORIZONTAL_VELOCITY_STD_M_S, HORIZONTAL_VELOCITY_STD_M_S, VERTICAL_VELOCITY_STD_M_S])
    z = (vel_ned_m_s - eskf.nominal.motion.vel_ned_m_s)[known]
    H = eskf.layout.jacobian(3, velocity=np.eye(3))[known]
    return Innovation(z, H, np.diag(std[known] ** 2 + late_m_s**2))


def _acceleration_m_s2(eskf: ErrorStateFilter, specific_force_body_m_s2: Float | None) -> float:
    """How fast the velocity changes."""
    if specific_force_body_m_s2 is None:
        return UNKNOWN_ACCELERATION_M_S2
    force = specific_force_body_m_s2 - eskf.nominal.accelerometer_bias_m_s2
    force_ned = matrix_from_q(eskf.nominal.motion.q_ned_from_body) @ force
    return float(np.linalg.norm(force_ned + np.array([0.0, 0.0, eskf.earth.gravity_m_s2])))
