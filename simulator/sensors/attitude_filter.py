"""The attitude that the autopilot's own filter believes in: truth with slowly wandering errors."""

from __future__ import annotations

import numpy as np

from estimator.geometry.rotation import q_from_rotvec, q_multiply
from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.scenario import SensorSection
from simulator.vehicles.gauss_markov import GaussMarkov

_TILT_TIME_S = 45.0
_HEADING_TIME_S = 150.0


class AttitudeFilter:
    """Adds tilt errors about north and east and a heading error about down."""

    def __init__(self, seed: int, sensors: SensorSection) -> None:
        # Half a degree is for the tilt as a whole, so each axis has its share.
        tilt = float(np.radians(sensors.tilt_error_deg)) / float(np.sqrt(2))
        self._tilt = GaussMarkov(rng_for(seed, "ahrs", "tilt"), tilt, _TILT_TIME_S, 2)
        heading = float(np.radians(sensors.heading_error_deg))
        self._heading = GaussMarkov(rng_for(seed, "ahrs", "heading"), heading, _HEADING_TIME_S, 1)

    def step(self, q_ned_from_body: Float, dt_s: float) -> Float:
        """The believed attitude (4,), ``dt_s`` after the last."""
        error = np.concatenate([self._tilt.step(dt_s), self._heading.step(dt_s)])
        return q_multiply(q_from_rotvec(error), q_ned_from_body)
