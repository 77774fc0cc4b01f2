"""Reference imagery as the matcher wants it: grey, north up, square pixels, in metres of the local frame."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.local import LocalFrame
from estimator.types import Float, Image
from geodata.errors import EmptyRasterError, HugeRasterError
from geodata.radiometry import Radiometry
from geodata.raster import Raster, open_raster
from geodata.resample import resample

Mask = NDArray[np.bool_]

MAX_GRID_PIXELS = 120_000_000

# Between nodes this far apart the projections bend by less than a tenth of a millimetre.
NODE_STEP_M = 60.0

# Orthophotos often come with a black or white collar and no nodata value; JPEG leaves it a few levels off.
_COLLAR_BLACK, _COLLAR_WHITE, _COLLAR_LEAST_PX = 4, 251, 400


@dataclass(frozen=True, slots=True)
class NeBounds:
    """A rectangle of the local frame, metres."""

    north_min_m: float
    east_min_m: float
    north_max_m: float
    east_max_m: float

    def __post_init__(self) -> None:
        sides = (self.north_min_m, self.east_min_m, self.north_max_m, self.east_max_m)
        if not all(map(math.isfinite, sides)) or sides[0] >= sides[2] or sides[1] >= sides[3]:
            message = f"not a rectangle: {self}"
            raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class ImageryGrid:
    """Grey imagery on a north-up grid of the local frame.

    The centre of pixel (row r, column c) lies at north = ``north_max_m`` - r ``gsd_m``, east = ``east_min_m`` +
    c ``gsd_m``. ``image`` (rows, cols) is grey and read-only, ``valid`` (rows, cols) marks the pixels that hold
    imagery; the others are 0.
    """

    image: Image
    valid: Mask
    north_max_m: float
    east_min_m: float
    gsd_m: float

    @property
    def bounds_ne_m(self) -> tuple[float, float, float, float]:
        """First and last pixel centres: least north, least east, greatest north, greatest east."""
        rows, cols = self.image.shape
        south, east = self.north_max_m - (rows - 1) * self.gsd_m, self.east_min_m + (cols - 1) * self.gsd_m
        return south, self.east_min_m, self.north_max_m, east

    def window(self, north_min_m: float, east_min_m: float, north_max_m: float, east_max_m: float) -> ImageryGrid:
        """The pixels that cover a rectangle, on this grid's own lattice; what lies off the map is invalid.

        Inside the map the result is a view, without a copy.
        """
        bounds = NeBounds(north_min_m, east_min_m, north_max_m, east_max_m)
        top = math.floor((self.north_max_m - bounds.north_max_m) / self.gsd_m + 1e-9)
        left = math.floor((bounds.east_min_m - self.east_min_m) / self.gsd_m + 1e-9)
        bottom = math.ceil((self.north_max_m - bounds.north_min_m) / self.gsd_m - 1e-9) + 1
        right = math.ceil((bounds.east_max_m - self.east_min_m) / self.gsd_m - 1e-9) + 1
        if (bottom - top) * (right - left) > MAX_GRID_PIXELS:
            message = f"window of {bottom - top} x {right - left} pixels is larger than {MAX_GRID_PIXELS}"
            raise ValueError(message)
        rows, cols = self.image.shape
        north, east = self.north_max_m - top * self.gsd_m, self.east_min_m + left * self.gsd_m
        if top >= 0 and left >= 0 and bottom <= rows and right <= cols:
            inside = (slice(top, bottom), slice(left, right))
            return ImageryGrid(self.image[inside], self.valid[inside], north, east, self.gsd_m)
        image = np.zeros((bottom - top, right - left), dtype=np.uint8)
        valid = np.zeros(image.shape, dtype=np.bool_)
        row_0, row_1 = max(top, 0), min(bottom, rows)
        col_0, col_1 = max(left, 0), min(right, cols)
        if row_0 < row_1 and col_0 < col_1:
            to = (slice(row_0 - top, row_1 - top), slice(col_0 - left, col_1 - left))
            image[to] = self.image[row_0:row_1, col_0:col_1]
            valid[to] = self.valid[row_0:row_1, col_0:col_1]
        return ImageryGrid(image, valid, north, east, self.gsd_m)


class ReferenceImagery:
    """A georeferenced picture of any CRS, band count and pixel type.

    ``offset_ne_m`` is the picture's known displacement: it is added to every position read off it.
    """

    def __init__(self, raster: Raster, offset_ne_m: tuple[float, float] = (0.0, 0.0)) -> None:
        if not all(map(math.isfinite, offset_ne_m)):
            message = f"offset_ne_m must be two finite numbers, not {offset_ne_m}"
            raise ValueError(message)
        self.raster = raster
        self.offset_ne_m = offset_ne_m
        self._radiometry = Radiometry.of(raster)

    @classmethod
    def open(cls, path: str | os.PathLike[str], offset_ne_m: tuple[float, float] = (0.0, 0.0)) -> ReferenceImagery:
        """Open a file; raises a :class:`geodata.errors.RasterError` that says what is wrong with it."""
        return cls(open_raster(path), offset_ne_m)

    @property
    def gsd_m(self) -> float:
        """The file's own ground sample distance, metres."""
        return self.raster.gsd_m

    def bounds_ne(self, frame: LocalFrame) -> NeBounds:
        """The rectangle of the local frame around the picture."""
        return footprint_bounds(self.raster, frame, self.offset_ne_m)

    def grid(self, frame: LocalFrame, gsd_m: float | None = None, bounds: NeBounds | None = None) -> ImageryGrid:
        """The picture on a north-up grid of the local frame.

        Parameters
        ----------
        gsd_m
            Metres per pixel; the file's own when not given. Finer sources are averaged over each pixel's area.
        bounds
            What to cover; the whole picture when not given.

        Raises
        ------
        HugeRasterError
            The grid would exceed 120 million pixels; the message names a resolution that fits.
        EmptyRasterError
            No valid pixel lies in the bounds.
        """
        gsd_m = self.gsd_m if gsd_m is None else gsd_m
        if not (math.isfinite(gsd_m) and gsd_m > 0):
            message = f"gsd_m must be a positive number of metres, not {gsd_m}"
            raise ValueError(message)
        area = bounds or self.bounds_ne(frame)
        north_span_m, east_span_m = area.north_max_m - area.north_min_m, area.east_max_m - area.east_min_m
        rows, cols = math.ceil(north_span_m / gsd_m), math.ceil(east_span_m / gsd_m)
        if rows * cols > MAX_GRID_PIXELS:
            fitting_m = math.sqrt(north_span_m * east_span_m / MAX_GRID_PIXELS) * 1.01
            raise HugeRasterError(
                self.raster.path,
                f"covers {cols} x {rows} pixels at {gsd_m:.3g} m, more than {MAX_GRID_PIXELS // 10**6} million",
                f"use {fitting_m:.3g} m per pixel or coarser, or a smaller area",
            )
        north_max_m, east_min_m = area.north_max_m - gsd_m / 2, area.east_min_m + gsd_m / 2
        offset_north_m, offset_east_m = self.offset_ne_m

        def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
            north_m = north_max_m - row * gsd_m - offset_north_m
            east_m = east_min_m + col * gsd_m - offset_east_m
            lat_rad, lon_rad = frame.geodetic_from_ne(np.stack([north_m, east_m], axis=-1))
            return lat_rad, lon_rad

        planes, valid = resample(
            self.raster, self._radiometry.grey, geodetic_at, rows, cols, node_step_px=max(4.0, NODE_STEP_M / gsd_m)
        )
        image = np.rint(planes[0]).astype(np.uint8)
        del planes
        valid &= ~_collar(image, valid)
        if not valid.any():
            raise EmptyRasterError(
                self.raster.path,
                "holds no valid pixel in the area asked for",
                "check that it covers the flight and that its nodata value is right",
            )
        image[~valid] = 0
        image.setflags(write=False)
        valid.setflags(write=False)
        return ImageryGrid(image, valid, north_max_m, east_min_m, gsd_m)

    def close(self) -> None:
        """Release the file."""
        self.raster.close()


