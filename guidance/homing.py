"""Flying home by the estimate: the velocity to fly from where the vehicle is on its way. Pure, at any rate from 5 Hz.

Phases: ``climb`` (straight up or down to the height of the way), ``follow`` (along the path,
``guidance.path_following``), ``arrive`` (over home until it is slow there), ``descend`` (down over home),
``touchdown`` (the last metres: down until the ground holds it), ``landed``, ``abort``; and ``wait``: the estimate is
not good enough to go on by, and the vehicle stands still by its velocity. Once it is good again it goes on.

An estimate that stays lost ends the flight after ``wait_s``: what then, hold or land where it is, is the caller's.
What goes to the autopilot is not the wanted velocity: see ``guidance.velocity_loop``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from estimator.types import Float
from guidance.path import PathSegment
from guidance.path_following import PathFollower, PathFollowingConfig
from guidance.velocity_loop import VelocityLoop, VelocityLoopConfig, changed
from guidance.velocity_profile import FlightEnvelope

_LONGEST_STEP_S = 1.0
_GENTLE = FlightEnvelope(roll_max_rad=math.radians(6.0), acceleration_m_s2=1.0, braking_m_s2=0.8)
"""Bends that a velocity changed by ``acceleration_m_s2`` can follow."""
_CALM = VelocityLoopConfig(gain=1.0, trim_per_s=0.4, damping_s=0.4, pace_s=0.4)
"""At height the velocity is known to 0.2 m/s, not to centimetres as over a pad: a firm loop would shake the vehicle."""


class HomingPhase(StrEnum):
    """How far a flight home is."""

    CLIMB = "climb"
    FOLLOW = "follow"
    ARRIVE = "arrive"
    DESCEND = "descend"
    TOUCHDOWN = "touchdown"
    WAIT = "wait"
    LANDED = "landed"
    ABORT = "abort"
    HOLD = "hold"


_LAST = (HomingPhase.LANDED, HomingPhase.ABORT)


@dataclass(frozen=True, slots=True)
class HomingConfig:
    """Limits of a flight home.

    Towards the path, and home, it flies ``offset_gain_per_s`` times the distance, ``correction_m_s`` at most. Over home
    it has arrived within ``arrived_m`` and slower than ``arrived_m_s``. It sinks by ``sink_per_s`` times the height
    over ground, within ``touchdown_sink_m_s`` and ``sink_m_s``, and not at all ``funnel_m`` beside home; from
    ``touchdown_height_m`` on, which is known as badly as the ground, it goes on down until it has been slower than half
    of the least sink for ``still_for_s``: it stands.

    It waits where the place is known worse than ``std_m``, the velocity worse than ``std_m_s``, or nothing has come
    for ``lost_after_s``; below ``touchdown_height_m`` it goes on. After ``wait_s`` of that it gives up.
    """

    loop: VelocityLoopConfig = field(default_factory=lambda: _CALM)
    path: PathFollowingConfig = field(default_factory=lambda: PathFollowingConfig(_GENTLE))
    acceleration_m_s2: float = 1.2
    offset_gain_per_s: float = 0.4
    correction_m_s: float = 3.0
    climb_m_s: float = 2.0
    climbed_m: float = 3.0
    arrived_m: float = 2.0
    arrived_m_s: float = 0.7
    sink_m_s: float = 2.0
    sink_per_s: float = 0.15
    touchdown_sink_m_s: float = 0.5
    touchdown_height_m: float = 4.0
    funnel_m: float = 4.0
    still_for_s: float = 2.0
    std_m: float = 30.0
    std_m_s: float = 1.0
    lost_after_s: float = 2.0
    wait_s: float = 60.0

    def __post_init__(self) -> None:
        rising = (
            ("touchdown_sink_m_s", self.touchdown_sink_m_s, "sink_m_s", self.sink_m_s),
            ("lost_after_s", self.lost_after_s, "wait_s", self.wait_s),
            ("arrived_m", self.arrived_m, "funnel_m", self.funnel_m),
        )
        for low, less, high, more in rising:
            if not 0.0 < less <= more < math.inf:
                message = f"0 < {low} <= {high} must hold, not {less} and {more}"
                raise ValueError(message)
        for name in ("acceleration_m_s2", "offset_gain_per_s", "correction_m_s", "climb_m_s", "climbed_m", "std_m"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                message = f"{name} must be positive, not {value}"
                raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class HomingEstimate:
    """Where the vehicle is and how sure that is.

    Position and velocity (3,) NED, the standard deviations of both along their worst axes, heading, and the height
    above ground, NaN where the ground is unknown. ``lost`` says that the estimator does not know the place.
    """

    pos_ned_m: Float
    vel_ned_m_s: Float
    std_m: float
    std_m_s: float
    yaw_rad: float
    alt_agl_m: float
    lost: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class HomingCommand:
    """What to fly now: a velocity (3,) NED for the autopilot, the phase, and why in words where it waits or ends.

    ``vel_wanted_ned_m_s`` is the velocity over ground that the set-point is to bring about.
    """

    phase: HomingPhase
    vel_ned_m_s: Float
    vel_wanted_ned_m_s: Float
    reason: str = ""


class HomingGuidance:
    """One flight home along ``segments``, at whose end it lands, or where it is not to, stays over home.

    ``trim_ned_m_s`` (3,) is what an earlier flight found the autopilot's own velocity to be off by.
    """

    def __init__(
        self, segments: Sequence[PathSegment], config: HomingConfig | None = None, *, land: bool = True,
        trim_ned_m_s: Float | None = None,
    ) -> None:  # fmt: skip
        self.config = config or HomingConfig()
        self.phase = HomingPhase.CLIMB
        self.reason = ""
        self.remaining_m = math.inf
        self._follower = PathFollower(self.config.path)
        for segment in segments:
            self._follower.add(segment)
        if not segments:
            message = "a flight home needs a way"
            raise ValueError(message)
        self._start_down_m = float(segments[0].curve.start_ned_m[2])
        self.home_ned_m: Float = np.array(segments[-1].curve.end_ned_m)
        self._land = land
        self._loop = VelocityLoop(self.config.loop, trim_ned_m_s)
        self._wanted: Float | None = None
        self._t_us: int | None = None
        self._good_us = 0
        self._going_on = HomingPhase.CLIMB
        self._still_s = 0.0

    @property
    def over(self) -> bool:
        """Whether nothing more comes."""
        return self.phase in _LAST

    @property
    def over_home(self) -> bool:
        """Whether it is over home or below."""
        return self.phase in (HomingPhase.DESCEND, HomingPhase.TOUCHDOWN) or (
            self.phase is HomingPhase.ARRIVE and not self._land
        )

    @property
    def trim_ned_m_s(self) -> Float:
        """What the autopilot's own velocity is found to be off by, (3,)."""
        return self._loop.trim_ned_m_s

    def abort(self, reason: str) -> None:
        """End the flight, for a reason that the operator is told; one that is over stays as it is."""
        if not self.over:
            self.phase, self.reason = HomingPhase.ABORT, reason

    def stand(self, t_us: int, vel_ned_m_s: Float | None) -> HomingCommand:
        """Stand still over the ground by a velocity (3,) over it; None where that is not known."""
        self._go_on_to(t_us)
        if vel_ned_m_s is None:
            return self._still(self.phase, self.reason)
        dt_s = self._loop.since_last_s(t_us)
        return self._close(np.zeros(3), np.asarray(vel_ned_m_s, np.float64), dt_s, HomingPhase.HOLD, self.reason)

    def step(self, t_us: int, estimate: HomingEstimate | None) -> HomingCommand:
        """The command for ``t_us``, from the estimate at that time; None where there is none."""
        self._go_on_to(t_us)
        if self.over:
            return self._still(self.phase, self.reason)
        why = self._unfit(t_us, estimate)
        if why and self.phase is not HomingPhase.TOUCHDOWN:
            return self._wait(t_us, estimate, why)
        if estimate is None:
            # Committed: down it goes, as straight as the trim keeps it.
            down = np.array((0.0, 0.0, self.config.touchdown_sink_m_s))
            return HomingCommand(self.phase, down + self._loop.level_trim_ned_m_s, down, why)
        self._good_us = t_us
        if self.phase is HomingPhase.WAIT:
            self.phase, self.reason = self._going_on, ""
        dt_s = self._loop.since_last_s(t_us)
        if self._pass_on(estimate, dt_s):
            return self._still(self.phase, self.reason)
        goal, words = self._goal(estimate, dt_s)
        return self._close(goal, estimate.vel_ned_m_s, dt_s, self.phase, words)

    def _go_on_to(self, t_us: int) -> None:
        if self._t_us is None:
            self._good_us = t_us
        elif t_us < self._t_us:
            message = f"a flight goes forward in time: {t_us} us is before {self._t_us} us"
            raise ValueError(message)
        self._t_us = t_us

    def _unfit(self, t_us: int, estimate: HomingEstimate | None) -> str:
        """Why an estimate is not to be flown by, empty where it is."""
        config = self.config
        if estimate is None:
            return "there is no estimate" if t_us - self._good_us > config.lost_after_s * 1e6 else "no estimate yet"
        if estimate.lost:
            return "the estimator has lost the place"
        if not estimate.std_m <= config.std_m:
            return f"the place is known to {estimate.std_m:.0f} m only; {config.std_m:g} m are asked for"
        if not estimate.std_m_s <= config.std_m_s:
            return f"the velocity is known to {estimate.std_m_s:.1f} m/s only; {config.std_m_s:g} m/s are asked for"
        return ""

    def _wait(self, t_us: int, estimate: HomingEstimate | None, why: str) -> HomingCommand:
        config = self.config
        if estimate is None and t_us - self._good_us <= config.lost_after_s * 1e6:
            # A gap between two estimates: what was wanted goes on.
            wanted = np.zeros(3) if self._wanted is None else self._wanted.copy()
            return HomingCommand(self.phase, wanted + self._loop.level_trim_ned_m_s, wanted, why)
        if self.phase is not HomingPhase.WAIT:
            self._going_on, self.phase = self.phase, HomingPhase.WAIT
        self.reason = why
        if t_us - self._good_us > config.wait_s * 1e6:
            self.abort(f"{why}, for {config.wait_s:.0f} s")
            return self._still(self.phase, self.reason)
        if estimate is None or not estimate.std_m_s <= config.std_m_s:
            self._wanted = None
            return self._still(self.phase, why)
        dt_s = self._loop.since_last_s(t_us)
        return self._close(np.zeros(3), estimate.vel_ned_m_s, dt_s, self.phase, why)

    def _pass_on(self, estimate: HomingEstimate, dt_s: float) -> bool:
        """Pass on to the next phase where it is time; whether that is the last."""
        config = self.config
        below_m = float(estimate.pos_ned_m[2]) - self._start_down_m
        away_m = self._away_m(estimate)
        if self.phase is HomingPhase.CLIMB and abs(below_m) < config.climbed_m:
            self.phase = HomingPhase.FOLLOW
        if self.phase is HomingPhase.FOLLOW and self.remaining_m < 2.0 * config.arrived_m:
            self.phase = HomingPhase.ARRIVE
        slow = float(np.hypot(*estimate.vel_ned_m_s[:2])) < config.arrived_m_s
        if self.phase is HomingPhase.ARRIVE and self._land and away_m < config.arrived_m and slow:
            self.phase = HomingPhase.DESCEND
        if self.phase is HomingPhase.DESCEND and estimate.alt_agl_m < config.touchdown_height_m:
            self.phase = HomingPhase.TOUCHDOWN
        if self.phase is HomingPhase.TOUCHDOWN:
            stands = abs(float(estimate.vel_ned_m_s[2])) < 0.5 * config.touchdown_sink_m_s
            self._still_s = self._still_s + dt_s if stands else 0.0
            if self._still_s >= config.still_for_s:
                self.phase = HomingPhase.LANDED
        return self.over

    def _away_m(self, estimate: HomingEstimate) -> float:
        return float(np.hypot(*(estimate.pos_ned_m - self.home_ned_m)[:2]))

    def _goal(self, estimate: HomingEstimate, dt_s: float) -> tuple[Float, str]:
        """The velocity (3,) to come to, and a word on it."""
        config = self.config
        if self.phase is HomingPhase.CLIMB:
            up_m = self._start_down_m - float(estimate.pos_ned_m[2])
            climb = np.array((0.0, 0.0, min(max(0.5 * up_m, -config.climb_m_s), config.climb_m_s)))
            return climb, "to the height of the way"
        if self.phase is HomingPhase.FOLLOW:
            reference = self._follower.step(
                min(max(dt_s, 1e-3), _LONGEST_STEP_S), estimate.pos_ned_m, estimate.vel_ned_m_s, estimate.yaw_rad
            )
            self.remaining_m = reference.remaining_m
            return reference.vel_ned_m_s + self._towards(reference.pos_ned_m - estimate.pos_ned_m), ""
        over = self._towards(self.home_ned_m - estimate.pos_ned_m)
        away_m = self._away_m(estimate)
        if self.phase is HomingPhase.ARRIVE:
            return over, "over home"
        if self.phase is HomingPhase.TOUCHDOWN:
            over[2] = config.touchdown_sink_m_s
            return over, "down until it stands"
        height_m = estimate.alt_agl_m
        if not math.isfinite(height_m):
            over[2] = config.touchdown_sink_m_s
            return over, "down slowly: the height over ground is not known"
        share = min(max(2.0 - 2.0 * away_m / config.funnel_m, 0.0), 1.0)
        over[2] = share * min(max(config.sink_per_s * height_m, config.touchdown_sink_m_s), config.sink_m_s)
        return over, "" if share == 1.0 else f"{away_m:.1f} m beside home"

    def _towards(self, offset_ned_m: Float) -> Float:
        """A velocity (3,) back to where it should be, so that it can still be stopped there."""
        config = self.config
        velocity = np.zeros(3)
        away_m = float(np.hypot(*offset_ned_m[:2]))
        if away_m > 1e-6:
            speed = min(config.offset_gain_per_s * away_m, math.sqrt(config.acceleration_m_s2 * away_m))
            velocity[:2] = offset_ned_m[:2] / away_m * min(speed, config.correction_m_s)
        velocity[2] = np.clip(config.offset_gain_per_s * offset_ned_m[2], -config.climb_m_s, config.climb_m_s)
        return velocity

    def _close(
        self, goal_ned_m_s: Float, vel_ned_m_s: Float, dt_s: float, phase: HomingPhase, why: str
    ) -> HomingCommand:  # fmt: skip
        # From the velocity that it has: a step of what is wanted would wind up the trim.
        before = np.array(vel_ned_m_s, np.float64) if self._wanted is None else self._wanted
        self._wanted = changed(before, goal_ned_m_s, self.config.acceleration_m_s2 * dt_s)
        on_ground = phase is HomingPhase.TOUCHDOWN
        command = self._loop.close(self._wanted, vel_ned_m_s, dt_s, free=not on_ground)
        if on_ground:
            command[2] = self._wanted[2]
        return HomingCommand(phase, command, self._wanted.copy(), why)

    def _still(self, phase: HomingPhase, why: str) -> HomingCommand:
        return HomingCommand(phase, self._loop.level_trim_ned_m_s, np.zeros(3), why)
