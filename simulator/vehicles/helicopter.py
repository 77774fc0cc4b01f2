"""A helicopter with first-order responses: tilt follows command, acceleration follows tilt."""

from __future__ import annotations

from math import atan2, cos, exp, inf, pi, sin, tan

import numpy as np

from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q, q_from_euler
from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.vehicles.gauss_markov import GaussMarkov
from simulator.vehicles.inertial import InertialReadings
from simulator.vehicles.state import VehicleState

_TILT_RATE_RAD_S = 3.6
_TILT_DAMPING = 0.85
_YAW_RATE_RAD_S = 2.2
_MAX_TILT_RAD = 0.30
_MAX_ACCELERATION_M_S2 = 2.4
_MAX_TURN_RAD_S = 0.45
_DRAG_PER_S = 0.055
_THRUST_LAG_S = 0.15
_GUST_TILT_RAD = 0.012
# On its skids: friction stops it, the springs bring it level, and a wish to climb of this much lifts it off.
_SKID_TIME_S, _LEVEL_TIME_S = 0.04, 0.3
_LIFT_OFF_M_S = 0.2


class Helicopter:
    """Integrates the motion in fixed steps; commanded by a velocity and a heading."""

    def __init__(
        self,
        frame: LocalFrame,
        pos_ned_m: Float,
        yaw_rad: float,
        seed: int,
        wind_m_s: float,
        gust_std_m_s: float,
    ) -> None:
        rng = rng_for(seed, "air")
        direction = rng.uniform(0, 2 * pi)
        self._mean_wind = wind_m_s * np.array([cos(direction), sin(direction), 0.0])
        self._gust = GaussMarkov(rng, gust_std_m_s, 3.0, 3)
        self._shake = GaussMarkov(rng_for(seed, "turbulence"), _GUST_TILT_RAD, 0.5, 3)
        self._readings = InertialReadings(frame)
        self._gravity = self._readings.gravity_m_s2
        self._angle = np.array([0.0, 0.0, yaw_rad])
        self._angle_rate = np.zeros(3)
        self._thrust = self._gravity
        self._pos, self._vel = np.array(pos_ned_m, dtype=np.float64), np.zeros(3)
        self._q = q_from_euler(*self._angle)
        self.on_ground = False

    def step(
        self, t_us: int, dt_s: float, vel_command_ned_m_s: Float, yaw_command_rad: float, floor_down_m: float = inf
    ) -> VehicleState:
        """Advance by ``dt_s`` to the time ``t_us``; nothing gets below ``floor_down_m``, where it stands."""
        wind = self._mean_wind + self._gust.step(dt_s) * (1.0, 1.0, 0.5)
        drag = -_DRAG_PER_S * (self._vel - wind)
        if self.on_ground:
            self._angle = self._angle * (*[exp(-dt_s / _LEVEL_TIME_S)] * 2, 1.0)
            self._angle_rate = np.zeros(3)
        else:
            self._turn(dt_s, vel_command_ned_m_s, yaw_command_rad)
        vertical = 1.2 * (vel_command_ned_m_s[2] - self._vel[2])
        lift = (self._gravity - vertical) / (cos(self._angle[0]) * cos(self._angle[1]))
        self._thrust += (lift - self._thrust) * dt_s / _THRUST_LAG_S
        q = q_from_euler(*self._angle)
        ned_from_body = matrix_from_q(q)
        acceleration = -self._thrust * ned_from_body[:, 2] + drag
        acceleration[2] += self._gravity
        before = self._vel
        self._vel = before + acceleration * dt_s
        self._pos = self._pos + 0.5 * (before + self._vel) * dt_s
        if self._pos[2] >= floor_down_m:
            self._stand(dt_s, before, float(vel_command_ned_m_s[2]), floor_down_m)
        state = self._readings.state(t_us, dt_s, self._pos, self._vel, self._angle, wind, q, before, self._q)
        self._q = q
        return state

    def _stand(self, dt_s: float, vel_before: Float, down_command_m_s: float, floor_down_m: float) -> None:
        self.on_ground = down_command_m_s > -_LIFT_OFF_M_S
        if self.on_ground:
            self._vel = vel_before * exp(-dt_s / _SKID_TIME_S)
            self._thrust = self._gravity
        else:
            self._vel[2] = min(self._vel[2], 0.0)
        self._pos[2] = floor_down_m

    def _turn(self, dt_s: float, vel_command: Float, yaw_command_rad: float) -> None:
        """Second-order response of roll, pitch and yaw to what the velocity error asks for."""
        error = 0.75 * (vel_command - self._vel)[:2]
        size = float(np.hypot(*error))
        if size > _MAX_ACCELERATION_M_S2:
            error *= _MAX_ACCELERATION_M_S2 / size
        # The trim against drag is known to a pilot, and so to this one.
        error += _DRAG_PER_S * (self._vel - self._mean_wind)[:2]
        c, s = cos(self._angle[2]), sin(self._angle[2])
        forward, right = c * error[0] + s * error[1], c * error[1] - s * error[0]
        limit = tan(_MAX_TILT_RAD) * self._gravity
        shake = self._shake.step(dt_s)
        pitch = -atan2(min(max(forward, -limit), limit), self._gravity) + shake[1]
        roll = atan2(min(max(right, -limit), limit), self._gravity) + shake[0]
        yaw_error = (yaw_command_rad - self._angle[2] + pi) % (2 * pi) - pi
        yaw_error = min(max(yaw_error, -0.6), 0.6) + 0.5 * shake[2]
        demand = np.array([roll - self._angle[0], pitch - self._angle[1], yaw_error])
        stiffness = np.array([_TILT_RATE_RAD_S, _TILT_RATE_RAD_S, _YAW_RATE_RAD_S])
        self._angle_rate += (stiffness**2 * demand - 2 * _TILT_DAMPING * stiffness * self._angle_rate) * dt_s
        self._angle_rate[2] = min(max(self._angle_rate[2], -_MAX_TURN_RAD_S), _MAX_TURN_RAD_S)
        self._angle = self._angle + self._angle_rate * dt_s
        self._angle[2] = (self._angle[2] + pi) % (2 * pi) - pi
