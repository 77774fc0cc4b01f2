"""The Yamaha RMAX with its own attitude control, as Conte's thesis (2009) simulates it, chapter 3. At 50 Hz there.

Four identified transfer functions (3.4) lead from the inputs of the inner loop (YACS), in its units, to roll, pitch,
yaw rate and vertical acceleration; body rates follow by (3.7), velocities by (3.9) and (3.10), with drag against the
air: ``X_u``, ``Y_v``, ``Z_w`` times the velocity relative to wind and gusts. The identification is of the hover; the
thesis finds it good to 10 m/s. The roll that balances the tail rotor (4.5 degrees) is zero here, as there.

Heave differs from the print. The fourth transfer function has a zero at s = 0: a held throttle gives an acceleration
that dies down at 0.95 / s, that is a rate of climb, so the damping of the helicopter's own climb is in what was
identified. With ``Z_w w`` on top, as (3.9) is printed, the climb itself dies down at 0.6 / s and all of the throttle
lifts the helicopter by 11 m, while table 4.1 has climbs of 30 m. ``Z_w`` therefore acts on what the throttle did not
cause: gusts, and the weight in a bank. ``Heave.AS_PRINTED`` is (3.9) to the letter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import StrEnum

import numpy as np
from scipy.linalg import block_diag, expm
from scipy.signal import tf2ss

from estimator.geometry.checks import check_step
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q, q_from_euler, wrap_pi
from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.vehicles.gauss_markov import GaussMarkov
from simulator.vehicles.inertial import InertialReadings
from simulator.vehicles.state import VehicleState, check_start

INPUT_LIMIT = 500.0
"""Inputs run from minus to plus this, in YACS units (section 3.5.1)."""
_LONGEST_STEP_S = 0.1
_GUST_TIME_S = 3.0


@dataclass(frozen=True, slots=True)
class TransferFunction:
    """Coefficients of falling powers of s."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]


def _product(*factors: tuple[float, ...]) -> tuple[float, ...]:
    whole = (1.0,)
    for factor in factors:
        whole = tuple(np.convolve(whole, factor).tolist())
    return whole


ROLL = TransferFunction(_product((2.3,), (1, 3.87, 53.3)), _product((1, 6.29, 16.2), (1, 8.97, 168)))
"""Degrees of roll by aileron, (3.4)."""
PITCH = TransferFunction(_product((0.5,), (1, 9.76, 75.5)), _product((1, 3, 5.55), (1, 2.06, 123.5)))
"""Degrees of pitch by elevator."""
YAW_RATE = TransferFunction(_product((9.7,), (1, 12.25)), _product((1, 4.17), (1, 3.5, 213.4)))
"""Degrees a second of the body's yaw rate by rudder."""
HEAVE = TransferFunction(_product((0.0828,), (1, 0), (1, 3.37)), _product((1, 0.95), (1, 13.1, 214.1)))
"""g of acceleration upwards along the body's axis by throttle: T = -g - a_Z (3.10)."""

# What an input of one unit settles at; of the throttle, whose acceleration dies down, the velocity gained by then.
_DEGREES_OF_ROLL, _DEGREES_OF_PITCH, _DEGREES_S_OF_YAW = (
    tf.numerator[-1] / tf.denominator[-1] for tf in (ROLL, PITCH, YAW_RATE)
)
_G_S_OF_CLIMB = HEAVE.numerator[-2] / HEAVE.denominator[-1]


class Heave(StrEnum):
    """What ``Z_w`` damps."""

    NOT_OF_THROTTLE = "not_of_throttle"
    AS_PRINTED = "as_printed"