def footprint_bounds(raster: Raster, frame: LocalFrame, offset_ne_m: tuple[float, float] = (0.0, 0.0)) -> NeBounds:
    """The rectangle of the local frame around a raster's footprint, shifted by an offset."""
    ne_m = frame.ne_from_geodetic(*raster.footprint()) + np.asarray(offset_ne_m)
    ne_m = ne_m[np.all(np.isfinite(ne_m), axis=-1)]
    north_min, east_min = (float(value) for value in ne_m.min(axis=0))
    north_max, east_max = (float(value) for value in ne_m.max(axis=0))
    return NeBounds(north_min, east_min, north_max, east_max)


def _collar(image: Image, valid: Mask) -> Mask:
    """Pixels of a uniformly black or white border that touches the edge of what is valid."""
    collar = np.zeros(image.shape, dtype=np.bool_)
    outside = np.pad(~valid, 1, constant_values=True)
    rim = cv2.dilate(outside.astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0
    for blank in ((image <= _COLLAR_BLACK) & valid, (image >= _COLLAR_WHITE) & valid):
        if np.count_nonzero(blank & rim) < 2:
            continue
        _, labels, stats, _ = cv2.connectedComponentsWithStats(blank.astype(np.uint8), connectivity=4)
        touching = np.unique(labels[blank & rim])
        large = touching[stats[touching, cv2.CC_STAT_AREA] >= _COLLAR_LEAST_PX]
        if large.size:
            listed = np.zeros(len(stats), dtype=np.uint8)
            listed[large] = 1
            found = listed[labels]
            # The last pixels before the picture are a blend of both.
            collar |= cv2.dilate(found, np.ones((3, 3), np.uint8)) > 0
    return collar & valid
