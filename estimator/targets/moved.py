"""Where a picture differs from an earlier one of the same ground: what drives is there, whatever it looks like.

Both are laid onto the grid with what is known of the camera's motion; what that errs by is taken out by phase
correlation for all of the ground, and by the best of small shifts for what stands above it and seems to move a little.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.targets.appearance import Float32, GridView, grid_from_picture, peaks, picture_box
from estimator.targets.search import Look, coarser
from estimator.types import Float

STEP_PX = 2
"""Of the coarser grid on which pictures are compared."""
FROM_S, UNTIL_S = 0.35, 0.85
"""How old the picture may be that is compared with: a slow car must have left its place, the camera not the ground."""
SLACK_PX = 1
"""By how much, on the coarser grid, what stands high may seem to have moved."""
LEAST_GREY, MOST_GREY = 6.0, 40.0
"""By how much a place must differ on the average, and from which on a pixel counts no more."""
MOST_SHIFT_PX = 8.0
"""By how much, on the coarser grid, the two may lie beside each other."""
LEAST_SIDE_PX, LEAST_SHARE = 24, 0.1
"""How large the piece of the coarser grid must be, and how much of it both pictures must show."""


@dataclass(slots=True, eq=False)
class Earlier:
    """Pictures of the last moments, with the ground that they show."""

    looks: deque[tuple[int, Look]] = field(default_factory=deque)

    def add(self, t_us: int, look: Look) -> None:
        """Remember a picture, and forget those that are too old to be compared with."""
        self.looks.append((t_us, look))
        while (t_us - self.looks[0][0]) / 1e6 > UNTIL_S:
            self.looks.popleft()

    def clear(self) -> None:
        """Forget all."""
        self.looks.clear()

    def moved(self, look: Look, t_us: int, vel_px_s: Float, reach_px: int, size_px: float, most: int) -> list[Float]:
        """Offsets (2,) within ``reach_px`` of the expected place where things ``size_px`` long have come or gone, those
        that differ most first; ``vel_px_s`` (2,) is how fast the expected place goes over ground."""
        old = [(t, then) for t, then in self.looks if FROM_S <= (t_us - t) / 1e6 <= UNTIL_S]
        if not old:
            return []
        t, then = old[-1]
        step = vel_px_s * ((t_us - t) / 1e6)
        low, high = picture_box(look.picture, coarser(look.picture_from_grid, STEP_PX))
        reach = math.ceil(reach_px / STEP_PX)
        box = np.maximum(np.floor(low), -reach).astype(np.intp), np.minimum(np.ceil(high), reach).astype(np.intp)
        if (box[1] - box[0] < LEAST_SIDE_PX).any():
            return []
        now, before = _laid(look, np.zeros(2), box), _laid(then, step, box)
        differs = _difference(now, before)
        if differs is None:
            return []
        side = max(3, 2 * round(0.2 * size_px / STEP_PX) + 1)
        mean = cv2.boxFilter(differs, -1, (side, side))
        best = peaks(np.asarray(mean, np.float32), most, max(2, round(0.25 * size_px / STEP_PX)))
        places = [box[0] + np.array([col, row]) for row, col in best if mean[row, col] >= LEAST_GREY]
        return [STEP_PX * place.astype(np.float64) for place in places]


def _laid(look: Look, about_px: Float, box: tuple[NDArray[np.intp], NDArray[np.intp]]) -> GridView:
    soft = np.asarray(cv2.GaussianBlur(look.picture, (0, 0), 0.8), np.uint8)
    return grid_from_picture(soft, coarser(look.about(about_px), STEP_PX), box)


def _difference(now: GridView, before: GridView) -> Float32 | None:
    """By how much (rows, cols) pixels differ from the likest nearby, 0 where either does not show the ground; None
    where the two show too little of the same."""
    known = now.known & before.known
    if known.mean() < LEAST_SHARE:
        return None
    a, b = (np.asarray(cv2.GaussianBlur(one.image, (0, 0), 0.7), np.uint8) for one in (now, before))
    grey = [cv2.cvtColor(one, cv2.COLOR_BGR2GRAY).astype(np.float32) for one in (a, b)]
    means = [cv2.mean(one, mask=known)[0] for one in grey]
    b = np.asarray(cv2.convertScaleAbs(b, alpha=means[0] / max(means[1], 1.0)), np.uint8)
    even = [np.where(known > 0, one - np.float32(mean), np.float32(0.0)) for one, mean in zip(grey, means, strict=True)]
    window = cv2.createHanningWindow((known.shape[1], known.shape[0]), cv2.CV_32F)
    (right, down), _ = cv2.phaseCorrelate(even[1], even[0], window)
    if math.hypot(right, down) > MOST_SHIFT_PX:
        right, down = 0.0, 0.0
    moved = cv2.warpAffine(b, np.array([[1.0, 0.0, right], [0.0, 1.0, down]]), known.shape[::-1])
    least = np.full(a.shape, 255, np.uint8)
    for u in range(-SLACK_PX, SLACK_PX + 1):
        for v in range(-SLACK_PX, SLACK_PX + 1):
            least = np.minimum(least, cv2.absdiff(a, np.roll(moved, (v, u), (0, 1)))).astype(np.uint8)
    border = 2 * math.ceil(max(abs(right), abs(down)) + SLACK_PX + 2) + 1
    shown = cv2.erode(known, np.ones((border, border), np.uint8), borderValue=(0,))
    return np.where(shown > 0, np.minimum(least.max(axis=2), MOST_GREY), 0.0).astype(np.float32)
