"""Height of the ground in the local frame: a grid from a raster, or flat."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.local import LocalFrame
from estimator.types import Float
from geodata.errors import EmptyRasterError, UnsupportedRasterError
from geodata.imagery import NODE_STEP_M, NeBounds, footprint_bounds
from geodata.raster import Bands, Raster, open_raster
from geodata.resample import resample

MAX_GRID_PIXELS = 8_000_000

# A national elevation model is cut to what a small aircraft can see.
_REACH_M = 10_000.0

# Below the Dead Sea's bed and above Everest: what lies beyond is a nodata value that nobody declared.
_LOWEST_M, _HIGHEST_M = -800.0, 9000.0

_METRES_PER_UNIT = {
    "": 1.0,
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "metres": 1.0,
    "meters": 1.0,
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "us-ft": 1200 / 3937,
    "ftus": 1200 / 3937,
    "us survey foot": 1200 / 3937,
    "us_survey_foot": 1200 / 3937,
    "cm": 0.01,
    "dm": 0.1,
}


class FlatGround:
    """Ground at one altitude everywhere."""

    __slots__ = ("_alt_amsl_m",)

    gsd_m: float = math.inf
    """There is no detail to sample."""

    def __init__(self, alt_amsl_m: float) -> None:
        if not math.isfinite(alt_amsl_m):
            message = f"alt_amsl_m must be finite, not {alt_amsl_m}"
            raise ValueError(message)
        self._alt_amsl_m = float(alt_amsl_m)

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        """The ground's altitude, in the shape of the broadcast inputs; NaN where an input is NaN."""
        zero: Float = (np.asarray(north_m, dtype=np.float64) + east_m) * 0.0
        return zero + self._alt_amsl_m


class ElevationGrid:
    """Ground altitudes on a north-up grid of the local frame.

    ``alt_amsl_grid_m`` (rows, cols), NaN where unknown; the centre of (row r, column c) lies at north =
    ``north_max_m`` - r ``gsd_m``, east = ``east_min_m`` + c ``gsd_m``. The vertical datum is the raster's own.
    """

    def __init__(
        self, alt_amsl_grid_m: NDArray[np.floating[Any]], north_max_m: float, east_min_m: float, gsd_m: float
    ) -> None:
        rows, cols = alt_amsl_grid_m.shape
        # A border of NaN stands for everything outside, so that a lookup needs no masks; float64, since mixing types
        # costs small lookups more than the arithmetic does.
        padded = np.full((rows + 2, cols + 2), np.nan)
        padded[1:-1, 1:-1] = alt_amsl_grid_m
        padded.setflags(write=False)
        self._flat = padded.ravel()
        self._cols = cols + 2
        self._row_limit, self._col_limit = rows + 0.999999, cols + 0.999999
        self.alt_amsl_grid_m: Float = padded[1:-1, 1:-1]
        self.north_max_m, self.east_min_m, self.gsd_m = north_max_m, east_min_m, gsd_m
        self._north_zero_m, self._east_zero_m = north_max_m + gsd_m, east_min_m - gsd_m
        self._per_m = 1.0 / gsd_m

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        frame: LocalFrame,
        gsd_m: float | None = None,
        bounds: NeBounds | None = None,
    ) -> ElevationGrid:
        """Resample an elevation raster once into the local frame.

        Parameters
        ----------
        gsd_m
            Metres per grid cell; the file's own when not given, made coarser until the grid has 8 million cells.
        bounds
            What to cover; the whole raster within 10 km of the frame's origin when not given.

        Raises
        ------
        RasterError
            One of its subclasses, saying what is wrong with the file.
        """
        with open_raster(path) as raster:
            scale, offset = height_scaling(raster)
            area = bounds or _within_reach(footprint_bounds(raster, frame))
            north_span_m, east_span_m = area.north_max_m - area.north_min_m, area.east_max_m - area.east_min_m
            step_m = max(gsd_m or raster.gsd_m, math.sqrt(north_span_m * east_span_m / MAX_GRID_PIXELS))
            rows, cols = max(2, math.ceil(north_span_m / step_m)), max(2, math.ceil(east_span_m / step_m))
            north_max_m, east_min_m = area.north_max_m - step_m / 2, area.east_min_m + step_m / 2

            def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
                ne_m = np.stack([north_max_m - row * step_m, east_min_m + col * step_m], axis=-1)
                lat_rad, lon_rad = frame.geodetic_from_ne(ne_m)
                return lat_rad, lon_rad

            def heights(bands: Bands) -> NDArray[np.float32]:
                return height_planes(bands, scale, offset)

            planes, valid = resample(
                raster, heights, geodetic_at, rows, cols, node_step_px=max(4.0, NODE_STEP_M / step_m), exact=True
            )
        if not valid.any():
            raise EmptyRasterError(
                raster.path,
                "holds no known height in the area asked for",
                "check that it covers the flight and that its nodata value is right",
            )
        return cls(np.where(valid, planes[0], np.float32(np.nan)), north_max_m, east_min_m, step_m)

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        """Altitude by bilinear interpolation, in the shape of the broadcast inputs.

        NaN off the grid and where one of the four neighbours that count is unknown.
        """
        # fmax and fmin send NaN, too, to the border of NaN.
        row = np.fmax(np.fmin((self._north_zero_m - np.asarray(north_m)) * self._per_m, self._row_limit), 0.0)
        col = np.fmax(np.fmin((np.asarray(east_m) - self._east_zero_m) * self._per_m, self._col_limit), 0.0)
        top, left = row.astype(np.intp), col.astype(np.intp)
        down, right = row - top, col - left
        upper_index = top * self._cols + left
        lower_index = upper_index + self._cols
        flat = self._flat
        upper, lower = flat[upper_index], flat[lower_index]
        upper = upper + right * (flat[upper_index + 1] - upper)
        lower = lower + right * (flat[lower_index + 1] - lower)
        alt_amsl_m: Float = upper + down * (lower - upper)
        return alt_amsl_m


