"""The truth about the vehicle at one instant."""

from __future__ import annotations

from dataclasses import dataclass

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
