"""Coming down onto a pad: the velocity to fly from where the vehicle is relative to it. Pure, at any rate from 5 Hz.

Phases: ``approach`` (level, towards the pad), ``descend`` (down within a funnel over it), ``touchdown`` (the last
decimetres: it goes down whatever is seen), ``landed``, ``abort``, and ``hold`` for those who stand still after that.
Above the decision height a pad that is lost ends the landing; below it the vehicle is committed and lands by dead
reckoning, as in Conte's thesis (2009, figure 6.11).

The profile is slow, as in the flight of chapter 6 there (15 m in 55 s): a constant sink, then one proportional to the
height, then that of touchdown. Horizontally the wanted velocity is proportional to the offset, within limits of speed
and acceleration.

The set-point is not the wanted velocity. An autopilot without GPS flies by a velocity of its own that drifts, so the
estimate's velocity closes a loop around it: a multiple of the velocity's error is added, and its integral, the trim;
the acceleration is taken off, or a helicopter, whose thrust must turn first, would swing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from estimator.robust import largest_std
from estimator.types import Float, PadMode, PadRelative

_ACROSS = np.array((1.0, 1.0, 0.2))
"""How much of the loop is closed on each axis: height is known to the autopilot itself."""
_MAX_STEP_S = 0.5
"""A longer pause between two calls counts as this: nothing is integrated over it."""


class LandingPhase(StrEnum):
    """How far a landing is."""

    APPROACH = "approach"
    DESCEND = "descend"
    TOUCHDOWN = "touchdown"
    LANDED = "landed"
    ABORT = "abort"
    HOLD = "hold"


@dataclass(frozen=True, slots=True)
class LandingConfig:
    """Limits of a landing. Heights are of the gear above the pad.

    ``gear_m`` is how high the vehicle's reference point is when it stands. The sink is ``sink_per_s`` times the height,
    within ``touchdown_sink_m_s`` and ``sink_m_s``. The funnel's radius is ``funnel_m`` plus ``funnel_slope`` times the
    height; half as far again outside it nothing sinks. ``velocity_gain``, ``trim_per_s`` and ``damping_s`` (by the
    acceleration) close the loop around the autopilot's own velocity; the trim stays within ``trim_m_s``. They are
    chosen for a helicopter whose velocity follows in 1.3 s, and hold from half to three times as fast. Where estimates
    come less often than every ``pace_s`` (the longest pause counts, for some ``pace_memory_s``) less of it is closed:
    a set-point that is held for half a second at full gain makes the vehicle swing ever wider.

    Above ``decision_height_m`` the landing is given up where the pad was last seen ``lost_after_s`` ago, or its place
    is known worse than ``std_m``, or it has not come down for ``patience_s``; ``hold_after_s`` after the pad was last
    seen it stops sinking. It has landed when in touchdown it has been slower than ``still_m_s`` for ``still_for_s``,
    or, by an estimate that slides away, has been in touchdown for ``touchdown_for_s``: several times what is left.
    """

    gear_m: float = 0.3
    speed_m_s: float = 2.0
    offset_gain_per_s: float = 0.8
    acceleration_m_s2: float = 0.8
    sink_m_s: float = 0.6
    sink_per_s: float = 0.25
    touchdown_sink_m_s: float = 0.3
    funnel_m: float = 0.12
    funnel_slope: float = 0.08
    velocity_gain: float = 2.5
    trim_per_s: float = 2.0
    damping_s: float = 1.0
    damping_time_s: float = 0.1
    pace_s: float = 0.15
    pace_memory_s: float = 3.0
    trim_m_s: float = 3.0
    decision_height_m: float = 1.5
    touchdown_height_m: float = 0.35
    hold_after_s: float = 0.4
    lost_after_s: float = 2.0
    std_m: float = 0.6
    patience_s: float = 60.0
    still_m_s: float = 0.12
    still_for_s: float = 1.0
    touchdown_for_s: float = 6.0

    def __post_init__(self) -> None:
        rising = (
            ("touchdown_height_m", self.touchdown_height_m, "decision_height_m", self.decision_height_m),
            ("touchdown_sink_m_s", self.touchdown_sink_m_s, "sink_m_s", self.sink_m_s),
            ("hold_after_s", self.hold_after_s, "lost_after_s", self.lost_after_s),
        )
        for low, less, high, more in rising:
            if not 0.0 < less <= more < math.inf:
                message = f"0 < {low} <= {high} must hold, not {less} and {more}"
                raise ValueError(message)
        if not 0.0 <= self.gear_m < math.inf:
            message = f"gear_m is the height of the reference point over the ground, not {self.gear_m} m"
            raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class LandingCommand:
    """What to fly now: a velocity (3,) NED for the autopilot, the phase, and why in words where it holds or ends.

    ``vel_wanted_ned_m_s`` is the velocity over the pad that the set-point is to bring about.
    """

    phase: LandingPhase
    vel_ned_m_s: Float
    vel_wanted_ned_m_s: Float
    reason: str = ""


class LandingGuidance:
    """One landing, from its begin to ``landed`` or ``abort``, which both are final.

    ``trim_ned_m_s`` (3,) is what an earlier landing found the autopilot's own velocity to be off by.
    """

    def __init__(self, config: LandingConfig | None = None, trim_ned_m_s: Float | None = None) -> None:
        self.config = config or LandingConfig()
        self.phase = LandingPhase.APPROACH
        self.reason = ""
        self._t_us: int | None = None
        self._began_us = 0
        self._lowest_m = math.inf
        self._lowest_us = 0
        self._still_s = self._touchdown_s = 0.0
        self._wanted: Float = np.zeros(3)
        self._trim: Float = np.zeros(3) if trim_ned_m_s is None else np.array(trim_ned_m_s, dtype=np.float64)
        self._seen_us: int | None = None
        self._pace_s = 0.0
        self._vel: Float | None = None
        self._acceleration: Float = np.zeros(3)

    @property
    def over(self) -> bool:
        """Whether nothing more comes."""
        return self.phase in (LandingPhase.LANDED, LandingPhase.ABORT)

    @property
    def trim_ned_m_s(self) -> Float:
        """What the autopilot's own velocity is found to be off by, (3,)."""
        return self._trim.copy()

    def stand(self, t_us: int, vel_ned_m_s: Float | None) -> LandingCommand:
        """Stand still over the ground once it is aborted, by a velocity (3,) over it; None where that is not known.

        Without GPS an autopilot's own hold drifts with its own velocity; here the loop around that stays closed.
        """
        self._go_on_to(t_us)
        if vel_ned_m_s is None:
            return self._stop()
        dt_s = self._since_last_estimate_s(t_us)
        self._seen_us = t_us
        self._change(np.zeros(3), dt_s)
        command = self._close(np.asarray(vel_ned_m_s, dtype=np.float64), dt_s, self.reason)
        return replace(command, phase=LandingPhase.HOLD)

    def abort(self, reason: str) -> None:
        """End the landing, for a reason that the operator is told; one that is over stays as it is."""
        if not self.over:
            self.phase, self.reason = LandingPhase.ABORT, reason

    def step(self, t_us: int, pad: PadRelative | None) -> LandingCommand:
        """The command for ``t_us``, from the estimate at that time; None where there is none at all."""
        self._go_on_to(t_us)
        known = pad is not None and pad.mode is not PadMode.SEARCHING and bool(np.all(np.isfinite(pad.pos_ned_m)))
        if self.over:
            return self._stop()
        if pad is None or not known:
            return self._blind(t_us)
        height_m = -float(pad.pos_ned_m[2]) - self.config.gear_m
        dt_s = self._since_last_estimate_s(t_us)
        if self._decide(t_us, pad, height_m, dt_s):
            return self._stop()
        away_m = float(np.hypot(*pad.pos_ned_m[:2]))
        sink_m_s, why = self._sink_m_s(pad, height_m, away_m)
        self._aim(pad, sink_m_s, dt_s)
        return self._close(pad.vel_ned_m_s, dt_s, why)

    def _go_on_to(self, t_us: int) -> None:
        if self._t_us is None:
            self._began_us = self._lowest_us = t_us
        elif t_us < self._t_us:
            message = f"a landing goes forward in time: {t_us} us is before {self._t_us} us"
            raise ValueError(message)
        self._t_us = t_us

    def _since_last_estimate_s(self, t_us: int) -> float:
        """Since the last call with an estimate; calls without one in between are no steps of the loop."""
        if self._seen_us is None:
            return 0.0
        dt_s = min((t_us - self._seen_us) / 1e6, _MAX_STEP_S)
        forgotten = math.exp(-dt_s / self.config.pace_memory_s)
        self._pace_s = max(dt_s, dt_s + forgotten * (self._pace_s - dt_s))
        return dt_s

    def _stop(self) -> LandingCommand:
        """Stand still over the ground: the trim goes on, or the autopilot's own error would move the vehicle."""
        return LandingCommand(self.phase, self._trim * (1.0, 1.0, 0.0), np.zeros(3), self.reason)

    def _blind(self, t_us: int) -> LandingCommand:
        """Without any estimate: wait a little, or go on down where it is committed."""
        last_us = self._began_us if self._seen_us is None else self._seen_us
        wanted = np.zeros(3)
        if self.phase is LandingPhase.TOUCHDOWN or self._lowest_m < self.config.decision_height_m:
            wanted[2] = self.config.touchdown_sink_m_s
        elif t_us - last_us > self.config.lost_after_s * 1e6:
            self.abort("the pad has not been seen" if self._seen_us is None else "there is no estimate any more")
        return LandingCommand(self.phase, wanted + self._trim * (1.0, 1.0, 0.0), wanted, self.reason or "no pad known")

    def _decide(self, t_us: int, pad: PadRelative, height_m: float, dt_s: float) -> bool:
        """Pass on to the next phase where it is time; whether that is the last."""
        config = self.config
        if height_m < self._lowest_m - 0.1 or not math.isfinite(self._lowest_m):
            self._lowest_m, self._lowest_us = height_m, t_us
        self._seen_us = t_us
        if self.phase is LandingPhase.APPROACH and self._within(pad, height_m):
            self.phase = LandingPhase.DESCEND
        committed = self.phase is not LandingPhase.APPROACH and height_m < config.decision_height_m
        if not committed and self.phase is not LandingPhase.TOUCHDOWN:
            self._give_up(t_us, pad)
        elif self.phase is LandingPhase.DESCEND and height_m < config.touchdown_height_m:
            self.phase = LandingPhase.TOUCHDOWN
        if self.phase is LandingPhase.TOUCHDOWN:
            # It does not go down although it is told to: the ground holds it.
            still = float(np.linalg.norm(pad.vel_ned_m_s)) < config.still_m_s
            self._still_s = self._still_s + dt_s if still else 0.0
            self._touchdown_s += dt_s
            if self._still_s >= config.still_for_s or self._touchdown_s >= config.touchdown_for_s:
                self.phase = LandingPhase.LANDED
        return self.over

    def _give_up(self, t_us: int, pad: PadRelative) -> None:
        config = self.config
        std_m = largest_std(pad.cov_pos_ned_m2[:2, :2])
        if pad.mode is PadMode.LOST or pad.age_s > config.lost_after_s:
            self.abort(
                f"the pad was lost above {config.decision_height_m:g} m" + (f": {pad.reason}" * bool(pad.reason))
            )
        elif not std_m <= config.std_m:
            self.abort(f"the pad's place is known to {std_m:.2f} m only; {config.std_m:g} m are asked for")
        elif t_us - self._lowest_us > config.patience_s * 1e6:
            self.abort(f"it has not come down for {config.patience_s:.0f} s: wind or estimate keep it off the pad")

    def _funnel_m(self, height_m: float) -> float:
        return self.config.funnel_m + self.config.funnel_slope * max(height_m, 0.0)

    def _within(self, pad: PadRelative, height_m: float) -> bool:
        return float(np.hypot(*pad.pos_ned_m[:2])) < self._funnel_m(height_m)

    def _sink_m_s(self, pad: PadRelative, height_m: float, away_m: float) -> tuple[float, str]:
        """How fast to go down, and why slower than the profile."""
        config = self.config
        if self.phase is LandingPhase.APPROACH:
            return 0.0, "over to the pad"
        profile = min(max(config.sink_per_s * height_m, config.touchdown_sink_m_s), config.sink_m_s)
        if self.phase is LandingPhase.TOUCHDOWN:
            return profile, ""
        if pad.age_s > config.hold_after_s:
            if height_m < config.decision_height_m:
                # Waiting only makes dead reckoning worse.
                return profile, "pad out of sight, committed"
            return 0.0, f"pad out of sight for {pad.age_s:.1f} s" + (f": {pad.reason}" * bool(pad.reason))
        outside = away_m / self._funnel_m(height_m) - 1.0
        share = min(max(1.0 - 2.0 * outside, 0.0), 1.0)
        return share * profile, "" if share == 1.0 else f"{away_m:.2f} m beside the pad"

    def _aim(self, pad: PadRelative, sink_m_s: float, dt_s: float) -> None:
        """The velocity to have: towards the pad so that it can still be stopped over it, changed within limits."""
        config = self.config
        offset = -pad.pos_ned_m[:2]
        away_m = float(np.hypot(*offset))
        braking = math.sqrt(config.acceleration_m_s2 * away_m)
        speed = min(config.offset_gain_per_s * away_m, braking, config.speed_m_s)
        self._change(np.array((*(offset * (speed / away_m if away_m > 1e-6 else 0.0)), sink_m_s)), dt_s)

    def _change(self, goal_ned_m_s: Float, dt_s: float) -> None:
        """The wanted velocity towards its goal, within the limit of acceleration."""
        change = goal_ned_m_s - self._wanted
        for part in (slice(0, 2), slice(2, 3)):
            size = float(np.linalg.norm(change[part]))
            change[part] *= min(1.0, self.config.acceleration_m_s2 * dt_s / size) if size > 0.0 else 0.0
        self._wanted = self._wanted + change

    def _close(self, vel_ned_m_s: Float, dt_s: float, why: str) -> LandingCommand:
        config = self.config
        lacking = self._wanted - vel_ned_m_s
        share = min(1.0, config.pace_s / self._pace_s) if self._pace_s > 0.0 else 1.0
        if self.phase is not LandingPhase.TOUCHDOWN:
            # On the ground the wanted velocity is never reached, and the trim would run away.
            more = share * config.trim_per_s * dt_s * lacking * _ACROSS
            self._trim = np.clip(self._trim + more, -config.trim_m_s, config.trim_m_s)
        self._note_acceleration(vel_ned_m_s, dt_s)
        closing = config.velocity_gain * lacking - config.damping_s * self._acceleration
        command = self._wanted + self._trim + share * closing * _ACROSS
        if self.phase is LandingPhase.TOUCHDOWN:
            command[2] = self._wanted[2]
        return LandingCommand(self.phase, command, self._wanted.copy(), why)

    def _note_acceleration(self, vel_ned_m_s: Float, dt_s: float) -> None:
        if self._vel is not None and dt_s > 0.0:
            now = (vel_ned_m_s - self._vel) / dt_s
            share = 1.0 - math.exp(-dt_s / self.config.damping_time_s)
            self._acceleration = self._acceleration + share * (now - self._acceleration)
        self._vel = np.array(vel_ned_m_s)
