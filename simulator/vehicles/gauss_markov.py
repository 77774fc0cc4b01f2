"""First-order Gauss-Markov noise: errors that wander but do not run away."""

from __future__ import annotations

import numpy as np

from estimator.types import Float


class GaussMarkov:
    """Exponentially correlated noise (n,) of a standard deviation and a time constant."""

    def __init__(self, rng: np.random.Generator, std: float, time_constant_s: float, size: int) -> None:
        self._rng, self._std, self._time_constant_s = rng, std, time_constant_s
        self.value: Float = std * rng.standard_normal(size)

    def step(self, dt_s: float) -> Float:
        """The value after ``dt_s`` more."""
        keep = float(np.exp(-dt_s / self._time_constant_s))
        drive = self._std * float(np.sqrt(1 - keep * keep))
        self.value = keep * self.value + drive * self._rng.standard_normal(self.value.size)
        return self.value
