"""From errors of position, velocity and heading to commands of roll, pitch, yaw rate and climb. Pure.

Conte's thesis (2009), section 4.4, equation (4.25), and the lead compensator (4.26) of the roll. Gains are not
printed there. Here they are of accelerations (1/s^2, 1/s) and become tilts by gravity, so that they do not belong to
one helicopter; pitching down accelerates forward, hence the sign. Errors are in axes that are level and turned by the
heading: in body axes, as printed, a banked helicopter would take a part of its height error for a lateral one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from estimator.geometry.checks import check_step, check_vectors
from estimator.geometry.rotation import wrap_pi
from estimator.types import Float
from guidance.path_following import PathReference

_LONGEST_STEP_S = 1.0


@dataclass(frozen=True, slots=True)
class LeadCompensator:
    """(4.26): C(s) = K a (1 + T s) / (1 + a T s) + K_I / s, with T of one second there.

    ``gain`` is K, what passes at high frequencies; at low ones it is K a, and the integral does the rest.
    It works on what the roll lacks, and its output is added to the roll that is wanted: with the compensator in place
    of the direct way, not beside it, no choice of numbers is faster than the inner loop alone and has a margin.
    ``roll_max_rad`` bounds the command and the integral.

    Raises
    ------
    ValueError
        A number is not positive, or ``ratio`` (a) is not below 1: it would lag.
    """

    gain: float
    ratio: float
    integral_per_s: float
    time_constant_s: float = 1.0
    roll_max_rad: float = math.radians(20.0)

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (math.isfinite(value) and value > 0.0):
                message = f"{one.name} must be positive, not {value}"
                raise ValueError(message)
        if not self.ratio < 1.0:
            message = f"ratio must be below 1, not {self.ratio}"
            raise ValueError(message)


class LeadFilter:
    """A lead compensator in time: its lag part is exact for an error that is held over the step."""

    def __init__(self, compensator: LeadCompensator) -> None:
        self._c = compensator
        self._low_rad: float | None = None
        self._integral_rad = 0.0

    def step(self, dt_s: float, wanted_rad: float, roll_rad: float) -> float:
        """The roll to command, within the limit, so that the roll comes to be the one that is wanted."""
        c, error_rad = self._c, wanted_rad - roll_rad
        if self._low_rad is None:
            self._low_rad = error_rad
        # K a (1 + T s) / (1 + a T s) = K - K (1 - a) / (1 + a T s).
        self._low_rad += (1.0 - math.exp(-dt_s / (c.ratio * c.time_constant_s))) * (error_rad - self._low_rad)
        command_rad = wanted_rad + c.gain * (error_rad - (1.0 - c.ratio) * self._low_rad) + self._integral_rad
        # Where the command is at its limit an integral would only have to be taken back later.
        if abs(command_rad) < c.roll_max_rad or command_rad * error_rad < 0.0:
            self._integral_rad += c.integral_per_s * error_rad * dt_s
        self._integral_rad = _bounded(self._integral_rad, c.roll_max_rad)
        return _bounded(command_rad, c.roll_max_rad)


@dataclass(frozen=True, slots=True)
class OuterLoopConfig:
    """Gains of (4.25) and limits of the commands.

    ``yaw_per_s`` is K1^y. ``forward_*`` are K1^p to K4^p (position, velocity, its derivative, its integral),
    ``lateral_*`` are K1^r and K2^r, ``vertical_*`` K1^t to K3^t of a climb. ``lead`` closes the
    roll's own loop by (4.26).

    Beyond the thesis are the integrals of the position's errors, ``lateral_integral_per_s3`` and
    ``vertical_integral_per_s2``, which take out steady wind and trim (an integral of the velocity's error is no more
    than another position error); ``climb_feed_forward``, a share of the target's own climb; and
    ``pitch_feed_forward``, a share of the climb that a pitched helicopter makes by flying where it points. With all
    four zero it is (4.25): see ``as_published``.

    The gains are chosen on the transfer functions of the RMAX (3.4) with 30 ms of delay: phase margins of 46 degrees
    (lateral), 46 (forward) and 100 (vertical). Without ``lead`` the lateral ones would have 30, and must be less.
    """

    yaw_per_s: float = 0.8
    forward_position_per_s2: float = 0.25
    forward_velocity_per_s: float = 1.2
    forward_derivative: float = 0.0
    forward_integral_per_s2: float = 0.1
    lateral_position_per_s2: float = 1.0
    lateral_velocity_per_s: float = 1.5
    lateral_integral_per_s3: float = 0.25
    vertical_position_per_s: float = 1.6
    vertical_velocity: float = 1.6
    vertical_integral_per_s: float = 0.0
    vertical_integral_per_s2: float = 0.4
    climb_feed_forward: float = 1.0
    pitch_feed_forward: float = 1.0
    lead: LeadCompensator | None = LeadCompensator(gain=2.0, ratio=0.4, integral_per_s=1.0)
    roll_max_rad: float = math.radians(20.0)
    pitch_max_rad: float = math.radians(15.0)
    yaw_rate_max_rad_s: float = math.radians(40.0)
    climb_max_m_s: float = 4.0
    integral_max_m_s2: float = 1.5
    gravity_m_s2: float = 9.81

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if one.name != "lead" and not (math.isfinite(value) and value >= 0.0):
                message = f"{one.name} must not be negative, not {value}"
                raise ValueError(message)


def as_published(lead: LeadCompensator | None = None) -> OuterLoopConfig:
    """(4.25) and nothing else, with or without the compensator; its gains are this project's (margin: 40 degrees)."""
    return OuterLoopConfig(
        lateral_position_per_s2=0.6, lateral_velocity_per_s=1.3, lateral_integral_per_s3=0.0,
        vertical_position_per_s=1.2, vertical_velocity=1.2, vertical_integral_per_s=0.3, vertical_integral_per_s2=0.0,
        climb_feed_forward=0.0, pitch_feed_forward=0.0, lead=lead,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class InnerLoopCommand:
    """What the inner loop shall have: roll, pitch (nose up), yaw rate (to the right), climb (upwards)."""

    roll_rad: float
    pitch_rad: float
    yaw_rate_rad_s: float
    climb_m_s: float


@dataclass(frozen=True, slots=True, eq=False)
class FlightState:
    """The vehicle as it is known: position and velocity (3,), roll, pitch, heading."""

    pos_ned_m: Float
    vel_ned_m_s: Float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float

    def __post_init__(self) -> None:
        check_vectors(pos_ned_m=self.pos_ned_m, vel_ned_m_s=self.vel_ned_m_s)
        for name in ("roll_rad", "pitch_rad", "yaw_rad"):
            if not math.isfinite(getattr(self, name)):
                message = f"{name} must be finite, not {getattr(self, name)}"
                raise ValueError(message)


class OuterLoop:
    """Equation (4.25) in steps of time."""

    def __init__(self, config: OuterLoopConfig | None = None) -> None:
        self.config = config or OuterLoopConfig()
        self._lead = None if self.config.lead is None else LeadFilter(self.config.lead)
        self._forward = self._lateral = self._vertical = 0.0
        self._forward_error_m_s: float | None = None

    def step(self, dt_s: float, reference: PathReference, state: FlightState) -> InnerLoopCommand:
        """Commands for the next ``dt_s``.

        Raises
        ------
        ValueError
            ``dt_s`` is not above 0 and at most 1 s.
        """
        check_step(dt_s, _LONGEST_STEP_S)
        off = _level_axes(reference.pos_ned_m - state.pos_ned_m, state.yaw_rad)
        lacking = _level_axes(reference.vel_ned_m_s - state.vel_ned_m_s, state.yaw_rad)
        config = self.config
        roll_rad = _bounded(
            reference.roll_rad + self._sideways(dt_s, off[1], lacking[1]) / config.gravity_m_s2, config.roll_max_rad
        )
        if self._lead is not None:
            roll_rad = _bounded(self._lead.step(dt_s, roll_rad, state.roll_rad), config.roll_max_rad)
        pitch_rad = -self._forwards(dt_s, off[0], lacking[0]) / config.gravity_m_s2
        heading_error_rad = wrap_pi(reference.yaw_rad - state.yaw_rad)
        yaw_rate_rad_s = reference.yaw_rate_rad_s + config.yaw_per_s * heading_error_rad
        climb_m_s = -config.climb_feed_forward * float(reference.vel_ned_m_s[2]) - self._down(dt_s, off[2], lacking[2])
        # The throttle lifts along the body's axis; a helicopter that flies forward nose down goes down besides.
        forward_m_s = _level_axes(state.vel_ned_m_s, state.yaw_rad)[0]
        climb_m_s -= config.pitch_feed_forward * forward_m_s * math.tan(state.pitch_rad)
        return InnerLoopCommand(
            roll_rad,
            _bounded(pitch_rad, config.pitch_max_rad),
            _bounded(yaw_rate_rad_s, config.yaw_rate_max_rad_s),
            _bounded(climb_m_s, config.climb_max_m_s),
        )

    def _forwards(self, dt_s: float, off_m: float, lacking_m_s: float) -> float:
        """The PITCH row of (4.25) as an acceleration; the integral waits where the pitch is at its limit."""
        config = self.config
        before = self._forward_error_m_s
        rate = 0.0 if before is None else (lacking_m_s - before) / dt_s
        self._forward_error_m_s = lacking_m_s
        wanted = (
            config.forward_position_per_s2 * off_m
            + config.forward_velocity_per_s * lacking_m_s
            + config.forward_derivative * rate
        )
        most = config.pitch_max_rad * config.gravity_m_s2
        if abs(wanted + self._forward) < most or wanted * self._forward < 0.0:
            more = config.forward_integral_per_s2 * lacking_m_s * dt_s
            self._forward = _bounded(self._forward + more, config.integral_max_m_s2)
        return wanted + self._forward

    def _sideways(self, dt_s: float, off_m: float, lacking_m_s: float) -> float:
        """The ROLL row of (4.25) without its feed-forward, and the integral, as an acceleration."""
        config = self.config
        more = config.lateral_integral_per_s3 * off_m * dt_s
        self._lateral = _bounded(self._lateral + more, config.integral_max_m_s2)
        return config.lateral_position_per_s2 * off_m + config.lateral_velocity_per_s * lacking_m_s + self._lateral

    def _down(self, dt_s: float, off_m: float, lacking_m_s: float) -> float:
        """The THR row of (4.25) as a velocity downwards."""
        config = self.config
        more = (config.vertical_integral_per_s * lacking_m_s + config.vertical_integral_per_s2 * off_m) * dt_s
        self._vertical = _bounded(self._vertical + more, config.climb_max_m_s)
        return config.vertical_position_per_s * off_m + config.vertical_velocity * lacking_m_s + self._vertical


def _level_axes(vector_ned: Float, yaw_rad: float) -> tuple[float, float, float]:
    """A vector (3,) forward, right and down of a heading."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    north, east, down = vector_ned.tolist()
    return c * north + s * east, c * east - s * north, down


def _bounded(value: float, most: float) -> float:
    return min(max(value, -most), most)
