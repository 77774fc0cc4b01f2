"""What ideal inertial sensors on a moving vehicle read, over one step of its motion."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from estimator.geometry.earth import EARTH_RATE_RAD_S, gravity_m_s2, meridian_radius_m
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q, q_conjugate, q_multiply, rotvec_from_q, skew
from estimator.types import Float
from simulator.vehicles.state import VehicleState


class InertialReadings:
    """Of one place on the turning Earth; ``gravity_m_s2`` is its own."""

    def __init__(self, frame: LocalFrame) -> None:
        self.gravity_m_s2 = float(gravity_m_s2(frame.lat_rad, frame.alt_m))
        self._radius_m = float(meridian_radius_m(frame.lat_rad))
        self._earth_rate = EARTH_RATE_RAD_S * np.array([cos(frame.lat_rad), 0.0, -sin(frame.lat_rad)])
        self._coriolis = 2 * skew(self._earth_rate)

    def state(
        self, t_us: int, dt_s: float, pos_ned_m: Float, vel_ned_m_s: Float, angle_rad: Float, wind_ned_m_s: Float,
        q_ned_from_body: Float, vel_before_ned_m_s: Float, q_before: Float,
    ) -> VehicleState:  # fmt: skip
        """The state (roll, pitch, yaw in ``angle_rad``) at the end of a step of ``dt_s`` from what was before."""
        ned_from_body = matrix_from_q(q_ned_from_body)
        rotation = rotvec_from_q(q_multiply(q_conjugate(q_before), q_ned_from_body)) / dt_s
        # The plumb line leans as the vehicle leaves the frame's origin: 1e-3 m/s2 at 600 m.
        lean = np.array([-pos_ned_m[0] / self._radius_m, -pos_ned_m[1] / self._radius_m, 1.0])
        plumb = lean * self.gravity_m_s2
        coriolis = self._coriolis @ vel_ned_m_s
        force = ned_from_body.T @ ((vel_ned_m_s - vel_before_ned_m_s) / dt_s + coriolis - plumb)
        return VehicleState(
            t_us=t_us,
            pos_ned_m=pos_ned_m,
            vel_ned_m_s=vel_ned_m_s,
            roll_rad=float(angle_rad[0]),
            pitch_rad=float(angle_rad[1]),
            yaw_rad=float(angle_rad[2]),
            q_ned_from_body=q_ned_from_body,
            rate_body_rad_s=rotation + ned_from_body.T @ self._earth_rate,
            specific_force_body_m_s2=force,
            wind_ned_m_s=wind_ned_m_s,
        )
