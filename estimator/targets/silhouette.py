"""What of a clicked patch belongs to the thing in its middle.

First the bar that the strongest edge runs about, of a vehicle's proportions, wherever it lies about the click and
whichever way it points; then graph cuts within a narrow band about its outline (Rother, Kolmogorov and Blake, GrabCut,
ACM Trans. Graphics 23(3), 2004). Graph cuts alone take a roof for a car, as the windscreen parts it from the bonnet, or
a car and its shadow for one.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.types import Float, Image

LENGTH, WIDTHS = 0.9, (0.36, 0.46)
"""Of a bar, over the thing's greatest extent."""
COUNT = 18
SHIFTS = (-0.12, 0.0, 0.12)
"""By which the click may be off the middle, along and across, over the greatest extent."""
EDGE_PX, MOST_EDGE, LEAST_EDGE = 1.5, 20.0, 8.0
"""How far inside and outside of the outline colours are compared; by how much they may differ at most, so that no part
of the outline speaks for all of it, and must on the average; CIE L*a*b* in OpenCV's 8-bit units."""
BAND = 0.06
"""How far the outline may move, over the greatest extent."""
LEAST_AREA, MOST_AREA = 0.06, 0.9
"""Of a disc of the greatest extent."""


def silhouette(patch: Image, size_px: float) -> NDArray[np.uint8]:
    """What of a patch (2 h + 1, 2 h + 1, 3) is the thing in its middle (1), what ground (0); a disc where unclear."""
    rows, cols = patch.shape[:2]
    v, u = np.mgrid[0:rows, 0:cols]
    away = np.hypot(v - (rows - 1) / 2, u - (cols - 1) / 2)
    marks = np.full((rows, cols), cv2.GC_BGD, np.uint8)
    bar = _bar(patch, size_px)
    if bar is None:
        marks[away <= 0.65 * size_px] = cv2.GC_PR_BGD
        marks[away <= 0.35 * size_px] = cv2.GC_PR_FGD
        marks[away <= max(1.0, 0.10 * size_px)] = cv2.GC_FGD
    else:
        band = np.ones((2 * round(BAND * size_px) + 1,) * 2, np.uint8)
        marks[cv2.dilate(bar, band) > 0] = cv2.GC_PR_BGD
        marks[bar > 0] = cv2.GC_PR_FGD
        marks[cv2.erode(bar, band) > 0] = cv2.GC_FGD
    cut = _cut(patch, marks)
    most = math.pi * (0.5 * size_px) ** 2
    if cut is not None and LEAST_AREA * most <= int(cut.sum()) <= MOST_AREA * most:
        return cut
    return np.asarray(away <= 0.25 * size_px, np.uint8) if bar is None else bar


def _cut(patch: Image, marks: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """The connected part about the middle of what graph cuts take for the thing; None where there is none."""
    cv2.setRNGSeed(0)  # its k-means draws at random; the same click must give the same template
    cv2.grabCut(patch, marks, (0, 0, 1, 1), np.zeros((1, 65)), np.zeros((1, 65)), 3, cv2.GC_INIT_WITH_MASK)
    cut = ((marks == cv2.GC_FGD) | (marks == cv2.GC_PR_FGD)).astype(np.uint8)
    count, labels = cv2.connectedComponents(cut, connectivity=4)
    middle = labels[(patch.shape[0] - 1) // 2, (patch.shape[1] - 1) // 2]
    return None if count < 2 or middle == 0 else (labels == middle).astype(np.uint8)


def _bar(patch: Image, size_px: float) -> NDArray[np.uint8] | None:
    """The bar with the strongest edge about it, as a mask; None where none has one."""
    smooth = cv2.GaussianBlur(patch, (0, 0), 0.7)
    lab = np.asarray(cv2.cvtColor(smooth, cv2.COLOR_BGR2LAB), np.float32)
    half = patch.shape[0] // 2
    best: tuple[float, float, float, Float] = (LEAST_EDGE, 0.0, 0.0, np.zeros(2))
    for width in WIDTHS:
        outline, out = _outline(0.5 * LENGTH * size_px, 0.5 * width * size_px)
        for angle in np.pi * np.arange(COUNT) / COUNT:
            c, s = math.cos(angle), math.sin(angle)
            turn = np.array([[c, -s], [s, c]])
            inner, outer = (outline - EDGE_PX * out) @ turn.T, (outline + EDGE_PX * out) @ turn.T
            for along in SHIFTS:
                for across in SHIFTS:
                    middle = turn @ np.array([along, across]) * size_px
                    a = np.clip(np.round(inner + middle).astype(int) + half, 0, 2 * half)
                    b = np.clip(np.round(outer + middle).astype(int) + half, 0, 2 * half)
                    step = lab[a[:, 1], a[:, 0]] - lab[b[:, 1], b[:, 0]]
                    edge = float(np.minimum(np.sqrt((step * step).sum(axis=1)), MOST_EDGE).mean())
                    if edge > best[0]:
                        best = (edge, width, float(angle), middle)
    _, width, angle, middle = best
    if width == 0.0:
        return None
    corners = cv2.boxPoints(
        ((float(half + middle[0]), float(half + middle[1])), (LENGTH * size_px, width * size_px), math.degrees(angle))
    )
    mask = np.zeros(patch.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.round(corners).astype(np.int32)], (1,))
    return mask


def _outline(half_length: float, half_width: float) -> tuple[Float, Float]:
    """Points (n, 2) about a bar, some 1.5 pixels apart, and which way (n, 2) is out."""
    along = np.linspace(-half_length, half_length, max(6, round(2 * half_length / 1.5)))
    across = np.linspace(-half_width, half_width, max(4, round(2 * half_width / 1.5)))[1:-1]
    points, out = [], []
    for side in (1.0, -1.0):
        points += [np.column_stack((along, np.full_like(along, side * half_width)))]
        out += [np.tile([0.0, side], (len(along), 1))]
        points += [np.column_stack((np.full_like(across, side * half_length), across))]
        out += [np.tile([side, 0.0], (len(across), 1))]
    return np.vstack(points), np.vstack(out)