def height_scaling(raster: Raster) -> tuple[float, float]:
    """Factor and offset that turn the raster's numbers into metres.

    Raises
    ------
    UnsupportedRasterError
        The raster is a picture, or its unit is not known.
    """
    if raster.palette is not None or raster.band_count != 1:
        raise UnsupportedRasterError(
            raster.path,
            f"is a picture ({raster.band_count} bands{', paletted' if raster.palette is not None else ''}), "
            "not an elevation model",
            "give a single-band raster of heights",
        )
    unit = raster.unit
    if unit not in _METRES_PER_UNIT:
        raise UnsupportedRasterError(
            raster.path, f"has heights in an unknown unit {unit!r}", "convert it to metres and set the band's unit to m"
        )
    factor = _METRES_PER_UNIT[unit]
    if not unit:
        factor = _vertical_unit_m(raster)
    return raster.scale * factor, raster.offset * factor


def height_planes(bands: Bands, scale: float, offset: float) -> NDArray[np.float32]:
    """Heights in metres (1, h, w) from a raster's own numbers; NaN for what no ground can be."""
    with np.errstate(over="ignore", invalid="ignore"):
        heights = (bands[:1].astype(np.float64) * scale + offset).astype(np.float32)
        return np.where((heights > _LOWEST_M) & (heights < _HIGHEST_M), heights, np.float32(np.nan))


def _vertical_unit_m(raster: Raster) -> float:
    vertical = [axis for axis in raster.crs.axis_info if axis.direction.lower() in ("up", "down")]
    return float(vertical[0].unit_conversion_factor) if vertical else 1.0


def _within_reach(area: NeBounds) -> NeBounds:
    """The part of a large rectangle near the origin; all of it where the origin is not near."""
    south_west = (max(area.north_min_m, -_REACH_M), max(area.east_min_m, -_REACH_M))
    north_east = (min(area.north_max_m, _REACH_M), min(area.east_max_m, _REACH_M))
    overlaps = south_west[0] < north_east[0] and south_west[1] < north_east[1]
    return NeBounds(*south_west, *north_east) if overlaps else area
