"""Sub-pixel edges of known curves: along normals of a predicted curve, where the grey value changes most."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.types import Float, Image

STEP_PX = 0.5
LEAST_CONTRAST = 6.0
"""Grey levels across a pixel: the strength of an edge. Weaker changes are noise."""


def edges_along(
    image: Image, points_px: Float, normals_px: Float, rises: Float, reach_px: float
) -> tuple[Float, Float]:
    """How far along its normal each point's edge lies, in pixels (n,), and its strength (n,); NaN where there is none.

    Parameters
    ----------
    image
        Grey picture (rows, cols).
    points_px, normals_px
        Points (n, 2) of the predicted curve and unit normals (n, 2).
    rises
        (n,) of 1 where it gets brighter along the normal, -1 where darker.
    reach_px
        Edges are sought so far on both sides.

    Notes
    -----
    Parabola through the largest difference of grey values a pixel apart and its neighbours (Devernay, INRIA RR-2724).
    """
    half = int(np.ceil(reach_px / STEP_PX))
    # One more on each side for the parabola, one more for the differences.
    along = np.arange(-half - 2, half + 3) * STEP_PX
    x = (points_px[:, :1] + normals_px[:, :1] * along).astype(np.float32)
    y = (points_px[:, 1:] + normals_px[:, 1:] * along).astype(np.float32)
    grey = np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
    change = (grey[:, 2:] - grey[:, :-2]) * rises[:, np.newaxis].astype(np.float32)
    # Along the normal bilinear interpolation ripples with the grid; a small mask takes the ripple out.
    change = 0.25 * (change[:, :-2] + change[:, 2:]) + 0.5 * change[:, 1:-1]
    inner = change[:, 1:-1]
    if not inner.shape[1]:
        return np.full(len(points_px), np.nan), np.full(len(points_px), np.nan)
    best = np.argmax(inner, axis=1)
    rows = np.arange(len(points_px))
    before, at, after = change[rows, best], inner[rows, best], change[rows, best + 2]
    curvature = before - 2.0 * at + after
    peak = (at > LEAST_CONTRAST) & (at >= before) & (at >= after) & (curvature < 0.0)
    shift = 0.5 * (before - after) / np.where(peak, curvature, -1.0)
    offset = along[3 + best] + STEP_PX * shift
    rows_px, cols_px = image.shape[:2]
    inside = (x[:, 0] >= 0) & (x[:, -1] >= 0) & (x[:, 0] <= cols_px - 1) & (x[:, -1] <= cols_px - 1)
    inside &= (y[:, 0] >= 0) & (y[:, -1] >= 0) & (y[:, 0] <= rows_px - 1) & (y[:, -1] <= rows_px - 1)
    return np.where(peak & inside, offset, np.nan), np.where(peak & inside, at, np.nan)
