"""The truth about the vehicle at one instant."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator.geometry.checks import check_vectors
from estimator.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class VehicleState:
    """Position and velocity (3,) in the world's frame, attitude, and what ideal inertial sensors read.

    ``rate_body_rad_s`` and ``specific_force_body_m_s2`` are means over the step that led here, against inertial space.
    """

    t_us: int
    pos_ned_m: Float
    vel_ned_m_s: Float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    q_ned_from_body: Float
    rate_body_rad_s: Float
    specific_force_body_m_s2: Float
    wind_ned_m_s: Float


def check_start(pos_ned_m: Float, yaw_rad: float, wind_ned_m_s: Float, gust_std_m_s: float) -> None:
    """ValueError where a flight cannot begin with position and wind (3,), a heading and gusts of such a deviation."""
    check_vectors(pos_ned_m=pos_ned_m, wind_ned_m_s=wind_ned_m_s)
    if not (math.isfinite(yaw_rad) and math.isfinite(gust_std_m_s) and gust_std_m_s >= 0.0):
        message = f"yaw_rad must be finite and gust_std_m_s not negative, not {yaw_rad} and {gust_std_m_s}"
        raise ValueError(message)
