"""The Earth's field in the body, with the iron of the airframe."""

from __future__ import annotations

import numpy as np

from estimator.types import Float
from simulator.random_streams import rng_for

# Southern Sweden: 5 degrees of declination, steep inclination; gauss.
FIELD_NED_GAUSS = np.array([0.1575, 0.0138, 0.4880])
_HARD_IRON_GAUSS = 0.012
_NOISE_GAUSS = 0.003


class Magnetometer:
    """Reads the field (3,) in body axes, gauss."""

    def __init__(self, seed: int) -> None:
        self._rng = rng_for(seed, "magnetometer")
        self._hard_iron = _HARD_IRON_GAUSS * self._rng.standard_normal(3)

    def field_body_gauss(self, ned_from_body: Float) -> Float:
        """One reading."""
        noise = _NOISE_GAUSS * self._rng.standard_normal(3)
        reading: Float = ned_from_body.T @ FIELD_NED_GAUSS + self._hard_iron + noise
        return reading
