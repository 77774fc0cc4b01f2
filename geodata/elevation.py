"""Height of the ground in the local frame: a grid from a raster, or flat."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from geodata.errors import EmptyRasterError, UnsupportedRasterError
from geodata.imagery import NODE_STEP_M, NeBounds
from geodata.raster import Bands, Raster, open_raster
from geodata.resample import resample

if TYPE_CHECKING:
    from estimator.geometry.local import LocalFrame

MAX_GRID_PIXELS = 16_000_000

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

    ``alt_amsl_grid_m`` (rows, cols) float32, NaN where unknown; the centre of (row r, column c) lies at north =
    ``north_max_m`` - r ``gsd_m``, east = ``east_min_m`` + c ``gsd_m``. The vertical datum is the raster's own.
    """

    def __init__(
        self, alt_amsl_grid_m: NDArray[np.float32], north_max_m: float, east_min_m: float, gsd_m: float
    ) -> None:
        rows, cols = alt_amsl_grid_m.shape
        # A border of NaN stands for everything outside, so that a lookup needs no masks.
        padded = np.full((rows + 2, cols + 2), np.nan, dtype=np.float32)
        padded[1:-1, 1:-1] = alt_amsl_grid_m
        padded.setflags(write=False)
        self._flat = padded.ravel()
        self._cols = cols + 2
        self._row_limit, self._col_limit = rows + 0.999999, cols + 0.999999
        self.alt_amsl_grid_m: NDArray[np.float32] = padded[1:-1, 1:-1]
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
            Metres per grid cell; the file's own when not given, made coarser until the grid has 16 million cells.
        bounds
            What to cover; the whole raster when not given.

        Raises
        ------
        RasterError
            One of its subclasses, saying what is wrong with the file.
        """
        with open_raster(path) as raster:
            scale, offset = height_scaling(raster)
            area = bounds or _bounds_ne(raster, frame)
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
        row = (self._north_zero_m - np.asarray(north_m, dtype=np.float64)) * self._per_m
        col = (np.asarray(east_m, dtype=np.float64) - self._east_zero_m) * self._per_m
        # fmax and fmin send NaN, too, to the border of NaN.
        row = np.fmax(np.fmin(row, self._row_limit), 0.0)
        col = np.fmax(np.fmin(col, self._col_limit), 0.0)
        top, left = row.astype(np.int64), col.astype(np.int64)
        down, right = row - top, col - left
        index = top * self._cols + left
        take = self._flat.take
        upper_left, lower_left = take(index), take(index + self._cols)
        upper = upper_left + right * (take(index + 1) - upper_left)
        lower = lower_left + right * (take(index + self._cols + 1) - lower_left)
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


def _bounds_ne(raster: Raster, frame: LocalFrame) -> NeBounds:
    ne_m = frame.ne_from_geodetic(*raster.footprint())
    ne_m = ne_m[np.all(np.isfinite(ne_m), axis=-1)]
    north_min, east_min = (float(value) for value in ne_m.min(axis=0))
    north_max, east_max = (float(value) for value in ne_m.max(axis=0))
    return NeBounds(north_min, east_min, north_max, east_max)
