"""The control point on a path, and what the outer loop shall reach there. Pure, in steps of any length.

Conte's thesis (2009), sections 4.3.2 and 4.3.3. The control point is the point of the path that is closest to the
helicopter, sought from where it was in the step before (4.6 to 4.10): the path has no times, and a helicopter that is
slow is not left behind. As printed, (4.8) and (4.10) would move the point away from the helicopter; the error is taken
here from the control point to the helicopter.

Segments come one after the other while they are flown. Until a segment's successor is there it ends in a stop,
whatever speed its end is to be passed at: a helicopter that hears no more of its planner brakes and hovers at the end.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from estimator.geometry.checks import check_step, check_vectors
from estimator.types import Float
from guidance.path import PathSegment
from guidance.velocity_profile import (
    FlightEnvelope,
    SpeedTarget,
    TargetSpeed,
    allowed_ahead_m_s,
    braking_speed_m_s,
    descent_speed_m_s,
    stopping_speed_m_s,
    turning_speed_m_s,
)

MAX_SEGMENTS = 512
"""So many segments wait at most."""
_ITERATIONS = 6
_GAP_M, _KINK_RAD = 0.5, math.radians(5.0)
_LONGEST_STEP_S = 1.0
_UPRIGHT = 1e-3


@dataclass(frozen=True, slots=True)
class PathFollowingConfig:
    """How a path is followed.

    With ``look_ahead`` the limits of bends further on are braked for in time; without, as in the thesis, they are met
    where they begin. ``stop_gain_per_s`` times the distance left is the speed in the last metres before a stop. The
    curvature that is fed forward to the roll is the one ``preview_s`` ahead, that to the yaw rate ``yaw_preview_s``:
    about the delays of an RMAX whose roll has its compensator, zero in the thesis. ``as_published`` has none of the
    three.
    """

    envelope: FlightEnvelope = field(default_factory=FlightEnvelope)
    look_ahead: bool = True
    stop_gain_per_s: float = 0.6
    preview_s: float = 0.18
    yaw_preview_s: float = 0.2

    def __post_init__(self) -> None:
        if not (math.isfinite(self.stop_gain_per_s) and self.stop_gain_per_s > 0.0):
            message = f"stop_gain_per_s must be positive, not {self.stop_gain_per_s}"
            raise ValueError(message)
        for name, value in (("preview_s", self.preview_s), ("yaw_preview_s", self.yaw_preview_s)):
            if not 0.0 <= value <= 5.0:
                message = f"{name} must be from 0 to 5 s, not {value}"
                raise ValueError(message)


def as_published(envelope: FlightEnvelope | None = None) -> PathFollowingConfig:
    """Limits of bends where they begin, curvature where the helicopter is: section 4.3.3 and nothing else."""
    return PathFollowingConfig(envelope or FlightEnvelope(), look_ahead=False, preview_s=0.0, yaw_preview_s=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class PathReference:
    """What to have now: the control point (3,), the target velocity (3,) along the path, the heading, feed-forwards.

    ``yaw_rate_rad_s`` and ``roll_rad`` are r_ff and phi_ff of (4.14). ``remaining_m`` is what is left of the known
    path, ``segment`` counts from 0, ``s`` is the parameter on it.
    """

    pos_ned_m: Float
    vel_ned_m_s: Float
    yaw_rad: float
    yaw_rate_rad_s: float
    roll_rad: float
    target: TargetSpeed
    segment: int
    s: float
    remaining_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """A segment that was sent, and the limits along it, (n,) each at the lengths of its curve's table."""

    segment: PathSegment
    turning_m_s: Float
    descent_m_s: Float


@dataclass(frozen=True, slots=True, eq=False)
class _Speeds:
    """Along the known path, (n,) each: arc length since the first segment's start, and speeds allowed there.

    Between samples the square of a speed that is braked is linear, hence ``ends_m2_s2``.
    """

    length_m: Float
    turning_m_s: Float
    descent_m_s: Float
    ends_m2_s2: Float


