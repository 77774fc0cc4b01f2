"""Whether an instrument's zero has moved farther than instruments in order do."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ZeroConfig:
    """Told is a zero that moved by more than ``least`` within ``span_s``, from a value known to ``known_std``, and for
    ``stands_s`` after. It is looked at every ``every_s``.

    For a barometer in metres: with the weather of the simulator, 1.2 m over 400 s, an estimated zero moved by at most
    2 m in twenty seconds, most of it the estimate's own noise; one that drifts by 20 m a minute is told after 15 s.
    """

    span_s: float = 20.0
    least: float = 3.0
    known_std: float = 1.5
    stands_s: float = 10.0
    every_s: float = 0.5


class WanderingZero:
    """Holds an estimated zero against what it was a while ago."""

    def __init__(self, config: ZeroConfig) -> None:
        self.config = config
        self._past: deque[tuple[int, float, float]] = deque()
        self._moved_us: int | None = None

    def note(self, t_us: int, zero: float, std: float) -> None:
        """Take the zero as it is estimated now; a time that runs backwards begins anew."""
        if self._past and t_us < self._past[-1][0]:
            self._past.clear()
        if self._past and t_us - self._past[-1][0] < self.config.every_s * 1e6:
            return
        self._past.append((t_us, zero, std))
        while t_us - self._past[0][0] > self.config.span_s * 1e6:
            self._past.popleft()
        config = self.config
        if any(abs(zero - then) > config.least and then_std < config.known_std for _, then, then_std in self._past):
            self._moved_us = t_us

    def stands(self, t_us: int) -> bool:
        """Whether it moved so far lately."""
        return self._moved_us is not None and 0 <= t_us - self._moved_us <= self.config.stands_s * 1e6
