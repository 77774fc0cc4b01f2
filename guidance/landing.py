"""Coming down onto a pad: the velocity to fly from where the vehicle is relative to it. Pure, at any rate from 5 Hz.

Phases: ``approach`` (level, towards the pad), ``descend`` (down within a funnel over it), ``touchdown`` (the last
decimetres: it goes down whatever is seen), ``landed``, ``abort``, and ``hold`` for those who stand still after that.
Above the decision height a pad that is lost ends the landing; below it the vehicle is committed and lands by dead
reckoning, as in Conte's thesis (2009, figure 6.11).

The profile is slow, as in the flight of chapter 6 there (15 m in 55 s): a constant sink, then one proportional to the
height, then that of touchdown. Horizontally the wanted velocity is proportional to the offset, within limits of speed
and acceleration.

What goes to the autopilot is not the wanted velocity: see ``guidance.velocity_loop``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from estimator.robust import largest_std
from estimator.types import Float, PadMode, PadRelative
from guidance.velocity_loop import VelocityLoop, VelocityLoopConfig, changed


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
    height; half as far again outside it nothing sinks. ``loop`` is closed around the autopilot's own velocity.

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
    loop: VelocityLoopConfig = field(default_factory=VelocityLoopConfig)
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
        self._loop = VelocityLoop(self.config.loop, trim_ned_m_s)

    @property
    def over(self) -> bool:
        """Whether nothing more comes."""
        return self.phase in (LandingPhase.LANDED, LandingPhase.ABORT)

    @property
    def trim_ned_m_s(self) -> Float:
        """What the autopilot's own velocity is found to be off by, (3,)."""
        return self._loop.trim_ned_m_s

    def stand(self, t_us: int, vel_ned_m_s: Float | None) -> LandingCommand:
        """Stand still over the ground once it is aborted, by a velocity (3,) over it; None where that is not known.

        Without GPS an autopilot's own hold drifts with its own velocity; here the loop around that stays closed.
        """
        self._go_on_to(t_us)
        if vel_ned_m_s is None:
            return self._stop()
        dt_s = self._loop.since_last_s(t_us)
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
        dt_s = self._loop.since_last_s(t_us)
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

    def _stop(self) -> LandingCommand:
        """Stand still over the ground."""
        return LandingCommand(self.phase, self._loop.level_trim_ned_m_s, np.zeros(3), self.reason)

    def _blind(self, t_us: int) -> LandingCommand:
        """Without any estimate: wait a little, or go on down where it is committed."""
        last_us = self._began_us if self._loop.seen_us is None else self._loop.seen_us
        wanted = np.zeros(3)
        if self.phase is LandingPhase.TOUCHDOWN or self._lowest_m < self.config.decision_height_m:
            wanted[2] = self.config.touchdown_sink_m_s
        elif t_us - last_us > self.config.lost_after_s * 1e6:
            self.abort("the pad has not been seen" if self._loop.seen_us is None else "there is no estimate any more")
        set_point = wanted + self._loop.level_trim_ned_m_s
        return LandingCommand(self.phase, set_point, wanted, self.reason or "no pad known")

    def _decide(self, t_us: int, pad: PadRelative, height_m: float, dt_s: float) -> bool:
        """Pass on to the next phase where it is time; whether that is the last."""
        config = self.config
        if height_m < self._lowest_m - 0.1 or not math.isfinite(self._lowest_m):
            self._lowest_m, self._lowest_us = height_m, t_us
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
        self._wanted = changed(self._wanted, goal_ned_m_s, self.config.acceleration_m_s2 * dt_s)

    def _close(self, vel_ned_m_s: Float, dt_s: float, why: str) -> LandingCommand:
        on_ground = self.phase is LandingPhase.TOUCHDOWN
        command = self._loop.close(self._wanted, vel_ned_m_s, dt_s, free=not on_ground)
        if on_ground:
            command[2] = self._wanted[2]
        return LandingCommand(self.phase, command, self._wanted.copy(), why)