@dataclass(frozen=True, slots=True)
class RmaxConfig:
    """Derivatives of (3.9), fitted to flights there, and what a real helicopter is off by.

    ``trim_std_rad`` is of a constant roll and pitch beside those that are commanded, drawn from the seed: figure 3.6
    shows such offsets.
    """

    x_u_per_s: float = -0.025
    y_v_per_s: float = -0.1
    z_w_per_s: float = -0.6
    heave: Heave = Heave.NOT_OF_THROTTLE
    trim_std_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in ("x_u_per_s", "y_v_per_s", "z_w_per_s"):
            if not -10.0 < getattr(self, name) <= 0.0:
                message = f"{name} must be a damping, from -10 to 0, not {getattr(self, name)}"
                raise ValueError(message)
        if not 0.0 <= self.trim_std_rad < 0.5:
            message = f"trim_std_rad must be from 0 to 0.5, not {self.trim_std_rad}"
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class YacsInput:
    """Inputs relative to trim, in YACS units; what is beyond the limits is held at them."""

    aileron: float = 0.0
    elevator: float = 0.0
    rudder: float = 0.0
    throttle: float = 0.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not math.isfinite(value):
                message = f"{one.name} must be finite, not {value}"
                raise ValueError(message)
            object.__setattr__(self, one.name, min(max(float(value), -INPUT_LIMIT), INPUT_LIMIT))


def yacs_input(roll_rad: float, pitch_rad: float, yaw_rate_rad_s: float, climb_m_s: float) -> YacsInput:
    """Inputs that hold, once everything has settled in still air, this roll, pitch, yaw rate and climb."""
    return YacsInput(
        aileron=math.degrees(roll_rad) / _DEGREES_OF_ROLL,
        elevator=math.degrees(pitch_rad) / _DEGREES_OF_PITCH,
        rudder=math.degrees(yaw_rate_rad_s) / _DEGREES_S_OF_YAW,
        throttle=climb_m_s / (9.81 * _G_S_OF_CLIMB),
    )


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeResponse:
    """Roll, pitch, their rates, the body's yaw rate and the acceleration upwards along its axis."""

    roll_rad: float
    pitch_rad: float
    roll_rate_rad_s: float
    pitch_rate_rad_s: float
    yaw_rate_rad_s: float
    lift_g: float


class AttitudeDynamics:
    """(3.4) in state space, exact for inputs that are held over a step of any length."""

    def __init__(self) -> None:
        scale = math.pi / 180.0
        parts = [tf2ss(tf.numerator, tf.denominator) for tf in (ROLL, PITCH, YAW_RATE, HEAVE)]
        self._a: Float = block_diag(*[part[0] for part in parts])
        self._b: Float = block_diag(*[part[1] for part in parts])
        c: Float = block_diag(*[part[2] for part in parts]) * np.array((scale, scale, scale, 1.0))[:, None]
        # Roll and pitch are two orders of s below their inputs, so that their rates are outputs of the state too.
        self._c: Float = np.vstack((c, (c @ self._a)[:2]))
        self._x: Float = np.zeros(len(self._a))
        self._dt_s = 0.0
        self._over: Float = np.zeros((0, 0))

    def step(self, dt_s: float, command: YacsInput) -> AttitudeResponse:
        """The response ``dt_s`` later."""
        if dt_s != self._dt_s:
            self._dt_s, self._over = dt_s, self._held(dt_s)
        inputs = (command.aileron, command.elevator, command.rudder, command.throttle)
        self._x = self._over @ np.concatenate((self._x, inputs))
        return self.response

    @property
    def response(self) -> AttitudeResponse:
        """The response now."""
        roll, pitch, yaw_rate, lift, roll_rate, pitch_rate = (self._c @ self._x).tolist()
        return AttitudeResponse(roll, pitch, roll_rate, pitch_rate, yaw_rate, lift)

    def _held(self, dt_s: float) -> Float:
        n, m = self._b.shape
        whole = np.zeros((n + m, n + m))
        whole[:n, :n], whole[:n, n:] = self._a, self._b
        held: Float = expm(whole * dt_s)[:n]
        return held


