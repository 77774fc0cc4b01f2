"""How likely is a match to be wrong, from the shape of its similarity surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.robust import robust_std
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class Peak:
    """The best place of a surface and what speaks for it.

    ``row``, ``col`` are sub-pixel. ``psr`` is the peak's height over the rest of the surface in its standard
    deviations; ``second_ratio`` the highest similarity more than five pixels away over the peak's. ``height`` is over
    the rest's median, and ``clutter_std`` its scatter, robustly: the ridge that a straight road draws is not clutter.
    """

    row: float
    col: float
    value: float
    psr: float
    second_ratio: float
    at_edge: bool
    height: float
    clutter_std: float


EXCLUDED_PX = 5


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
    at_edge = row in (0, rows - 1) or col in (0, cols - 1)
    if at_edge:
        return Peak(float(row), float(col), value, psr, second, True, height, clutter)
    d_row = vertex(filled[row - 1, col], value, filled[row + 1, col])
    d_col = vertex(filled[row, col - 1], value, filled[row, col + 1])
    return Peak(row + d_row, col + d_col, value, psr, second, False, height, clutter)


def vertex(before: float, at: float, after: float) -> float:
    """Where a parabola through three samples a step apart is highest, from the middle one, half a step at the most."""
    curvature = before - 2.0 * at + after
    if curvature >= -1e-9:
        return 0.0
    return float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5))


@dataclass(frozen=True, slots=True)
class MatchEvidence:
    """What speaks for and against a match, beside its surface's ``peak``.

    ``turn`` is the correction of heading as a share of the largest that was tried, 0 where nothing else was: right
    places need what the prediction errs by, wrong ones take any. ``other`` is how alike picture and map are at the peak
    by another measure of similarity, in [-1, 1]; 0 where too little of the map is known.
    """

    peak: Peak
    turn: float
    other: float


FEATURES = ("value", "psr", "second_ratio", "at_edge", "turn", "other")
"""What the outlier probability is a regression on, in the order of ``features``."""


def features(evidence: MatchEvidence) -> Float:
    """What the regression sees (6,). What is beyond doubt is clipped: it must not outweigh the rest."""
    peak = evidence.peak
    return np.array(
        [
            peak.value, np.clip(peak.psr, 0.0, 15.0), np.clip(peak.second_ratio, 0.0, 1.2), float(peak.at_edge),
            evidence.turn**2, evidence.other,
        ]
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class OutlierWeights:
    """Logistic regression from a match's features to the log odds of a wrong one: ``bias`` and (6,) ``weights``."""

    bias: float
    weights: tuple[float, ...]


def outlier_probability(evidence: MatchEvidence, weights: OutlierWeights) -> float:
    """Probability that the peak is not where the truth is."""
    log_odds = weights.bias + float(features(evidence) @ np.asarray(weights.weights))
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -30.0, 30.0))))
