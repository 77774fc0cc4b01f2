"""Corner tracks between consecutive pictures: detection by Shi-Tomasi, tracking by pyramidal Lucas-Kanade."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.types import Float, Image


@dataclass(frozen=True, slots=True)
class TrackerConfig:
    """Numbers of corners and the tracker's window."""

    max_corners: int = 220
    min_corners: int = 205
    quality: float = 0.01
    min_distance_px: float = 14.0
    window_px: int = 17
    levels: int = 3
    border_px: int = 6
    max_residual: float = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Pixels (n, 2) of the same corners in the previous and in the present picture.

    ``kept`` (n,) are their indices among the corners of the previous picture; they are the first of the present one's.
    """

    previous_uv_px: Float
    present_uv_px: Float
    kept: NDArray[np.intp]


class CornerTracker:
    """Follows corners from picture to picture; keeps the last picture and its corners."""

    def __init__(self, camera: Camera, config: TrackerConfig | None = None) -> None:
        self.config = config or TrackerConfig()
        self._camera = camera
        self._last: Image | None = None
        self._corners = np.empty((0, 1, 2), dtype=np.float32)
        self._criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.03)

    def reset(self) -> None:
        """Forget the last picture."""
        self._last = None
        self._corners = np.empty((0, 1, 2), dtype=np.float32)

    @property
    def corners_uv_px(self) -> Float:
        """Corners (n, 2) in the last picture: the ones that the next call follows."""
        return self._corners.reshape(-1, 2).astype(np.float64)

    def track(self, image: Image, predicted_uv_px: Float | None = None) -> Tracks | None:
        """Follow the corners into a grey picture; ``predicted_uv_px`` (n, 2) says where they are expected.

        None for the first picture and where nothing could be followed. Afterwards the picture's own corners (followed
        and new) are the ones to follow next.
        """
        tracks = self._follow(image, predicted_uv_px)
        followed = np.empty((0, 2)) if tracks is None else tracks.present_uv_px
        self._last = image
        self._corners = self._replenished(image, followed)
        return tracks

    def _follow(self, image: Image, predicted_uv_px: Float | None) -> Tracks | None:
        if len(self._corners) == 0 or self._last is None:
            return None
        window = (self.config.window_px, self.config.window_px)
        start = self._corners.copy()
        flags = 0
        if predicted_uv_px is not None:
            finite = np.isfinite(predicted_uv_px).all(axis=1)
            start[finite, 0] = predicted_uv_px[finite]
            flags = cv2.OPTFLOW_USE_INITIAL_FLOW
        found, status, error = cv2.calcOpticalFlowPyrLK(
            self._last, image, self._corners, start, winSize=window, maxLevel=self.config.levels,
            criteria=self._criteria, flags=flags, minEigThreshold=1e-3,
        )  # fmt: skip
        uv = found.reshape(-1, 2)
        border = self.config.border_px
        good = (
            (status.ravel() == 1) & (error.ravel() < self.config.max_residual)
            & (uv[:, 0] > border) & (uv[:, 0] < self._camera.width_px - 1 - border)
            & (uv[:, 1] > border) & (uv[:, 1] < self._camera.height_px - 1 - border)
        )  # fmt: skip
        if not good.any():
            return None
        previous = self._corners.reshape(-1, 2)[good].astype(np.float64)
        return Tracks(previous, uv[good].astype(np.float64), np.flatnonzero(good))

    def _replenished(self, image: Image, followed_uv_px: Float) -> np.ndarray:
        config = self.config
        if len(followed_uv_px) >= config.min_corners:
            return followed_uv_px.astype(np.float32).reshape(-1, 1, 2)
        mask = np.full(image.shape, 255, dtype=np.uint8)
        for u, v in followed_uv_px.astype(int):
            cv2.circle(mask, (int(u), int(v)), int(config.min_distance_px), 0, -1)
        # annotated because OpenCV's stubs do not know that it gives None where it finds nothing
        new: np.ndarray | None = cv2.goodFeaturesToTrack(
            image, config.max_corners - len(followed_uv_px), config.quality, config.min_distance_px, mask=mask
        )
        old = followed_uv_px.astype(np.float32).reshape(-1, 1, 2)
        return old if new is None else np.concatenate((old, new.reshape(-1, 1, 2)))
