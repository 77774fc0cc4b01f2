"""How well each place of a map can be matched, as layers: numbers to compute with, colours to look at."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pyproj
from numpy.typing import NDArray

from estimator.geometry.local import LocalFrame
from estimator.registration.matchability import AMBIGUOUS, GOOD, WEAK, Matchability, MatchabilityConfig, matchability
from estimator.types import Image
from geodata.errors import MapLibraryError, RasterError
from geodata.flight_write import write_atomically
from geodata.imagery import ReferenceImagery
from geodata.maps import MapLibrary
from geodata.raster import write_geotiff

MAX_PLACES = 40_000
NUMBERS_FILE, COLOURS_FILE, SUMMARY_FILE = "matchability.tif", "matchability_colour.tif", "matchability.json"

BEST_M, WORST_M = 0.5, 10.0
"""Sigmas that are drawn in the first and in the last colour."""
_GREEN, _YELLOW, _RED = (26, 152, 80), (254, 224, 100), (215, 48, 39)
_AMBIGUOUS_COLOUR, _WEAK_COLOUR = (150, 60, 160), (110, 120, 140)


@dataclass(frozen=True, slots=True)
class MatchabilitySummary:
    """A map in a few numbers; shares are of the places that the map covers."""

    footprint_m: float
    radius_m: float
    step_m: float
    places: int
    median_sigma_m: float
    share_good: float
    share_ambiguous: float
    share_weak: float


@dataclass(frozen=True, slots=True, eq=False)
class MatchabilityLayer:
    """The prediction with its place on the Earth: ``transform`` and ``crs`` as ``write_geotiff`` wants them."""

    result: Matchability
    transform: tuple[float, float, float, float, float, float]
    crs: str
    summary: MatchabilitySummary


def matchability_of(
    path: str | os.PathLike[str], footprint_m: float = 100.0, radius_m: float = 40.0,
    progress: Callable[[float], None] | None = None,
) -> MatchabilityLayer:  # fmt: skip
    """Predict for all of a map file.

    ``footprint_m`` is the side of what a picture shows (about the height above ground for a common camera), and
    ``radius_m`` how far off the position may be.

    Raises
    ------
    RasterError
        The file cannot be used, or is too small or too coarse for such a footprint.
    """
    imagery = ReferenceImagery.open(path)
    try:
        frame = LocalFrame(*imagery.raster.bounds.middle_rad, 0.0)
        config = MatchabilityConfig(footprint_m=footprint_m, radius_m=radius_m)
        gsd_m = max(imagery.gsd_m, footprint_m / config.template_px)
        bounds = imagery.bounds_ne(frame)
        area_m2 = (bounds.north_max_m - bounds.north_min_m) * (bounds.east_max_m - bounds.east_min_m)
        finest = math.sqrt(area_m2 / MAX_PLACES) / footprint_m
        config = replace(config, step_share=min(1.0, max(config.step_share, finest)))
        grid = imagery.grid(frame, gsd_m)
        try:
            result = matchability(grid.image, grid.valid, grid.gsd_m, config, progress)
        except ValueError as error:
            raise RasterError(imagery.raster.path, str(error), "choose another --footprint") from None
    finally:
        imagery.close()
    step_m = result.step_px * grid.gsd_m
    west = grid.east_min_m + (result.first_px - 0.5 * result.step_px) * grid.gsd_m
    north = grid.north_max_m - (result.first_px - 0.5 * result.step_px) * grid.gsd_m
    # the local tangent plane, to a centimetre within 10 km
    lat_deg, lon_deg = math.degrees(frame.lat_rad), math.degrees(frame.lon_rad)
    crs = pyproj.CRS.from_proj4(f"+proj=aeqd +lat_0={lat_deg:.9f} +lon_0={lon_deg:.9f} +datum=WGS84 +units=m").to_wkt()
    return MatchabilityLayer(
        result, (step_m, 0.0, west, 0.0, -step_m, north), crs, _summary(result, footprint_m, radius_m, step_m)
    )


def _summary(result: Matchability, footprint_m: float, radius_m: float, step_m: float) -> MatchabilitySummary:
    known = result.kind != 255
    count = max(int(known.sum()), 1)
    good, ambiguous, weak = (float((result.kind == kind).sum()) / count for kind in (GOOD, AMBIGUOUS, WEAK))
    median = float(np.median(result.sigma_m[known])) if known.any() else math.nan
    return MatchabilitySummary(footprint_m, radius_m, step_m, int(known.sum()), median, good, ambiguous, weak)


def write_numbers(path: Path, layer: MatchabilityLayer) -> None:
    """A GeoTIFF of four bands: sigma in metres, probability elsewhere, height of the peak, and the kind of place."""
    result = layer.result
    kind = np.where(result.kind == 255, np.nan, result.kind.astype(np.float32))
    bands = np.stack((result.sigma_m, result.elsewhere, result.peak, kind), axis=-1).astype(np.float32)
    write_geotiff(path, bands, layer.transform, layer.crs, nodata=float("nan"))


def colours(result: Matchability) -> tuple[Image, NDArray[np.bool_]]:
    """Red, green, blue (rows, cols, 3) and where there is anything.

    Green to red by the logarithm of sigma; violet where patterns repeat, grey where there is too little texture.
    """
    known = result.kind != 255
    sigma = np.where(known, result.sigma_m, WORST_M)
    part = np.clip(np.log(np.maximum(sigma, 1e-3) / BEST_M) / math.log(WORST_M / BEST_M), 0.0, 1.0)
    stops = np.array([_GREEN, _YELLOW, _RED], dtype=np.float64)
    rgb = np.stack([np.interp(part, [0.0, 0.5, 1.0], stops[:, band]) for band in range(3)], axis=-1)
    rgb[result.kind == AMBIGUOUS] = _AMBIGUOUS_COLOUR
    rgb[result.kind == WEAK] = _WEAK_COLOUR
    return np.asarray(np.rint(rgb), dtype=np.uint8), np.asarray(known)


def add_to_library(library: MapLibrary, map_id: str, layer: MatchabilityLayer) -> MatchabilitySummary:
    """Keep a layer beside its map, where the console finds it; raises MapLibraryError where that cannot be written."""
    folder = library.raster_path(map_id).parent
    try:
        write_numbers(folder / NUMBERS_FILE, layer)
        rgb, known = colours(layer.result)
        write_geotiff(folder / COLOURS_FILE, rgb, layer.transform, layer.crs, valid=known)
        # last: a layer counts when its summary is there
        write_atomically(folder / SUMMARY_FILE, json.dumps(asdict(layer.summary), indent=1).encode())
    except OSError as error:
        message = f"{folder}: the layer cannot be written: {error.strerror or error}"
        raise MapLibraryError(message) from error
    return layer.summary


def of_library(library: MapLibrary, map_id: str) -> tuple[Path, MatchabilitySummary] | None:
    """A map's layer in colours and its summary; None where it was not computed, or is damaged."""
    folder = library.raster_path(map_id).parent
    try:
        summary = MatchabilitySummary(**json.loads((folder / SUMMARY_FILE).read_text()))
    except (OSError, ValueError, TypeError):
        return None
    path = folder / COLOURS_FILE
    return (path, summary) if path.is_file() else None
