"""Georeferenced rasters: opening, checking, reading and writing. The only module that imports rasterio.

Pixel coordinates are (column, row) with (0, 0) at the centre of the top-left pixel. Latitudes and longitudes are
WGS-84 radians.
"""

from __future__ import annotations

import math
import os
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyproj
import rasterio
from affine import Affine
from numpy.typing import NDArray
from rasterio._err import CPLE_BaseError
from rasterio.enums import ColorInterp, MaskFlags, Resampling
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window

from estimator.types import Float
from geodata.errors import (
    CorruptRasterError,
    EmptyRasterError,
    HugeRasterError,
    NotGeoreferencedError,
    RasterError,
    RasterMissingError,
)
from geodata.raster_checks import check_georeference, check_size, earth_crs

Bands = NDArray[Any]
Mask = NDArray[np.bool_]

# File formats that hold their own pixels. VRT and the web formats are left out on purpose: a file handed in by
# somebody else must not make the station open other files or addresses.
DRIVERS = ("GTiff", "JP2OpenJPEG", "HFA", "DTED", "SRTMHGT", "AAIGrid", "PNG", "JPEG")

# GDAL's block cache defaults to 5 % of the machine's memory and is kept for good; 64 MB serve tiles just as well.
_GDAL_OPTIONS: dict[str, Any] = {"GDAL_CACHEMAX": 64, "GDAL_TIFF_INTERNAL_MASK": True, "GDAL_NUM_THREADS": "2"}

_GEOD = pyproj.Geod(ellps="WGS84")


@dataclass(frozen=True, slots=True)
class LatLonBounds:
    """A rectangle in degrees; ``east_deg`` passes 180 where the rectangle crosses the antimeridian."""

    south_deg: float
    west_deg: float
    north_deg: float
    east_deg: float

    @property
    def middle_rad(self) -> tuple[float, float]:
        """Latitude and longitude of its middle, in radians."""
        lat_deg, lon_deg = 0.5 * (self.south_deg + self.north_deg), 0.5 * (self.west_deg + self.east_deg)
        return math.radians(lat_deg), math.radians(lon_deg)


@dataclass(frozen=True, slots=True)
class Level:
    """One resolution of a raster: the base, or an overview that is ``factor_*`` times coarser."""

    overview: int | None
    width_px: int
    height_px: int
    factor_x: float
    factor_y: float