class Rmax:
    """Integrates the motion; commanded in YACS units. ``wind_ned_m_s`` (3,) is steady, gusts come from the seed.

    Raises
    ------
    ValueError
        Position or wind are not three finite numbers, the heading is not finite, or the gusts' deviation is negative.
    """

    def __init__(
        self, frame: LocalFrame, pos_ned_m: Float, yaw_rad: float, seed: int, wind_ned_m_s: Float, gust_std_m_s: float,
        config: RmaxConfig | None = None,
    ) -> None:  # fmt: skip
        check_start(pos_ned_m, yaw_rad, wind_ned_m_s, gust_std_m_s)
        self.config = config or RmaxConfig()
        self._mean_wind: Float = np.array(wind_ned_m_s, np.float64)
        self._gust = GaussMarkov(rng_for(seed, "air", "gusts"), gust_std_m_s, _GUST_TIME_S, 3)
        trim = self.config.trim_std_rad * rng_for(seed, "trim").standard_normal(2)
        self._trim = (float(trim[0]), float(trim[1]))
        self._readings = InertialReadings(frame)
        self._attitude = AttitudeDynamics()
        self._yaw_rad = wrap_pi(float(yaw_rad))
        # Forward, right, down by throttle, down by all else; body axes.
        self._uvw: Float = np.zeros(4)
        self._pos: Float = np.array(pos_ned_m, np.float64)
        self._vel: Float = np.zeros(3)
        self._q = q_from_euler(*self._trim, self._yaw_rad)

    def step(self, t_us: int, dt_s: float, command: YacsInput) -> VehicleState:
        """Advance by ``dt_s`` to the time ``t_us``.

        Raises
        ------
        ValueError
            ``dt_s`` is not above 0 and at most 0.1 s: the integration is of second order.
        """
        check_step(dt_s, _LONGEST_STEP_S)
        wind = self._mean_wind + self._gust.step(dt_s) * (1.0, 1.0, 0.5)
        before, after = self._attitude.response, self._attitude.step(dt_s, command)
        slope, yaw_rate = self._slopes(self._uvw, self._yaw_rad, before, wind)
        ahead, yaw_rate_ahead = self._slopes(self._uvw + dt_s * slope, self._yaw_rad + dt_s * yaw_rate, after, wind)
        self._uvw = self._uvw + 0.5 * dt_s * (slope + ahead)
        self._yaw_rad = wrap_pi(self._yaw_rad + 0.5 * dt_s * (yaw_rate + yaw_rate_ahead))
        angle = np.array((after.roll_rad + self._trim[0], after.pitch_rad + self._trim[1], self._yaw_rad))
        q = q_from_euler(*angle)
        vel = matrix_from_q(q) @ (self._uvw[0], self._uvw[1], self._uvw[2] + self._uvw[3])
        self._pos = self._pos + 0.5 * dt_s * (self._vel + vel)
        state = self._readings.state(t_us, dt_s, self._pos, vel, angle, wind, q, self._vel, self._q)
        self._vel, self._q = vel, q
        return state

    def _slopes(self, uvw: Float, yaw_rad: float, now: AttitudeResponse, wind: Float) -> tuple[Float, float]:
        """Derivatives of the velocities (4,), (3.9), and of the heading, (3.7)."""
        config, g = self.config, self._readings.gravity_m_s2
        roll, pitch, r = now.roll_rad + self._trim[0], now.pitch_rad + self._trim[1], now.yaw_rate_rad_s
        sin_roll, cos_roll, sin_pitch, cos_pitch = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
        q = (now.pitch_rate_rad_s + r * sin_roll) / cos_roll
        yaw_rate = (q * sin_roll + r * cos_roll) / cos_pitch
        p = now.roll_rate_rad_s - yaw_rate * sin_pitch
        air = matrix_from_q(q_from_euler(roll, pitch, yaw_rad)).T @ wind
        u, v, by_throttle, other = uvw.tolist()
        w = by_throttle + other
        lift = -9.81 * now.lift_g
        fall = config.z_w_per_s * (other - air[2]) - g - p * v + q * u + g * cos_pitch * cos_roll
        if config.heave is Heave.AS_PRINTED:
            lift += config.z_w_per_s * by_throttle
        return np.array((
            config.x_u_per_s * (u - air[0]) - q * w + r * v - g * sin_pitch,
            config.y_v_per_s * (v - air[1]) - r * u + p * w + g * cos_pitch * sin_roll,
            lift,
            fall,
        )), yaw_rate  # fmt: skip
