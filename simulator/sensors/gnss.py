"""A satellite receiver whose error wanders, and which can be cut off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.scenario import SensorSection
from simulator.vehicles.gauss_markov import GaussMarkov
from simulator.vehicles.state import VehicleState

_VELOCITY_STD_M_S = 0.1
_WHITE_SHARE = 0.2
_ACQUISITION_US = 6_000_000


@dataclass(frozen=True, slots=True, eq=False)
class GnssFix:
    """What the receiver says; without a fix position and velocity are those of the last one."""

    t_us: int
    pos_ned_m: Float
    vel_ned_m_s: Float
    has_fix: bool
    satellites: int
    std_horizontal_m: float
    std_vertical_m: float


class GnssReceiver:
    """Fixes with Gauss-Markov errors; after being cut it needs some seconds to come back."""

    def __init__(self, seed: int, sensors: SensorSection) -> None:
        self._rng, self._sensors = rng_for(seed, "gnss"), sensors
        self._horizontal = GaussMarkov(rng_for(seed, "gnss", "horizontal"), sensors.gnss_horizontal_m, 70.0, 2)
        self._vertical = GaussMarkov(rng_for(seed, "gnss", "vertical"), sensors.gnss_vertical_m, 110.0, 1)
        self._off = False
        self._back_at_us = 0
        self._last: GnssFix | None = None

    @property
    def is_off(self) -> bool:
        """Whether the antenna is cut."""
        return self._off

    def cut(self, off: bool, t_us: int) -> None:
        """Cut the antenna or connect it again."""
        if self._off and not off:
            self._back_at_us = t_us + _ACQUISITION_US
        self._off = off

    def measure(self, state: VehicleState, dt_s: float) -> GnssFix:
        """One epoch, ``dt_s`` after the one before."""
        sensors, draw = self._sensors, self._rng.standard_normal(6)
        slow = np.concatenate([self._horizontal.step(dt_s), self._vertical.step(dt_s)])
        scale = np.array([sensors.gnss_horizontal_m, sensors.gnss_horizontal_m, sensors.gnss_vertical_m])
        if self._last is not None and (self._off or state.t_us < self._back_at_us):
            last = self._last
            return GnssFix(state.t_us, last.pos_ned_m, last.vel_ned_m_s, False, 0, last.std_horizontal_m, 0.0)
        fix = GnssFix(
            t_us=state.t_us,
            pos_ned_m=state.pos_ned_m + slow + _WHITE_SHARE * scale * draw[:3],
            vel_ned_m_s=state.vel_ned_m_s + _VELOCITY_STD_M_S * draw[3:],
            has_fix=True,
            satellites=14,
            std_horizontal_m=sensors.gnss_horizontal_m * 1.3,
            std_vertical_m=sensors.gnss_vertical_m * 1.3,
        )
        self._last = fix
        return fix
