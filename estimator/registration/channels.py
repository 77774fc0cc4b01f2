"""Image channels that survive a change of season, light and sensor."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.types import Image

Channels = NDArray[np.float32]


def double_angle_gradients(image: Image, smoothing_px: float = 1.0) -> Channels:
    """Gradient direction in double-angle form, saturated in magnitude: channels (2, rows, cols).

    c1 = (gx^2 - gy^2) / (m^2 + k), c2 = 2 gx gy / (m^2 + k) with k five times the median of m^2 over the textured
    pixels, so that edges count and the grain between them does not; a reversal of contrast leaves them unchanged.
    Normalised gradient fields of Haber and Modersitzki (Intensity gradient based registration and fusion of multi-modal
    images, MICCAI 2006) in the form that a correlation can sum.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), smoothing_px).astype(np.float32)
    gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)
    gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)
    xx, yy = gx * gx, gy * gy
    magnitude = xx + yy
    textured = magnitude[magnitude > 0.0]
    k = 5.0 * float(np.median(textured)) if textured.size else 1.0
    scale = 1.0 / (magnitude + max(k, 1.0))
    return np.stack(((xx - yy) * scale, 2.0 * gx * gy * scale))


def intensity(image: Image, smoothing_px: float = 1.0) -> Channels:
    """The grey image itself (1, rows, cols), as in Conte 2009, section 5.7."""
    smooth = cv2.GaussianBlur(image, (0, 0), smoothing_px).astype(np.float32)
    return np.asarray(smooth - smooth.mean())[None]


EDGE_MEDIAN_PX = 5
EDGE_SHARE = 0.15


def edge_overlap(image: Image) -> Channels:
    """One where the picture has an edge and zero elsewhere: channels (1, rows, cols).

    Correlating them counts the edge pixels that overlap, as Conte and Doherty do (An integrated UAV navigation system
    based on aerial image matching, IEEE Aerospace Conference 2008, section 5): median filter against small things,
    Sobel, then the strongest pixels. They name no threshold; a fixed share of the pixels needs none for each light.
    """
    smooth = cv2.medianBlur(image, EDGE_MEDIAN_PX)
    gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)
    gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)
    strength = gx * gx + gy * gy
    # where less than that share has any gradient at all, all of it is edge
    threshold = max(float(np.quantile(strength, 1.0 - EDGE_SHARE)), 1.0)
    return np.asarray(strength >= threshold, dtype=np.float32)[None]


CHANNELS = {"double_angle": double_angle_gradients, "intensity": intensity, "edge_overlap": edge_overlap}
"""Channels of one picture; the matcher adds those that are built upon them (``alignment.COMPARED``)."""