class Raster:
    """An open georeferenced raster; made by :func:`open_raster`. Reads may come from any thread, one at a time."""

    def __init__(self, path: Path, dataset: rasterio.io.DatasetReader, crs: pyproj.CRS) -> None:
        self.path = path
        self.crs = crs
        self.width_px = int(dataset.width)
        self.height_px = int(dataset.height)
        self.dtype = np.dtype(dataset.dtypes[0])
        self.nodata: float | None = None if dataset.nodata is None else float(dataset.nodata)
        self.unit: str = (dataset.units[0] or "").strip().lower()
        self.scale, self.offset = float(dataset.scales[0]), float(dataset.offsets[0])
        self.palette = _palette(dataset)
        self._datasets: dict[int | None, rasterio.io.DatasetReader] = {None: dataset}
        self._lock = threading.Lock()
        self._world_from_edge: Affine = dataset.transform
        self._edge_from_world: Affine = ~dataset.transform
        self._world_from_wgs84 = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
        self._wgs84_from_world = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        a, b, c = dataset.transform[:3]
        self._centre_x = float(a * dataset.width / 2 + b * dataset.height / 2 + c)
        interpretation = list(dataset.colorinterp)
        self._alpha_band = _labelled_alpha_band(interpretation)
        self._has_mask_band = any(
            MaskFlags.per_dataset in flags and MaskFlags.alpha not in flags for flags in dataset.mask_flag_enums
        )
        self.levels = self._levels()
        self.colour_bands = _colour_bands(interpretation, self._alpha_band)
        if self.dtype == np.uint8 and dataset.count in (2, 4) and self._alpha_band in (None, dataset.count):
            self._alpha_band = self._transparency_band(int(dataset.count))
            self.colour_bands = _colour_bands(interpretation, self._alpha_band)
        self.gsd_x_m, self.gsd_y_m = self._pixel_size_m()

    @property
    def band_count(self) -> int:
        """Number of bands that carry picture or height, without alpha."""
        return len(self.colour_bands)

    @property
    def has_alpha(self) -> bool:
        """Whether one band is transparency."""
        return self._alpha_band is not None

    @property
    def gsd_m(self) -> float:
        """Ground sample distance at the centre, metres: geometric mean of the two axes."""
        return math.sqrt(self.gsd_x_m * self.gsd_y_m)

    @property
    def crs_name(self) -> str:
        """Short name of the coordinate reference system, ``EPSG:32617`` where it has a code."""
        authority = self.crs.to_authority()
        return ":".join(authority) if authority else str(self.crs.name)

    @property
    def transform(self) -> tuple[float, float, float, float, float, float]:
        """(a, b, c, d, e, f) of x = a col + b row + c, y = d col + e row + f at pixel corners."""
        a, b, c, d, e, f = self._world_from_edge[:6]
        return a, b, c, d, e, f

    @property
    def bounds(self) -> LatLonBounds:
        """The WGS-84 rectangle around the footprint."""
        lat_rad, lon_rad = self.footprint()
        finite = np.isfinite(lat_rad) & np.isfinite(lon_rad)
        lat_rad, lon_rad = lat_rad[finite], np.unwrap(lon_rad[finite])
        degrees = np.degrees([lat_rad.min(), lon_rad.min(), lat_rad.max(), lon_rad.max()])
        return LatLonBounds(*(float(value) for value in degrees))

    def footprint(self, points_per_side: int = 17) -> tuple[Float, Float]:
        """Latitudes and longitudes (4 n,) along the outer edge, clockwise from the top-left corner."""
        t = np.linspace(0.0, 1.0, points_per_side)
        zero, one = np.zeros_like(t), np.ones_like(t)
        col = np.concatenate([t, one, t[::-1], zero]) * self.width_px - 0.5
        row = np.concatenate([zero, t, one, t[::-1]]) * self.height_px - 0.5
        return self.geodetic_from_pixel(col, row)

    def geodetic_from_pixel(self, col: Float, row: Float) -> tuple[Float, Float]:
        """Latitude and longitude of pixel positions; NaN where the projection has none."""
        affine = self._world_from_edge
        col_edge, row_edge = np.asarray(col) + 0.5, np.asarray(row) + 0.5
        x = affine.a * col_edge + affine.b * row_edge + affine.c
        y = affine.d * col_edge + affine.e * row_edge + affine.f
        lon_deg, lat_deg = self._wgs84_from_world.transform(x, y)
        return np.radians(_finite(lat_deg)), np.radians(_finite(lon_deg))

    def pixel_from_geodetic(self, lat_rad: Float, lon_rad: Float) -> tuple[Float, Float]:
        """Pixel position (column, row) of geodetic positions, also off the raster; NaN where there is none."""
        x, y = self._world_from_wgs84.transform(np.degrees(lon_rad), np.degrees(lat_rad))
        x, y = _finite(x), _finite(y)
        if self.crs.is_geographic:
            # A grid may count longitudes 0 to 360, or cross the antimeridian.
            x = self._centre_x + np.mod(x - self._centre_x + 180.0, 360.0) - 180.0
        affine = self._edge_from_world
        return affine.a * x + affine.b * y + affine.c - 0.5, affine.d * x + affine.e * y + affine.f - 0.5

    def read(self, level: Level, col: int, row: int, width: int, height: int) -> tuple[Bands, Mask]:
        """Pixels of a window of one level, in the file's own type.

        Returns
        -------
        bands, valid
            (bands, height, width) and (height, width); ``valid`` follows alpha, mask band, nodata and finiteness.

        Raises
        ------
        CorruptRasterError
            The file ends early or a block cannot be decoded.
        """
        window = Window(col, row, width, height)
        with self._lock, _gdal(self.path):
            dataset = self._dataset(level.overview)
            bands: Bands = dataset.read(list(self.colour_bands), window=window)
            valid = self._valid(dataset, bands, window)
        return bands, valid

    def sample(self, size_px: int = 1024) -> tuple[Bands, Mask]:
        """A representative sample (bands, h, w) of the whole raster, for statistics; not to be measured in."""
        if self.width_px * self.height_px <= 25_000_000:
            step = max(1, math.ceil(max(self.width_px, self.height_px) / size_px))
            step = min(step, self.width_px, self.height_px)
            lines = [
                self.read(self.levels[0], 0, row, self.width_px, 1) for row in range(step // 2, self.height_px, step)
            ]
            bands = np.concatenate([line for line, _ in lines], axis=1)[..., step // 2 :: step]
            return bands, np.concatenate([known for _, known in lines], axis=0)[..., step // 2 :: step]
        # A large raster is sampled in 8 x 8 small windows so that few blocks are decoded.
        side = min(128, self.width_px, self.height_px)
        rows = np.linspace(0, self.height_px - side, 8).astype(int)
        cols = np.linspace(0, self.width_px - side, 8).astype(int)
        parts = [self.read(self.levels[0], int(c), int(r), side, side) for r in rows for c in cols]
        return np.concatenate([b for b, _ in parts], axis=1), np.concatenate([v for _, v in parts], axis=0)

    def close(self) -> None:
        """Release the file; reading afterwards is an error."""
        with self._lock:
            for dataset in self._datasets.values():
                dataset.close()

    def __enter__(self) -> Raster:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _dataset(self, overview: int | None) -> rasterio.io.DatasetReader:
        if overview not in self._datasets:
            self._datasets[overview] = rasterio.io.DatasetReader(
                str(self.path), driver=list(DRIVERS), overview_level=overview
            )
        return self._datasets[overview]

    def _levels(self) -> tuple[Level, ...]:
        levels = [Level(None, self.width_px, self.height_px, 1.0, 1.0)]
        with _gdal(self.path):
            for overview, factor in enumerate(self._datasets[None].overviews(1)):
                width = math.ceil(self.width_px / factor)
                height = math.ceil(self.height_px / factor)
                levels.append(Level(overview, width, height, self.width_px / width, self.height_px / height))
        return tuple(levels)

    def _valid(self, dataset: rasterio.io.DatasetReader, bands: Bands, window: Window) -> Mask:
        valid: Mask = np.ones(bands.shape[1:], dtype=np.bool_)
        if self._alpha_band is not None:
            alpha = dataset.read(self._alpha_band, window=window)
            valid &= alpha > (127 if alpha.dtype == np.uint8 else 0)
        if self._has_mask_band:
            valid &= dataset.read_masks(1, window=window) > 0
        if self.palette is not None:
            valid &= self.palette[np.minimum(bands[0], len(self.palette) - 1), 3] > 127
        if self.nodata is not None and not math.isnan(self.nodata):
            with np.errstate(over="ignore", invalid="ignore"):
                nodata = np.float32(self.nodata) if self.dtype == np.float32 else self.nodata
                valid &= np.any(bands != nodata, axis=0)
        if np.issubdtype(self.dtype, np.floating):
            valid &= np.all(np.isfinite(bands), axis=0)
        return valid

    def _transparency_band(self, last_band: int) -> int | None:
        """Whether the last of two or four 8-bit bands is transparency, from its values.

        Labels are no help: many writers leave alpha without one, and GDAL labels a fourth band alpha that is infrared.
        Transparency is 0 or 255 but for a soft edge.
        """
        labelled = self._alpha_band is not None
        self._alpha_band, self.colour_bands = None, (last_band,)
        bands, _ = self.sample(512)
        binary = float(np.mean((bands[0] == 0) | (bands[0] == 255)))
        return last_band if binary == 1.0 or (labelled and binary > 0.5) else None

    def _pixel_size_m(self) -> tuple[float, float]:
        col, row = (self.width_px - 1) / 2, (self.height_px - 1) / 2
        lat_rad, lon_rad = self.geodetic_from_pixel(
            np.array([col - 0.5, col + 0.5, col, col]), np.array([row, row, row - 0.5, row + 0.5])
        )
        lat_deg, lon_deg = np.degrees(lat_rad), np.degrees(lon_rad)
        if not np.all(np.isfinite(lat_deg) & np.isfinite(lon_deg) & (np.abs(lat_deg) <= 90)):
            raise NotGeoreferencedError(
                self.path,
                f"its coordinates do not lie on the Earth in {self.crs_name}",
                "check that the CRS is the one the coordinates were written in",
            )
        _, _, size_m = _GEOD.inv(lon_deg[::2], lat_deg[::2], lon_deg[1::2], lat_deg[1::2])
        if not (np.all(np.isfinite(size_m)) and np.all(size_m > 0)):
            raise NotGeoreferencedError(self.path, "its pixels have no size on the ground", "check its geotransform")
        return float(size_m[0]), float(size_m[1])


def open_raster(path: str | os.PathLike[str]) -> Raster:
    """Open a georeferenced raster and check that it can be used.

    Raises
    ------
    RasterError
        One of its subclasses, saying what is wrong with the file and what to do.
    """
    file = Path(path).expanduser().resolve()
    if not file.is_file():
        what = "is a folder, not a raster file" if file.is_dir() else "no such file"
        raise RasterMissingError(file, what, "give the path of a GeoTIFF")
    if file.stat().st_size == 0:
        raise EmptyRasterError(file, "the file is empty (0 bytes)", "copy or export it again")
    with _gdal(file), _georeference_warnings_off():
        dataset = rasterio.io.DatasetReader(str(file), driver=list(DRIVERS))
        try:
            check_size(file, dataset)
            check_georeference(file, dataset)
            return Raster(file, dataset, earth_crs(file, dataset))
        except BaseException:
            dataset.close()
            raise


def write_geotiff(
    path: str | os.PathLike[str],
    array: Bands,
    transform: Sequence[float],
    crs: str,
    *,
    nodata: float | None = None,
    valid: Mask | None = None,
    overviews: bool = False,
) -> None:
    """Write a tiled, losslessly compressed GeoTIFF; the file appears whole or not at all.

    Parameters
    ----------
    array
        (rows, cols) or (rows, cols, bands), colours in the order red, green, blue.
    transform
        (a, b, c, d, e, f): x = a col + b row + c, y = d col + e row + f at pixel corners; c, f is the outer corner of
        the top-left pixel. An ``affine.Affine`` will do.
    crs
        Anything PROJ understands, such as ``EPSG:32633``.
    valid
        (rows, cols), stored as a mask band when given.
    """
    file = Path(path)
    if array.ndim not in (2, 3) or array.size == 0:
        message = f"array must be (rows, cols) or (rows, cols, bands), not {array.shape}"
        raise ValueError(message)
    bands = array[np.newaxis] if array.ndim == 2 else np.moveaxis(array, -1, 0)
    with TiledWriter(
        file,
        width=bands.shape[2],
        height=bands.shape[1],
        bands=bands.shape[0],
        dtype=bands.dtype,
        transform=tuple(transform)[:6],
        crs_wkt=pyproj.CRS.from_user_input(crs).to_wkt(),
        nodata=nodata,
        with_mask=valid is not None,
        overviews=overviews,
    ) as writer:
        writer.write(bands, valid, 0, 0)


class TiledWriter:
    """Writes a tiled GeoTIFF window by window under a temporary name; leaving the context gives it its real one."""

    def __init__(
        self,
        path: Path,
        *,
        width: int,
        height: int,
        bands: int,
        dtype: np.dtype[Any],
        transform: Sequence[float],
        crs_wkt: str,
        nodata: float | None = None,
        with_mask: bool = False,
        overviews: bool = False,
    ) -> None:
        self._path = path
        self._partial = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}.partial")
        self._overviews = overviews
        self._with_mask = with_mask
        self._size = (width, height)
        self._profile: dict[str, Any] = {
            "driver": "GTiff",
            "width": width,
            "height": height,
            "count": bands,
            "dtype": dtype,
            "transform": Affine(*transform),
            "crs": rasterio.crs.CRS.from_wkt(crs_wkt),
            "tiled": True,
            "blockxsize": 256,
            "blockysize": 256,
            "compress": "deflate",
            "zlevel": 4,
            "predictor": 3 if np.issubdtype(dtype, np.floating) else 2,
            "BIGTIFF": "IF_SAFER",
            "interleave": "pixel" if bands in (3, 4) else "band",
        }
        if bands in (3, 4) and dtype == np.uint8:
            self._profile["photometric"] = "RGB"
        if nodata is not None:
            self._profile["nodata"] = nodata

    def __enter__(self) -> TiledWriter:
        with _gdal_writing(self._path):
            self._dataset = rasterio.open(self._partial, "w", **self._profile)
        return self

    def write(self, bands: Bands, valid: Mask | None, col: int, row: int) -> None:
        """Write (bands, rows, cols) with its mask (rows, cols) at a pixel offset."""
        window = Window(col, row, bands.shape[2], bands.shape[1])
        with _gdal_writing(self._path):
            self._dataset.write(bands, window=window)
            if self._with_mask and valid is not None:
                self._dataset.write_mask(valid.astype(np.uint8) * 255, window=window)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            with _gdal_writing(self._path):
                self._dataset.close()
                if kind is None and self._overviews:
                    self._build_overviews()
            if kind is None:
                self._partial.replace(self._path)
        finally:
            self._partial.unlink(missing_ok=True)

    def _build_overviews(self) -> None:
        factors = [2**k for k in range(1, 16) if max(self._size) / 2 ** (k - 1) > 256]
        if factors:
            with rasterio.Env(COMPRESS_OVERVIEW="DEFLATE"), rasterio.open(self._partial, "r+") as dataset:
                dataset.build_overviews(factors, Resampling.average)


@contextmanager
def _gdal(path: Path) -> Iterator[None]:
    """GDAL's settings for what is done inside, and its errors as ours."""
    try:
        with rasterio.Env(**_GDAL_OPTIONS):
            yield
    except (RasterioError, CPLE_BaseError, ValueError) as error:
        # Damaged tags surface as undecodable text and impossible values, too.
        cause = str(error.__cause__ or error).replace(str(path), path.name)
        raise CorruptRasterError(
            path, f"cannot be read as a raster ({cause})", "it may be truncated or damaged; copy or export it again"
        ) from error
    except MemoryError as error:
        raise HugeRasterError(path, "does not fit in memory", "cut it into smaller pieces or tile it") from error


@contextmanager
def _gdal_writing(path: Path) -> Iterator[None]:
    try:
        with rasterio.Env(**_GDAL_OPTIONS):
            yield
    except (RasterioError, CPLE_BaseError) as error:
        cause = str(error.__cause__ or error)
        raise RasterError(path, f"cannot be written ({cause})", "check free space and the folder's rights") from error


@contextmanager
def _georeference_warnings_off() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield


def _finite(values: Any) -> Float:
    array = np.asarray(values, dtype=np.float64)
    return np.where(np.isfinite(array), array, np.nan)


def _palette(dataset: rasterio.io.DatasetReader) -> NDArray[np.uint8] | None:
    if dataset.colorinterp[0] != ColorInterp.palette:
        return None
    try:
        entries = dataset.colormap(1)
    except ValueError:
        return None
    palette = np.zeros((max(entries) + 1, 4), dtype=np.uint8)
    for index, rgba in entries.items():
        palette[index] = rgba
    return palette


def _labelled_alpha_band(interpretation: list[ColorInterp]) -> int | None:
    return interpretation.index(ColorInterp.alpha) + 1 if ColorInterp.alpha in interpretation else None


def _colour_bands(interpretation: list[ColorInterp], alpha_band: int | None) -> tuple[int, ...]:
    """Band numbers with red, green, blue first where they are labelled."""
    named = [
        interpretation.index(colour) + 1
        for colour in (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
        if colour in interpretation
    ]
    rest = [band for band in range(1, len(interpretation) + 1) if band not in named and band != alpha_band]
    return tuple(named + rest)
