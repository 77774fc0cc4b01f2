"""A standing displacement between the map and satellite positions, while there are satellites.

Once satellites are denied a displaced map cannot be told from a displaced aircraft; before, it can. Single matches
err by a few metres or lie anywhere at all, so what is looked for is a place in the window of displacements where most
of the last pictures agree, over ground that differs.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from estimator.robust import robust_std
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class DisplacementConfig:
    """Of the last ``span_s`` seconds at least ``min_pictures`` over ``min_way_m`` count.

    A displacement stands where ``min_share`` of them lie within ``near_m`` of their median. It is worth an alarm beyond
    ``least_m``, to which a receiver's own error and a usual map's reach.
    """

    span_s: float = 12.0
    min_pictures: int = 15
    min_way_m: float = 60.0
    near_m: float = 4.0
    min_share: float = 0.6
    least_m: float = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """A displacement (2,) of the map against satellites, north and east in metres, and its scatter."""

    displacement_ne_m: Float
    std_m: float

    @property
    def size_m(self) -> float:
        """Its length."""
        return float(np.hypot(*self.displacement_ne_m))


class DisplacementWatch:
    """Collects where pictures lie on the map relative to satellite positions."""

    def __init__(self, config: DisplacementConfig | None = None) -> None:
        self.config = config or DisplacementConfig()
        self._seen: deque[tuple[int, Float, Float]] = deque()

    def add(self, t_us: int, pos_ne_m: Float, displacement_ne_m: Float) -> Standing | None:
        """A picture at a position (2,) by satellites, found displaced (2,); the displacement that stands, if one does.

        One that is not finite is no evidence and is left out.
        """
        config = self.config
        if not np.isfinite(displacement_ne_m).all():
            return None
        self._seen.append((t_us, pos_ne_m.copy(), displacement_ne_m.copy()))
        places = np.array([place for _, place, _ in self._seen])
        to_go_m = np.append(np.cumsum(np.hypot(*np.diff(places, axis=0).T)[::-1])[::-1], 0.0)
        since_us = t_us - np.array([t for t, _, _ in self._seen])
        for _ in range(int(np.sum(since_us > config.span_s * 1e6))):
            self._seen.popleft()
        if len(self._seen) < config.min_pictures or to_go_m[-len(self._seen)] < config.min_way_m:
            return None
        found = np.array([displacement for _, _, displacement in self._seen])
        middle = np.median(found, axis=0)
        near = np.hypot(*(found - middle).T) <= config.near_m
        if near.mean() < config.min_share:
            return None
        agreed: Float = found[near].mean(axis=0)
        return Standing(agreed, float(np.hypot(robust_std(found[near, 0]), robust_std(found[near, 1]))))

    def forget(self) -> None:
        """Begin anew, after what was found has been taken off."""
        self._seen.clear()
