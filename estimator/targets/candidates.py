"""What may be a target that was lost, over several pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.targets.search import Match
from estimator.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A place that looks like the target: what speaks for it in natural log units, how its surroundings fit (NaN: not
    asked), and where it is on the ground relative to the expected place, metres right and down of the grid."""

    match: Match
    evidence: float
    surroundings: float
    offset_m: Float


@dataclass(slots=True, eq=False)
class Chain:
    """One candidate over several pictures; ``path_m`` (n, 2) is its way over ground, on the grid's axes."""

    times_us: list[int]
    candidates: list[Candidate]
    path_m: list[Float]

    def forget_before(self, t_us: int) -> None:
        """Drop what is older, but for the last two."""
        count = min(sum(t < t_us for t in self.times_us), len(self.times_us) - 2)
        del self.times_us[:count], self.candidates[:count], self.path_m[:count]

    @property
    def last_us(self) -> int:
        """Of the last picture with it."""
        return self.times_us[-1]

    @property
    def span_s(self) -> float:
        """From the first to the last."""
        return (self.times_us[-1] - self.times_us[0]) / 1e6

    @property
    def evidence(self) -> float:
        """Mean of what speaks for it, natural log units."""
        return float(np.mean([c.evidence for c in self.candidates]))

    @property
    def score(self) -> float:
        """Mean of how it fits."""
        return float(np.mean([c.match.score for c in self.candidates]))

    def velocity_m_s(self) -> Float:
        """Least-squares velocity (2,) over ground, right and down on the grid."""
        t = (np.array(self.times_us) - self.times_us[0]) / 1e6
        t = t - t.mean()
        out: Float = t @ np.array(self.path_m) / max(float(t @ t), 1e-9)
        return out

    def unevenness_m(self) -> float:
        """Median distance of the places from even motion: one that is laid the wrong way round is let pass."""
        t = (np.array(self.times_us) - self.times_us[0]) / 1e6
        path = np.array(self.path_m)
        left = path - path.mean(axis=0) - (t - t.mean())[:, None] * self.velocity_m_s()
        return float(np.median(np.hypot(*left.T)))
