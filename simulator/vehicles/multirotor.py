"""A multirotor: thrust along one axis, an attitude loop with the lag of its motors, drag against the wind.

Commanded by a velocity and a heading as the helicopter is. The velocity's error asks for an acceleration, that for the
direction and size of the thrust, the direction for body rates, and these for moments; thrust and moments follow with
the motors' lag. Drag has a part that grows with the airspeed (rotors that are blown at from the side) and one with its
square (the body). The numbers are of no one aircraft: a quadrotor of one to three kilograms with twice its weight in
thrust. Attitude is integrated as a rotation, velocity by the trapezoidal rule; 20 ms at most a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from estimator.geometry.checks import check_step
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import (
    euler_from_q,
    matrix_from_q,
    q_conjugate,
    q_from_euler,
    q_from_matrix,
    q_from_rotvec,
    q_multiply,
    q_normalise,
    rotvec_from_q,
)
from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.vehicles.gauss_markov import GaussMarkov
from simulator.vehicles.inertial import InertialReadings
from simulator.vehicles.state import VehicleState, check_start

_LONGEST_STEP_S = 0.02
_GUST_TIME_S, _SHAKE_TIME_S = 3.0, 0.2
# On its legs: friction stops it, and a wish to climb of this much lifts it off.
_LEG_TIME_S, _LIFT_OFF_M_S = 0.04, 0.2


@dataclass(frozen=True, slots=True)
class MultirotorConfig:
    """What it can do and how it is controlled.

    ``drag_per_s`` and ``drag_per_m`` are of the airspeed and of its square, as accelerations. ``thrust_max_g`` is the
    most thrust by the weight, ``shake_rad_s2`` the moments of turbulence by the inertia for each m/s of gusts.
    """

    thrust_max_g: float = 2.0
    thrust_min_g: float = 0.1
    tilt_max_rad: float = math.radians(35.0)
    drag_per_s: float = 0.2
    drag_per_m: float = 0.012
    motor_time_s: float = 0.05
    angular_max_rad_s2: float = 40.0
    yaw_rate_max_rad_s: float = 1.2
    shake_rad_s2: float = 0.5
    velocity_per_s: float = 1.6
    velocity_integral_per_s2: float = 0.6
    acceleration_max_m_s2: float = 4.0
    tilt_per_s: float = 6.0
    yaw_per_s: float = 2.0
    rate_per_s: float = 16.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            zero = one.name in ("drag_per_s", "drag_per_m", "shake_rad_s2", "velocity_integral_per_s2")
            if not (math.isfinite(value) and (value > 0.0 or (zero and value == 0.0))):
                message = f"{one.name} must be positive, not {value}"
                raise ValueError(message)
        if not self.thrust_min_g < 1.0 < self.thrust_max_g:
            message = (
                f"1 g must lie between thrust_min_g and thrust_max_g, not {self.thrust_min_g}, {self.thrust_max_g}"
            )
            raise ValueError(message)
        if not self.tilt_max_rad < math.acos(1.0 / self.thrust_max_g):
            message = f"a tilt of {self.tilt_max_rad} rad cannot be flown level with {self.thrust_max_g} g of thrust"
            raise ValueError(message)


class Multirotor:
    """Integrates the motion in steps; ``wind_ned_m_s`` (3,) is steady, gusts come from the seed.

    Raises
    ------
    ValueError
        Position or wind are not three finite numbers, the heading is not finite, or the gusts' deviation is negative.
    """

    def __init__(
        self, frame: LocalFrame, pos_ned_m: Float, yaw_rad: float, seed: int, wind_ned_m_s: Float, gust_std_m_s: float,
        config: MultirotorConfig | None = None,
    ) -> None:  # fmt: skip
        check_start(pos_ned_m, yaw_rad, wind_ned_m_s, gust_std_m_s)
        self.config = config or MultirotorConfig()
        self._mean_wind: Float = np.array(wind_ned_m_s, np.float64)
        self._gust = GaussMarkov(rng_for(seed, "air", "gusts"), gust_std_m_s, _GUST_TIME_S, 3)
        shake = self.config.shake_rad_s2 * gust_std_m_s
        self._shake = GaussMarkov(rng_for(seed, "turbulence"), shake, _SHAKE_TIME_S, 3)
        self._readings = InertialReadings(frame)
        self._pos: Float = np.array(pos_ned_m, np.float64)
        self._vel: Float = np.zeros(3)
        self._q: Float = q_from_euler(0.0, 0.0, yaw_rad)
        self._rate: Float = np.zeros(3)
        self._angular: Float = np.zeros(3)
        self._thrust_m_s2 = self._readings.gravity_m_s2
        self._integral: Float = np.zeros(3)
        self.on_ground = False

    def step(
        self, t_us: int, dt_s: float, vel_command_ned_m_s: Float, yaw_command_rad: float,
        floor_down_m: float = math.inf,
    ) -> VehicleState:  # fmt: skip
        """Advance by ``dt_s`` to the time ``t_us``; nothing gets below ``floor_down_m``, where it stands.

        Raises
        ------
        ValueError
            ``dt_s`` is not above 0 and at most 20 ms.
        """
        check_step(dt_s, _LONGEST_STEP_S)
        wind = self._mean_wind + self._gust.step(dt_s) * (1.0, 1.0, 0.5)
        shake = self._shake.step(dt_s)
        before, q_before = self._vel, self._q
        lag = 1.0 - math.exp(-dt_s / self.config.motor_time_s)
        thrust_m_s2, angular = self._commands(dt_s, vel_command_ned_m_s, yaw_command_rad)
        self._thrust_m_s2 += lag * (thrust_m_s2 - self._thrust_m_s2)
        self._angular = self._angular + lag * (angular - self._angular)
        if self.on_ground:
            self._rest()
        else:
            turned = self._rate + 0.5 * dt_s * (self._angular + shake)
            self._rate = self._rate + dt_s * (self._angular + shake)
            self._q = q_normalise(q_multiply(q_before, q_from_rotvec(turned * dt_s)))
        first = self._acceleration(before, q_before, wind)
        second = self._acceleration(before + dt_s * first, self._q, wind)
        self._vel = before + 0.5 * dt_s * (first + second)
        self._pos = self._pos + 0.5 * dt_s * (before + self._vel)
        if self._pos[2] >= floor_down_m:
            self._stand(dt_s, before, float(vel_command_ned_m_s[2]), floor_down_m)
        else:
            self.on_ground = False
        return self._readings.state(
            t_us, dt_s, self._pos, self._vel, np.array(euler_from_q(self._q)), wind, self._q, before, q_before
        )

    def _acceleration(self, vel_ned_m_s: Float, q: Float, wind_ned_m_s: Float) -> Float:
        config, air = self.config, vel_ned_m_s - wind_ned_m_s
        drag = -(config.drag_per_s + config.drag_per_m * float(np.linalg.norm(air))) * air
        acceleration: Float = drag - self._thrust_m_s2 * matrix_from_q(q)[:, 2]
        acceleration[2] += self._readings.gravity_m_s2
        return acceleration

    def _commands(self, dt_s: float, vel_command_ned_m_s: Float, yaw_command_rad: float) -> tuple[float, Float]:
        """Thrust by mass and moments by inertia (3,) for a velocity and a heading."""
        config, gravity = self.config, self._readings.gravity_m_s2
        lacking = vel_command_ned_m_s - self._vel
        wanted = config.velocity_per_s * lacking
        size = float(np.linalg.norm(wanted))
        if size > config.acceleration_max_m_s2:
            wanted = wanted * (config.acceleration_max_m_s2 / size)
        elif not self.on_ground:
            # While it speeds up at its limit, an integral would only have to be taken back.
            most = 0.5 * config.tilt_max_rad * gravity
            more = config.velocity_integral_per_s2 * lacking * dt_s
            self._integral = np.minimum(np.maximum(self._integral + more, -most), most)
        lift = -(wanted + self._integral)
        lift[2] = max(lift[2] + gravity, config.thrust_min_g * gravity)
        level = float(np.hypot(lift[0], lift[1]))
        if level > lift[2] * math.tan(config.tilt_max_rad):
            lift[:2] *= lift[2] * math.tan(config.tilt_max_rad) / level
        down = lift / float(np.linalg.norm(lift))
        right = np.cross(down, (math.cos(yaw_command_rad), math.sin(yaw_command_rad), 0.0))
        right /= float(np.linalg.norm(right))
        q_wanted = q_from_matrix(np.column_stack((np.cross(right, down), right, down)))
        error = rotvec_from_q(q_multiply(q_conjugate(self._q), q_wanted))
        rate = error * (config.tilt_per_s, config.tilt_per_s, config.yaw_per_s)
        rate[2] = min(max(rate[2], -config.yaw_rate_max_rad_s), config.yaw_rate_max_rad_s)
        angular = config.rate_per_s * (rate - self._rate)
        most_rad_s2 = config.angular_max_rad_s2
        thrust_g = min(max(float(np.linalg.norm(lift)) / gravity, config.thrust_min_g), config.thrust_max_g)
        return thrust_g * gravity, np.minimum(np.maximum(angular, -most_rad_s2), most_rad_s2)

    def _rest(self) -> None:
        """Level on its legs, with the motors idling against the weight."""
        yaw_rad = float(euler_from_q(self._q)[2])
        self._q, self._rate, self._angular = q_from_euler(0.0, 0.0, yaw_rad), np.zeros(3), np.zeros(3)
        self._integral = np.zeros(3)

    def _stand(self, dt_s: float, vel_before: Float, down_command_m_s: float, floor_down_m: float) -> None:
        self.on_ground = down_command_m_s > -_LIFT_OFF_M_S
        if self.on_ground:
            self._vel = vel_before * math.exp(-dt_s / _LEG_TIME_S)
        else:
            self._vel[2] = min(self._vel[2], 0.0)
        self._pos[2] = floor_down_m
