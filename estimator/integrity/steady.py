"""Whether the innovations of one instrument keep to one side: a right filter's are white."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SteadyConfig:
    """Innovations are averaged over ``time_s``; a mean beyond ``limit`` of their standard deviation is no chance when
    it has been so for ``persists_s``.

    Of white innovations 0.18 s apart the mean over four seconds scatters by 0.15 of that; the barometer's stayed below
    0.2 in flights without fault and passed 0.5 where it drifted by a third of a metre a second.
    """

    time_s: float = 4.0
    limit: float = 0.3
    persists_s: float = 2.0


class SteadyInnovations:
    """Moving mean of one instrument's innovations."""

    def __init__(self, config: SteadyConfig) -> None:
        self.config = config
        self._mean = 0.0
        self._t_us: int | None = None
        self._since_us: int | None = None

    def restart(self) -> None:
        """Forget the mean, where the innovations have another cause."""
        self._mean, self._since_us = 0.0, None

    def note(self, t_us: int, innovation: float, std: float) -> float:
        """Count an innovation with its standard deviation; the mean where it has been beyond the limit, else zero."""
        dt_s = 0.0 if self._t_us is None else max(t_us - self._t_us, 0) / 1e6
        self._t_us = t_us
        share = min(dt_s / self.config.time_s, 1.0)
        self._mean += share * (innovation - self._mean)
        if abs(self._mean) <= self.config.limit * std:
            self._since_us = None
            return 0.0
        self._since_us = self._since_us if self._since_us is not None else t_us
        if t_us - self._since_us < self.config.persists_s * 1e6:
            return 0.0
        return self._mean
