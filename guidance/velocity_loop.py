"""A loop closed around the velocity that an autopilot flies. Pure, at any rate from 5 Hz.

The set-point is not the wanted velocity. An autopilot without GPS flies by a velocity of its own that drifts, so the
estimate's velocity closes a loop around it: a multiple of the velocity's error is added, and its integral, the trim;
the acceleration is taken off, or a helicopter, whose thrust must turn first, would swing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from estimator.types import Float

_ACROSS = np.array((1.0, 1.0, 0.2))
"""How much of the loop is closed on each axis: height is known to the autopilot itself."""
_LEVEL = np.array((1.0, 1.0, 0.0))
_MAX_STEP_S = 0.5
"""A longer pause between two estimates counts as this: nothing is integrated over it."""


@dataclass(frozen=True, slots=True)
class VelocityLoopConfig:
    """``gain``, ``trim_per_s`` and ``damping_s`` (by the acceleration) close the loop; the trim stays in ``trim_m_s``.

    They are chosen for a helicopter whose velocity follows in 1.3 s, and hold from half to three times as fast. Where
    estimates come less often than every ``pace_s`` (the longest pause counts, for some ``pace_memory_s``) less of it
    is closed: a set-point that is held for half a second at full gain makes the vehicle swing ever wider.

    Raises
    ------
    ValueError
        A number is not finite and positive.
    """

    gain: float = 2.5
    trim_per_s: float = 2.0
    damping_s: float = 1.0
    damping_time_s: float = 0.1
    pace_s: float = 0.15
    pace_memory_s: float = 3.0
    trim_m_s: float = 3.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not 0.0 < value < math.inf:
                message = f"{one.name} must be positive, not {value}"
                raise ValueError(message)


class VelocityLoop:
    """The loop of one flight. ``trim_ned_m_s`` (3,) is what an earlier one found the autopilot to be off by."""

    def __init__(self, config: VelocityLoopConfig | None = None, trim_ned_m_s: Float | None = None) -> None:
        self.config = config or VelocityLoopConfig()
        self.seen_us: int | None = None
        self._trim: Float = np.zeros(3) if trim_ned_m_s is None else np.array(trim_ned_m_s, dtype=np.float64)
        self._pace_s = 0.0
        self._vel: Float | None = None
        self._acceleration: Float = np.zeros(3)

    @property
    def trim_ned_m_s(self) -> Float:
        """What the autopilot's own velocity is found to be off by, (3,)."""
        return self._trim.copy()

    @property
    def level_trim_ned_m_s(self) -> Float:
        """The set-point (3,) that keeps a vehicle still: the trim goes on, or the autopilot's error would move it."""
        level: Float = self._trim * _LEVEL
        return level

    def since_last_s(self, t_us: int) -> float:
        """Note an estimate; how long after the last, which calls without one in between do not change."""
        if self.seen_us is None:
            self.seen_us = t_us
            return 0.0
        dt_s = min((t_us - self.seen_us) / 1e6, _MAX_STEP_S)
        self.seen_us = t_us
        forgotten = math.exp(-dt_s / self.config.pace_memory_s)
        self._pace_s = max(dt_s, dt_s + forgotten * (self._pace_s - dt_s))
        return dt_s

    def close(self, wanted_ned_m_s: Float, vel_ned_m_s: Float, dt_s: float, *, free: bool = True) -> Float:
        """The set-point (3,) that brings about a wanted velocity (3,) where the velocity is (3,).

        Where the ground holds the vehicle (not ``free``) the wanted velocity is never reached, and the trim stays.
        """
        config = self.config
        lacking = wanted_ned_m_s - vel_ned_m_s
        share = min(1.0, config.pace_s / self._pace_s) if self._pace_s > 0.0 else 1.0
        if free:
            more = share * config.trim_per_s * dt_s * lacking * _ACROSS
            self._trim = np.clip(self._trim + more, -config.trim_m_s, config.trim_m_s)
        self._note_acceleration(vel_ned_m_s, dt_s)
        closing = config.gain * lacking - config.damping_s * self._acceleration
        set_point: Float = wanted_ned_m_s + self._trim + share * closing * _ACROSS
        return set_point

    def _note_acceleration(self, vel_ned_m_s: Float, dt_s: float) -> None:
        if self._vel is not None and dt_s > 0.0:
            now = (vel_ned_m_s - self._vel) / dt_s
            share = 1.0 - math.exp(-dt_s / self.config.damping_time_s)
            self._acceleration = self._acceleration + share * (now - self._acceleration)
        self._vel = np.array(vel_ned_m_s)


def changed(wanted_ned_m_s: Float, goal_ned_m_s: Float, most_m_s: float) -> Float:
    """A velocity (3,) moved towards another by at most ``most_m_s``, across and along the vertical each."""
    change = goal_ned_m_s - wanted_ned_m_s
    for part in (slice(0, 2), slice(2, 3)):
        size = float(np.linalg.norm(change[part]))
        change[part] *= min(1.0, most_m_s / size) if size > 0.0 else 0.0
    moved: Float = wanted_ned_m_s + change
    return moved
