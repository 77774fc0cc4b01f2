"""The acceptance of Conte and Doherty: matches count while their differences from the prediction hardly scatter.

An integrated UAV navigation system based on aerial image matching, IEEE Aerospace Conference 2008, sections 5 and 7.
Where matching is unreliable the matched position jumps about; where it is right, its difference from the predicted one
stays. When the standard deviation of the last thirty differences is below 1.4 m their mean is a fix, brought in
gradually, because a jump would upset the filter. A stable alias passes the test, which is why this is not the default.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from estimator.types import Float


@dataclass(frozen=True, slots=True)
class SlidingWindowConfig:
    """``size`` matches within ``max_std_m`` (of the axis that scatters more) make a fix, brought in in ``parts``."""

    size: int = 30
    max_std_m: float = 1.4
    parts: int = 10

    def __post_init__(self) -> None:
        """Raise ValueError on numbers that make no window."""
        if self.size < 2 or self.parts < 1 or not self.max_std_m > 0.0:
            message = f"a window of {self.size} matches within {self.max_std_m} m in {self.parts} parts is none"
            raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One part of a correction: by how much to move now, north and east (2,), with the part's variance per axis."""

    move_ne_m: Float
    variance_m2: float

    def innovation(self, prior_cov_ne_m2: Float) -> Float:
        """Innovation (2,) that moves a filter of this prior (2, 2) by the whole part.

        A filter follows an innovation z by P (P + R)^-1 z, nearly all of it at first and little of it later; the parts
        are to be equal.
        """
        S = prior_cov_ne_m2 + np.eye(2) * self.variance_m2
        return np.asarray(S @ np.linalg.solve(prior_cov_ne_m2, self.move_ne_m), dtype=np.float64)


class SlidingWindow:
    """Collects differences, true minus predicted by each match, and hands out parts of corrections."""

    def __init__(self, config: SlidingWindowConfig) -> None:
        self.config = config
        self._differences: deque[Float] = deque(maxlen=config.size)
        self._left_ne_m = np.zeros(2)
        self._variance_m2 = 0.0
        self._parts_left = 0

    @property
    def std_m(self) -> float:
        """Standard deviation of the collected differences along the axis that scatters more; infinite before two."""
        if len(self._differences) < 2:
            return float("inf")
        return float(np.std(np.array(self._differences), axis=0, ddof=1).max())

    def offer(self, difference_ne_m: Float) -> Part | None:
        """Take a match's difference (2,); the part of a correction that is due, None while nothing is stable.

        A window that has made a fix begins anew, so that no match counts twice. The parts have ``parts`` times the
        window's own variance: one after the other they leave a filter as sure as the fix at once.
        """
        self._differences.append(np.asarray(difference_ne_m, dtype=np.float64))
        if self._parts_left == 0 and len(self._differences) == self.config.size:
            std_m = self.std_m
            if std_m < self.config.max_std_m:
                self._left_ne_m = np.mean(np.array(self._differences), axis=0)
                # errors of matches in a row are alike: their mean is no surer than one of them
                self._variance_m2 = max(std_m, 0.1) ** 2
                self._parts_left = self.config.parts
                self._differences.clear()
        if self._parts_left == 0:
            return None
        part = Part(self._left_ne_m / self._parts_left, self.config.parts * self._variance_m2)
        self._parts_left -= 1
        return part

    def moved(self, correction_ne_m: Float) -> None:
        """Say by how much (2,) the prediction has been corrected: differences to come are smaller by it."""
        self._left_ne_m = self._left_ne_m - correction_ne_m
        self._differences = deque((d - correction_ne_m for d in self._differences), maxlen=self.config.size)
