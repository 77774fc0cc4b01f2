"""How likely is a match to be wrong, from the shape of its similarity surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.registration.channels import Channels
from estimator.robust import robust_std
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class Peak:
    """The best place of a surface and what speaks for it.

    ``row``, ``col`` are sub-pixel. ``psr`` is the peak's height over the rest of the surface in its standard
    deviations; ``second_ratio`` the highest similarity more than five pixels away over the peak's. ``height`` is over
    the rest's median, and ``clutter_std`` its scatter, robustly: the ridge that a straight road draws is not clutter.
    ``sharpness`` is by what share of its height the peak falls two pixels away, where it falls least.
    """

    row: float
    col: float
    value: float
    psr: float
    second_ratio: float
    at_edge: bool
    height: float
    clutter_std: float
    sharpness: float = 1.0


EXCLUDED_PX = 5
FALL_PX = 2.0


def find_peak(surface: NDArray[np.floating]) -> Peak | None:
    """The highest place of a surface (rows, cols), refined by a quadratic; None where nothing is known."""
    if not np.isfinite(surface).any():
        return None
    filled = np.where(np.isfinite(surface), surface, -1.0)
    row, col = np.unravel_index(int(np.argmax(filled)), filled.shape)
    value = float(filled[row, col])
    rows, cols = filled.shape
    rest = np.isfinite(surface)
    rest[max(0, row - EXCLUDED_PX) : row + EXCLUDED_PX + 1, max(0, col - EXCLUDED_PX) : col + EXCLUDED_PX + 1] = False
    others = filled[rest]
    if others.size > 20:
        psr = (value - float(others.mean())) / max(float(others.std()), 1e-6)
        middle = float(np.median(others))
        clutter = max(robust_std(others), 1e-6)
        height = value - middle
        second = float(others.max()) / max(value, 1e-6)
    else:
        psr, second, height, clutter = 0.0, 1.0, 0.0, 1.0
    sharpness = _sharpness(filled, int(row), int(col), height)
    at_edge = row in (0, rows - 1) or col in (0, cols - 1)
    if at_edge:
        return Peak(float(row), float(col), value, psr, second, True, height, clutter, sharpness)
    d_row = vertex(filled[row - 1, col], value, filled[row + 1, col])
    d_col = vertex(filled[row, col - 1], value, filled[row, col + 1])
    return Peak(row + d_row, col + d_col, value, psr, second, False, height, clutter, sharpness)


def _sharpness(surface: NDArray[np.floating], row: int, col: int, height: float) -> float:
    """By what share of its height the peak falls ``FALL_PX`` away, along the line on which it falls least."""
    rows, cols = surface.shape
    least = 1.0
    for d_row, d_col in ((0, 1), (1, 2), (1, 1), (2, 1), (1, 0), (2, -1), (1, -1), (1, -2)):
        step = FALL_PX / float(np.hypot(d_row, d_col))
        ends = [(row + round(way * step * d_row), col + round(way * step * d_col)) for way in (-1, 1)]
        falls = [surface[row, col] - surface[r, c] for r, c in ends if 0 <= r < rows and 0 <= c < cols]
        if falls:
            least = min(least, float(np.mean(falls)) / max(height, 1e-6))
    return least


def vertex(before: float, at: float, after: float) -> float:
    """Where a parabola through three samples a step apart is highest, from the middle one, half a step at the most."""
    curvature = before - 2.0 * at + after
    if curvature >= -1e-9:
        return 0.0
    return float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5))


@dataclass(frozen=True, slots=True)
class MatchEvidence:
    """What speaks for and against a match, beside its surface's ``peak``.

    ``consensus`` is how far the windows of the picture agree that they are like the map there: the mean of their
    similarities in its own standard errors. ``turn`` and ``stretch`` are the corrections of heading and scale as shares
    of the largest that were tried, 0 where nothing else was: right places need what the prediction errs by, wrong ones
    take any.
    """

    peak: Peak
    consensus: float
    turn: float
    stretch: float


FEATURES = ("value", "psr", "second_ratio", "height", "sharpness", "at_edge", "consensus", "turn", "stretch")
"""What the outlier probability is a regression on, in the order of ``features``."""


def features(evidence: MatchEvidence) -> Float:
    """What the regression sees (9,). What is beyond doubt is clipped: it must not outweigh the rest.

    ``height`` is the peak over its surroundings in standard deviations of the clutter, ``sharpness`` how fast it falls
    where it falls slowest, as a share of its height (along a straight road hardly at all).
    """
    peak = evidence.peak
    return np.array(
        [
            peak.value,
            np.clip(peak.psr, 0.0, 15.0),
            np.clip(peak.second_ratio, 0.0, 1.2),
            np.clip(peak.height / peak.clutter_std, 0.0, 20.0),
            np.clip(peak.sharpness, 0.0, 1.0),
            float(peak.at_edge),
            np.clip(evidence.consensus, -2.0, 10.0),
            evidence.turn**2,
            evidence.stretch**2,
        ]
    )


def consensus(template: Channels, mask: NDArray[np.bool_], search: Channels, row: int, col: int) -> float:
    """How far the windows of a template agree with the map at the place where its first pixel lies at (row, col).

    The template (c, rows, cols) is cut into three by three windows; each has a similarity of its own there, and counted
    is their mean over its standard error: chance agrees in one place and disagrees in the next.
    """
    rows, cols = mask.shape
    there = search[:, row : row + rows, col : col + cols]
    own = []
    for part_rows in np.array_split(np.arange(rows), WINDOWS):
        for part_cols in np.array_split(np.arange(cols), WINDOWS):
            window = (slice(part_rows[0], part_rows[-1] + 1), slice(part_cols[0], part_cols[-1] + 1))
            if mask[window].mean() < 0.5:
                continue
            inside = mask[window].astype(np.float32)
            count = float(inside.sum())
            a, b = template[(slice(None), *window)], there[(slice(None), *window)]
            a = (a - (a * inside).sum(axis=(1, 2), keepdims=True) / count) * inside
            b = (b - (b * inside).sum(axis=(1, 2), keepdims=True) / count) * inside
            energy = float((a * a).sum()) * float((b * b).sum())
            own.append(float((a * b).sum()) / np.sqrt(max(energy, 1e-6)))
    if len(own) < 3:
        return 0.0
    # a fifth of a tenth of similarity of its own: a few windows that agree by chance are not beyond doubt
    return float(np.mean(own) / (np.std(own, ddof=1) / np.sqrt(len(own)) + 0.02))


WINDOWS = 3


@dataclass(frozen=True, slots=True)
class OutlierWeights:
    """Logistic regression from a match's features to the log odds of a wrong one: ``bias`` and (9,) ``weights``."""

    bias: float
    weights: tuple[float, ...]


def outlier_probability(evidence: MatchEvidence, weights: OutlierWeights) -> float:
    """Probability that the peak is not where the truth is."""
    log_odds = weights.bias + float(features(evidence) @ np.asarray(weights.weights))
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -30.0, 30.0))))
