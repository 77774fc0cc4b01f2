"""A rectangle of ground as a raster: where its pixels are, and how to draw on it in metres."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.types import Float

Float32 = NDArray[np.float32]

# OpenCV draws with fixed-point coordinates; four bits of fraction are 1.25 cm at 0.2 m a pixel.
_SHIFT = 4


@dataclass(frozen=True, slots=True)
class Patch:
    """North-up raster: pixel (row, col) has its centre at north_max_m - row * gsd_m, east_min_m + col * gsd_m."""

    north_max_m: float
    east_min_m: float
    rows: int
    cols: int
    gsd_m: float

    @property
    def north_min_m(self) -> float:
        """North of the last row."""
        return self.north_max_m - (self.rows - 1) * self.gsd_m

    @property
    def east_max_m(self) -> float:
        """East of the last column."""
        return self.east_min_m + (self.cols - 1) * self.gsd_m

    def grown(self, margin_px: int) -> Patch:
        """The same raster with a margin on all sides."""
        return Patch(
            self.north_max_m + margin_px * self.gsd_m,
            self.east_min_m - margin_px * self.gsd_m,
            self.rows + 2 * margin_px,
            self.cols + 2 * margin_px,
            self.gsd_m,
        )

    def coarser(self, factor: int) -> Patch:
        """The raster whose pixels are blocks of factor x factor of this one; the size must divide."""
        shift_m = (factor - 1) * self.gsd_m / 2
        return Patch(
            self.north_max_m - shift_m,
            self.east_min_m + shift_m,
            self.rows // factor,
            self.cols // factor,
            self.gsd_m * factor,
        )

    def row_col(self, points_ne_m: Float) -> Float:
        """Fractional (row, col) of points (..., 2)."""
        points = np.asarray(points_ne_m, dtype=np.float64)
        return np.stack(
            [(self.north_max_m - points[..., 0]) / self.gsd_m, (points[..., 1] - self.east_min_m) / self.gsd_m], axis=-1
        )

    def norths_m(self) -> Float32:
        """North of each row, as a column (rows, 1)."""
        return (self.north_max_m - np.arange(self.rows) * self.gsd_m).astype(np.float32)[:, None]

    def easts_m(self) -> Float32:
        """East of each column, as a row (1, cols)."""
        return (self.east_min_m + np.arange(self.cols) * self.gsd_m).astype(np.float32)[None, :]

    def touches(self, points_ne_m: Float, margin_m: float = 0.0) -> bool:
        """Whether the bounding box of the points meets the patch."""
        low, high = points_ne_m.min(axis=0) - margin_m, points_ne_m.max(axis=0) + margin_m
        return bool(
            high[0] >= self.north_min_m
            and low[0] <= self.north_max_m
            and high[1] >= self.east_min_m
            and low[1] <= self.east_max_m
        )

    def box(self, points_ne_m: Float, margin_m: float = 0.0) -> tuple[slice, slice]:
        """Row and column slices that hold the bounding box of the points, clipped to the patch."""
        row_col = self.row_col(points_ne_m)
        low = np.floor(row_col.min(axis=0) - margin_m / self.gsd_m).astype(int)
        high = np.ceil(row_col.max(axis=0) + margin_m / self.gsd_m).astype(int) + 1
        r0, c0 = np.clip(low, 0, (self.rows, self.cols))
        r1, c1 = np.clip(high, 0, (self.rows, self.cols))
        return slice(int(r0), int(r1)), slice(int(c0), int(c1))

    def cut(self, rows: slice, cols: slice) -> Patch:
        """The part given by slices."""
        return Patch(
            self.north_max_m - rows.start * self.gsd_m,
            self.east_min_m + cols.start * self.gsd_m,
            rows.stop - rows.start,
            cols.stop - cols.start,
            self.gsd_m,
        )

    def fill(self, image: NDArray[np.uint8] | NDArray[np.uint16], outline_ne_m: Float, value: float) -> None:
        """Fill a polygon (n, 2) into ``image`` in place."""
        if self.touches(outline_ne_m):
            cv2.fillPoly(image, [self._fixed(outline_ne_m)], value, shift=_SHIFT)

    def stroke(
        self, image: NDArray[np.uint8] | NDArray[np.uint16], line_ne_m: Float, width_m: float, value: float
    ) -> None:
        """Draw a polyline (n, 2) of a width into ``image`` in place; an odd number of pixels wide, at least one."""
        if self.touches(line_ne_m, width_m):
            # OpenCV's lines come out 1 pixel wide for thickness 1, 3 for 2, 5 for 3 and 4, 7 for 5 and 6, and so on.
            half = round((width_m / self.gsd_m - 1) / 2)
            thickness = 1 if half <= 0 else max(2, 2 * half - 1)
            cv2.polylines(image, [self._fixed(line_ne_m)], False, value, thickness, shift=_SHIFT)

    def _fixed(self, points_ne_m: Float) -> NDArray[np.int32]:
        row_col = self.row_col(points_ne_m)
        return np.round(row_col[:, ::-1] * (1 << _SHIFT)).astype(np.int32)
