"""Where the autopilot's filter has itself: as far off as its receiver, as what it is told, or as dead reckoning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.sensors.gnss import GnssFix
from simulator.vehicles.state import VehicleState

_VISION_SILENT_US = 500_000


@dataclass(frozen=True, slots=True, eq=False)
class _Vision:
    t_us: int
    error_ned_m: Float
    vel_error_ned_m_s: Float


class BelievedPosition:
    """The error of the autopilot's filter: it follows the receiver's, and runs away without it.

    What it is told from outside has it follow that instead. Where it is told nothing, its random numbers are the same.
    """

    def __init__(self, seed: int) -> None:
        self._rng = rng_for(seed, "autopilot")
        self._vision: _Vision | None = None
        self.error_ned_m: Float = np.zeros(3)
        self.vel_error_ned_m_s: Float = np.zeros(3)

    def move(self, error_ne_m: Float) -> None:
        """Be off by so much (2,) from now on; what the velocity is off by stays."""
        self.error_ned_m = np.array((*error_ne_m, self.error_ned_m[2]))

    def see(self, t_us: int, error_ned_m: Float, vel_error_ned_m_s: Float) -> None:
        """Follow what is seen from outside, which is off by so much (3,), for a moment."""
        self._vision = _Vision(t_us, error_ned_m, vel_error_ned_m_s)

    def step(self, state: VehicleState, fix: GnssFix, dt_s: float) -> None:
        """Take in one epoch of the receiver."""
        seen = self._vision
        if seen is not None and state.t_us - seen.t_us <= _VISION_SILENT_US:
            # Its height stays the barometer's.
            off_ned_m = (seen.error_ned_m - self.error_ned_m) * (1.0, 1.0, 0.0)
            self.error_ned_m = self.error_ned_m + 0.3 * off_ned_m
            off_ned_m_s = (seen.vel_error_ned_m_s - self.vel_error_ned_m_s) * (1.0, 1.0, 0.0)
            self.vel_error_ned_m_s = self.vel_error_ned_m_s + 0.3 * off_ned_m_s
            return
        if fix.has_fix:
            self.error_ned_m = self.error_ned_m + 0.15 * (fix.pos_ned_m - state.pos_ned_m - self.error_ned_m)
            self.vel_error_ned_m_s = 0.8 * self.vel_error_ned_m_s
            return
        # Dead reckoning on tilt: the velocity error walks, height is held by the barometer.
        walk = 0.08 * np.sqrt(dt_s) * self._rng.standard_normal(2)
        self.vel_error_ned_m_s = self.vel_error_ned_m_s + np.array([*walk, 0.0])
        self.error_ned_m = self.error_ned_m + self.vel_error_ned_m_s * dt_s
