"""Headings from straight lines: roads, walls and furrows of a picture turned onto those of the map.

The line-angle histogram of a Hough transform, correlated round the circle, says by how much two views are turned
against each other without knowing where they lie; Conte 2009, section 5.7, names the approach and leaves it for want of
roads. Lines have no direction, so angles count modulo half a turn, and in a town modulo a quarter: what comes out are
hypotheses for the correlation to judge, never a heading.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.types import Float, Image

BINS = 360
"""Half a turn in steps of half a degree."""
SPREAD_BINS = 3.0
MIN_LENGTH_SHARE = 0.12
MIN_LINES = 4
MIN_CONTRAST = 1.3
"""A peak must stand so far above the mean of the correlation."""


def direction_histogram(image: Image, mask: NDArray[np.bool_]) -> Float | None:
    """Length of the straight lines of a north-up picture (rows, cols) over their bearing modulo pi, (BINS,).

    ``mask`` (rows, cols) says where there is picture; lines along its rim do not count. None where there are too few.
    """
    edges = cv2.Canny(cv2.GaussianBlur(image, (0, 0), 1.0), 40.0, 120.0)
    edges[cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) == 0] = 0
    shortest = max(MIN_LENGTH_SHARE * min(image.shape), 10.0)
    # annotated because OpenCV's stubs do not know that it gives None where it finds nothing
    found: np.ndarray | None = cv2.HoughLinesP(
        edges, 1.0, np.pi / BINS, round(0.7 * shortest), minLineLength=shortest, maxLineGap=3.0
    )
    if found is None or len(found) < MIN_LINES:
        return None
    x1, y1, x2, y2 = found.reshape(-1, 4).T.astype(np.float64)
    bearing = np.arctan2(x2 - x1, y1 - y2) % np.pi
    histogram, _ = np.histogram(bearing, BINS, (0.0, np.pi), weights=np.hypot(x2 - x1, y2 - y1))
    around = (np.arange(BINS) + BINS // 2) % BINS - BINS // 2
    kernel = np.exp(-0.5 * (around / SPREAD_BINS) ** 2)
    smooth: Float = np.fft.irfft(np.fft.rfft(histogram) * np.fft.rfft(kernel), BINS)
    return smooth


def headings_by_lines(
    template: Image, mask: NDArray[np.bool_], search: Image, known: NDArray[np.bool_], reach_rad: float, most: int = 3
) -> Float:
    """Corrections of the heading, within ``reach_rad``, that turn the template's lines onto the map's; best first.

    A template rectified with a heading that is too small by h shows the map's bearings smaller by h. Empty where
    template or map has too few lines, or no angle stands out.
    """
    here, there = direction_histogram(template, mask), direction_histogram(search, known)
    if here is None or there is None:
        return np.zeros(0)
    score = np.fft.irfft(np.fft.rfft(there) * np.conj(np.fft.rfft(here)), BINS)
    peak = (score > np.roll(score, 1)) & (score >= np.roll(score, -1)) & (score > MIN_CONTRAST * score.mean())
    angle = (np.arange(BINS) + BINS // 2) % BINS - BINS // 2
    candidates = np.flatnonzero(peak & (np.abs(angle) * np.pi / BINS <= reach_rad))
    best = candidates[np.argsort(-score[candidates])][:most]
    before, at, after = score[best - 1], score[best], score[(best + 1) % BINS]
    vertex = 0.5 * (before - after) / np.minimum(before - 2.0 * at + after, -1e-12)
    found: Float = (angle[best] + vertex) * np.pi / BINS
    return found