class PathFollower:
    """Moves the control point along the segments it is given."""

    def __init__(self, config: PathFollowingConfig | None = None) -> None:
        self.config = config or PathFollowingConfig()
        self._segments: deque[_Known] = deque()
        self._passed = 0
        self._s = 0.0
        self._speeds: _Speeds | None = None
        self._target: SpeedTarget | None = None
        self._yaw_rad: float | None = None

    def add(self, segment: PathSegment) -> None:
        """Take the next segment.

        Raises
        ------
        ValueError
            It does not begin where the last one ends (half a metre is allowed), or leads elsewhere (5 degrees) although
            the last one's end is passed at speed, or too many wait already.
        """
        if len(self._segments) >= MAX_SEGMENTS:
            message = f"{MAX_SEGMENTS} segments wait already"
            raise ValueError(message)
        if self._segments:
            _check_joint(self._segments[-1].segment, segment)
        self._segments.append(_known(segment, self.config.envelope))
        self._speeds = None

    def step(self, dt_s: float, pos_ned_m: Float, vel_ned_m_s: Float, yaw_rad: float) -> PathReference:
        """What to have after ``dt_s`` more, for a vehicle at a position and velocity (3,) with a heading.

        Raises
        ------
        ValueError
            There is no segment yet, ``dt_s`` is not above 0 and at most 1 s, or a number is not finite.
        """
        self._check(dt_s, pos_ned_m, vel_ned_m_s, yaw_rad)
        self._move(pos_ned_m)
        curve = self._segments[0].segment.curve
        tangent = curve.tangent(self._s)
        direction = tangent / float(np.linalg.norm(tangent))
        if self._target is None:
            self._target = SpeedTarget(self.config.envelope, float(direction @ vel_ned_m_s))
        if float(np.hypot(direction[0], direction[1])) > _UPRIGHT:
            self._yaw_rad = math.atan2(direction[1], direction[0])
        elif self._yaw_rad is None:
            self._yaw_rad = yaw_rad
        target, remaining_m = self._target_speed(dt_s, self._target)
        speed_m_s = max(float(direction @ vel_ned_m_s), 0.0) * float(np.hypot(direction[0], direction[1]))
        rolled = self._turn_ahead(speed_m_s * self.config.preview_s)
        turned = self._turn_ahead(speed_m_s * self.config.yaw_preview_s)
        # (4.14) says u^2 / (g R), for small angles.
        roll_rad = math.atan(speed_m_s**2 * rolled / self.config.envelope.gravity_m_s2)
        return PathReference(
            pos_ned_m=curve.point(self._s), vel_ned_m_s=target.speed_m_s * direction, yaw_rad=self._yaw_rad,
            yaw_rate_rad_s=speed_m_s * turned, roll_rad=roll_rad, target=target, segment=self._passed, s=self._s,
            remaining_m=remaining_m,
        )  # fmt: skip

    def _check(self, dt_s: float, pos_ned_m: Float, vel_ned_m_s: Float, yaw_rad: float) -> None:
        if not self._segments:
            message = "there is no segment to follow"
            raise ValueError(message)
        check_step(dt_s, _LONGEST_STEP_S)
        check_vectors(pos_ned_m=pos_ned_m, vel_ned_m_s=vel_ned_m_s)
        if not math.isfinite(yaw_rad):
            message = f"yaw_rad must be finite, not {yaw_rad}"
            raise ValueError(message)

    def _move(self, pos_ned_m: Float) -> None:
        """(4.7) and (4.10), a few times, and over to the next segment where this one's end is passed."""
        for _ in range(_ITERATIONS + MAX_SEGMENTS):
            if self._settle(pos_ned_m) or len(self._segments) == 1:
                return
            self._segments.popleft()
            self._passed += 1
            self._s, self._speeds = 0.0, None

    def _settle(self, pos_ned_m: Float) -> bool:
        """Move the control point on its segment; whether it stays there, or has passed the end."""
        curve, passed = self._segments[0].segment.curve, False
        for _ in range(_ITERATIONS):
            tangent = curve.tangent(self._s)
            size = float(np.linalg.norm(tangent))
            error = pos_ned_m - curve.point(self._s)
            # Outside of a bend (4.10) overshoots, the more the further: what it misses is the error along the
            # curvature. Inside it falls short, and the next step goes on.
            bend = max(1.0 - float(error @ curve.curvature(self._s)), 1.0)
            s = self._s + float(error @ tangent) / size**2 / bend
            # Beyond the end is only what is so as seen from the end.
            passed = self._s == 1.0 and s > 1.0
            s = min(max(s, 0.0), 1.0)
            moved, self._s = abs(s - self._s), s
            if (moved * size < 1e-3 and s != 1.0) or passed:
                break
        return not passed

    def _target_speed(self, dt_s: float, target: SpeedTarget) -> tuple[TargetSpeed, float]:
        """The target speed and the length that is left."""
        if self._speeds is None:
            self._speeds = self._speeds_of_path()
        speeds, segment = self._speeds, self._segments[0].segment
        at_m = segment.curve.length_at_m(self._s)
        end_m = segment.curve.length_m
        envelope = self.config.envelope
        remaining_m = float(speeds.length_m[-1]) - at_m
        ends_m_s = math.sqrt(float(np.interp(at_m, speeds.length_m, speeds.ends_m2_s2)))
        brake_m_s = min(ends_m_s, stopping_speed_m_s(remaining_m, self.config.stop_gain_per_s, envelope))
        cruise_m_s = segment.cruise_m_s
        if len(self._segments) > 1 and segment.end_m_s > cruise_m_s:
            # An end to be passed faster than the cruise: it speeds up towards it.
            room = 2.0 * envelope.acceleration_m_s2 * (end_m - at_m)
            cruise_m_s = max(cruise_m_s, math.sqrt(max(segment.end_m_s**2 - room, 0.0)))
        turning, descent = (
            float(np.interp(at_m, speeds.length_m, table)) for table in (speeds.turning_m_s, speeds.descent_m_s)
        )
        return target.step(dt_s, cruise_m_s, brake_m_s, turning, descent), remaining_m

    def _speeds_of_path(self) -> _Speeds:
        envelope = self.config.envelope
        lengths, ends = [], []
        start_m, last = 0.0, len(self._segments) - 1
        for number, known in enumerate(self._segments):
            table = known.segment.curve.lengths.length_m
            end_m_s = 0.0 if number == last else known.segment.end_m_s
            lengths.append(start_m + table)
            ends.append(braking_speed_m_s(table[-1] - table, end_m_s, envelope))
            start_m += float(table[-1])
        length_m = np.concatenate(lengths)
        turn_m_s = np.concatenate([known.turning_m_s for known in self._segments])
        sink_m_s = np.concatenate([known.descent_m_s for known in self._segments])
        if self.config.look_ahead:
            turn_m_s = allowed_ahead_m_s(length_m, turn_m_s, envelope)
            sink_m_s = allowed_ahead_m_s(length_m, sink_m_s, envelope)
        ends_m_s = allowed_ahead_m_s(length_m, np.concatenate(ends), envelope)
        return _Speeds(length_m, turn_m_s, sink_m_s, ends_m_s**2)

    def _turn_ahead(self, distance_m: float) -> float:
        """Curvature of the track ``distance_m`` further on; beyond the known path it is straight."""
        at_m = self._segments[0].segment.curve.length_at_m(self._s) + distance_m
        for known in self._segments:
            curve = known.segment.curve
            if at_m <= curve.length_m:
                return float(curve.turn_curvature(curve.s_at(at_m)))
            at_m -= curve.length_m
        return 0.0


def _known(segment: PathSegment, envelope: FlightEnvelope) -> _Known:
    s = segment.curve.lengths.s
    tangent = segment.curve.tangent(s)
    direction = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
    turning = turning_speed_m_s(direction, segment.curve.turn_curvature(s), envelope)
    # Nothing flies faster than this, and finite numbers can be interpolated.
    return _Known(segment, np.minimum(turning, 1e3), np.minimum(descent_speed_m_s(direction, envelope), 1e3))


def _check_joint(before: PathSegment, after: PathSegment) -> None:
    gap_m = float(np.linalg.norm(after.curve.start_ned_m - before.curve.end_ned_m))
    if gap_m > _GAP_M:
        message = f"the segment begins {gap_m:.2f} m from where the path ends: {_GAP_M} m are allowed"
        raise ValueError(message)
    out, on = before.curve.end_tangent_ned_m, after.curve.start_tangent_ned_m
    cosine = float(out @ on) / float(np.linalg.norm(out) * np.linalg.norm(on))
    if before.end_m_s > 0.0 and math.acos(min(max(cosine, -1.0), 1.0)) > _KINK_RAD:
        message = "the segment leads elsewhere than the path does, which is passed at speed there"
        raise ValueError(message)
