"""How fast a path may be flown: three target velocities, of which the least counts. Pure.

Conte's thesis (2009), section 4.3.3: by acceleration, cruise and braking (4.19, 4.20), by what the helicopter can turn
(4.15, 4.16, 4.21), by what it can sink without flying into its own vortex ring (4.23). All are speeds along the path.

The maximum yaw rate is printed as 40 rad/s; degrees are meant: figure 4.6 and the helicopter leave no other choice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from estimator.types import Float


@dataclass(frozen=True, slots=True)
class FlightEnvelope:
    """Limits of the flight, as in section 4.3.3 of the thesis.

    ``load_factor_max`` is of the lift against the weight. Descents steeper than ``steep_rad`` sink at
    ``steep_descent_m_s`` at most, others at ``descent_m_s``. ``braking_m_s2`` is what is reckoned with ahead of a bend
    or an end; the thesis has one number for both.

    Raises
    ------
    ValueError
        A limit is not positive and finite, or the load factor is not above 1.
    """

    yaw_rate_max_rad_s: float = math.radians(40.0)
    roll_max_rad: float = math.radians(15.0)
    load_factor_max: float = 1.1
    acceleration_m_s2: float = 1.2
    braking_m_s2: float = 1.2
    descent_m_s: float = 3.0
    steep_descent_m_s: float = 1.5
    steep_rad: float = math.radians(30.0)
    gravity_m_s2: float = 9.81

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (math.isfinite(value) and value > 0.0):
                message = f"{one.name} must be positive, not {value}"
                raise ValueError(message)
        if not self.load_factor_max > 1.0:
            message = f"load_factor_max must be above 1, not {self.load_factor_max}"
            raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class TurnSpeeds:
    """Horizontal speeds (...) that keep yaw rate, roll and load factor within limits: u_1, u_3, u_4 of (4.15).

    u_2, by the greatest pitch, is above 100 m/s and no limit. Infinite where nothing is turned.
    """

    yaw_rate_m_s: Float
    roll_m_s: Float
    load_factor_m_s: Float

    @property
    def least_m_s(self) -> Float:
        """u_max of (4.16)."""
        least: Float = np.minimum(np.minimum(self.yaw_rate_m_s, self.roll_m_s), self.load_factor_m_s)
        return least


def turn_speeds(turn_curvature_per_m: ArrayLike, envelope: FlightEnvelope) -> TurnSpeeds:
    """(4.15) for curvatures (...) of the track over ground.

    The thrust T is negative (upward along z), so that with T_max = -N g the last is (g^2 (N - 1))^(1/4) sqrt(R).
    """
    k = np.abs(np.asarray(turn_curvature_per_m, np.float64))
    with np.errstate(divide="ignore"):
        radius_m = 1.0 / k
    g = envelope.gravity_m_s2
    return TurnSpeeds(
        radius_m * envelope.yaw_rate_max_rad_s,
        np.sqrt(envelope.roll_max_rad * g * radius_m),
        np.sqrt(math.sqrt(envelope.load_factor_max - 1.0) * g * radius_m),
    )


def turning_speed_m_s(direction_ned: Float, turn_curvature_per_m: ArrayLike, envelope: FlightEnvelope) -> Float:
    """v_targ2 (...), (4.21), along unit vectors (..., 3): the fuselage is level and along the track."""
    level = np.hypot(direction_ned[..., 0], direction_ned[..., 1])
    speed: Float = turn_speeds(turn_curvature_per_m, envelope).least_m_s / np.maximum(level, 1e-6)
    return speed


def descent_speed_m_s(direction_ned: Float, envelope: FlightEnvelope) -> Float:
    """v_targ3 (...), (4.23), along unit vectors (..., 3); infinite where the path does not go down."""
    down = direction_ned[..., 2]
    angle = np.arctan2(down, np.hypot(direction_ned[..., 0], direction_ned[..., 1]))
    sink = np.where(angle >= envelope.steep_rad, envelope.steep_descent_m_s, envelope.descent_m_s)
    speed: Float = np.where(down > 0.0, sink / np.where(down > 0.0, down, 1.0), np.inf)
    return speed


def braking_speed_m_s(distance_m: ArrayLike, end_m_s: ArrayLike, envelope: FlightEnvelope) -> Float:
    """v_brake (...), (4.20): what can be brought down to ``end_m_s`` over ``distance_m``."""
    speed: Float = np.sqrt(2.0 * envelope.braking_m_s2 * np.maximum(distance_m, 0.0) + np.square(end_m_s))
    return speed


def stopping_speed_m_s(distance_m: float, gain_per_s: float, envelope: FlightEnvelope) -> float:
    """What is brought to a stop over ``distance_m``: (4.20) until it is slow, then in proportion to what is left.

    (4.20) alone brakes at full up to the last centimetre. The proportional part begins where it brakes as much, and
    the rest is laid that much earlier, so that the braking is nowhere above the envelope's.
    """
    a = envelope.braking_m_s2
    if distance_m < a / gain_per_s**2:
        return gain_per_s * max(distance_m, 0.0)
    return math.sqrt(2.0 * a * distance_m - (a / gain_per_s) ** 2)


def allowed_ahead_m_s(length_m: Float, limit_m_s: Float, envelope: FlightEnvelope) -> Float:
    """Speeds (n,) at lengths (n,), in order, from which every limit (n,) further on can still be braked down to."""
    room = 2.0 * envelope.braking_m_s2 * length_m
    best = np.minimum.accumulate((np.square(limit_m_s) + room)[::-1])[::-1]
    allowed: Float = np.sqrt(np.maximum(best - room, 0.0))
    return allowed


class SpeedPhase(StrEnum):
    """States of figure 4.5."""

    ACCELERATION = "acceleration"
    CRUISE = "cruise"
    BRAKING = "braking"


@dataclass(frozen=True, slots=True)
class TargetSpeed:
    """v_targ1 to v_targ3 and the phase; ``speed_m_s`` is the least, which is flown."""

    along_m_s: float
    turning_m_s: float
    descent_m_s: float
    phase: SpeedPhase

    @property
    def speed_m_s(self) -> float:
        """v_targ."""
        return min(self.along_m_s, self.turning_m_s, self.descent_m_s)


class SpeedTarget:
    """The state machine of figure 4.5.

    There the constant acceleration belongs to the first segment only. Here it is a limit on every rise, so that a
    segment that comes late, or the end of a bend, is no jump of the target either.
    """

    def __init__(self, envelope: FlightEnvelope, speed_m_s: float = 0.0) -> None:
        self._envelope, self._last_m_s = envelope, max(speed_m_s, 0.0)

    def step(
        self, dt_s: float, cruise_m_s: float, brake_m_s: float, turning_m_s: float, descent_m_s: float
    ) -> TargetSpeed:
        """The target after ``dt_s`` more, by v_cruise, v_brake, v_targ2 and v_targ3."""
        risen_m_s = self._last_m_s + self._envelope.acceleration_m_s2 * dt_s
        if brake_m_s < min(cruise_m_s, risen_m_s):
            along_m_s, phase = brake_m_s, SpeedPhase.BRAKING
        elif risen_m_s < cruise_m_s:
            along_m_s, phase = risen_m_s, SpeedPhase.ACCELERATION
        else:
            along_m_s, phase = cruise_m_s, SpeedPhase.CRUISE
        target = TargetSpeed(along_m_s, turning_m_s, descent_m_s, phase)
        self._last_m_s = target.speed_m_s
        return target
