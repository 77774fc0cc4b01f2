"""The bare ground's relief."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.world.layout import Layout, distance_to_line_m
from simulator.world.noise import FractalNoise
from simulator.world.patch import Float32, Patch

POST_SPACING_M = 4.0
_MARGIN_M = 400.0


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """Heights (rows, cols) above the world's datum, on posts of ``patch``; bilinear between, level outside."""

    patch: Patch
    height_m: Float32

    def at(self, north_m: ArrayLike, east_m: ArrayLike) -> Float:
        """Height above the datum at positions of any shape."""
        north, east = np.broadcast_arrays(np.asarray(north_m, np.float64), np.asarray(east_m, np.float64))
        row = np.clip((self.patch.north_max_m - north) / self.patch.gsd_m, 0.0, self.patch.rows - 1.001)
        col = np.clip((east - self.patch.east_min_m) / self.patch.gsd_m, 0.0, self.patch.cols - 1.001)
        r, c = row.astype(int), col.astype(int)
        fr, fc = row - r, col - c
        h = self.height_m
        top = h[r, c] * (1 - fc) + h[r, c + 1] * fc
        bottom = h[r + 1, c] * (1 - fc) + h[r + 1, c + 1] * fc
        return np.asarray(top * (1 - fr) + bottom * fr, np.float64)

    def on(self, patch: Patch) -> Float32:
        """Heights on the pixels of a finer patch."""
        step = patch.gsd_m / self.patch.gsd_m
        row, col = self.patch.row_col(np.array([patch.north_max_m, patch.east_min_m]))
        warped = cv2.warpAffine(
            self.height_m,
            np.array([[step, 0.0, col], [0.0, step, row]]),
            (patch.cols, patch.rows),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.asarray(warped, np.float32)


def make_terrain(seed: int, layout: Layout, relief_m: float) -> Terrain:
    """Rolling hills of about ``relief_m`` from lowest to highest, a valley along the stream, a level lake."""
    half = layout.half_size_m + _MARGIN_M
    size = int(2 * half / POST_SPACING_M) + 1
    patch = Patch(half, -half, size, size, POST_SPACING_M)
    noise = FractalNoise(rng_for(seed, "world", "relief"))
    hills = noise.sample(patch, 420.0, 6, persistence=0.42)
    height = hills * np.float32(relief_m / 5.0)
    points = np.stack(np.broadcast_arrays(patch.norths_m(), patch.easts_m()), axis=-1).reshape(-1, 2).astype(np.float64)
    to_stream = distance_to_line_m(points, layout.stream_ne_m[::5]).reshape(size, size)
    height -= (relief_m / 5.0 * np.exp(-((to_stream / 90.0) ** 2))).astype(np.float32)
    lake = np.zeros((size, size), np.uint8)
    patch.fill(lake, layout.lake_ne_m, 1)
    level = np.float32(np.percentile(height[lake > 0], 20)) if lake.any() else np.float32(0.0)
    away_m = cv2.distanceTransform(1 - lake, cv2.DIST_L2, 5) * np.float32(POST_SPACING_M)
    # The shore rises gently, so that no cliff stands around the water.
    blend = np.clip(away_m / np.float32(70.0), 0.0, 1.0)
    height = level + (height - level) * blend * blend * (3 - 2 * blend)
    return Terrain(patch, height.astype(np.float32))
