"""What makes an opened raster file unusable. ``dataset`` is a rasterio dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from geodata.errors import (
    EmptyRasterError,
    HugeRasterError,
    NoCrsError,
    NotGeoreferencedError,
    UnsupportedRasterError,
)

MAX_PIXELS = 20_000_000_000
MAX_BLOCK_BYTES = 512 * 2**20


def check_size(path: Path, dataset: Any) -> None:
    """Refuse what has no pixels, too many, or is stored in blocks that exhaust memory."""
    if dataset.count == 0 or dataset.width == 0 or dataset.height == 0:
        raise EmptyRasterError(path, "holds no pixels", "export it again")
    if any("complex" in kind for kind in dataset.dtypes):
        raise UnsupportedRasterError(path, "holds complex numbers", "export amplitude or reflectance instead")
    if dataset.width * dataset.height > MAX_PIXELS:
        raise HugeRasterError(
            path,
            f"claims {dataset.width} x {dataset.height} pixels, more than {MAX_PIXELS:.0e}",
            "cut out the area of operation, for example with gdal_translate -projwin",
        )
    rows, cols = dataset.block_shapes[0]
    samples = dataset.count if dataset.profile.get("interleave") == "pixel" else 1
    block_bytes = rows * cols * samples * np.dtype(dataset.dtypes[0]).itemsize
    if block_bytes > MAX_BLOCK_BYTES:
        raise HugeRasterError(
            path,
            f"is stored in blocks of {cols} x {rows} pixels ({block_bytes / 2**20:.0f} MB each)",
            "rewrite it tiled: gdal_translate -co TILED=YES IN OUT",
        )


def check_georeference(path: Path, dataset: Any) -> None:
    """Refuse what has no geotransform or no coordinate reference system."""
    if dataset.transform.is_identity or dataset.transform.is_degenerate:
        gcps, _ = dataset.gcps
        if gcps or dataset.rpcs:
            raise NotGeoreferencedError(
                path, "is tied to the ground only by control points or RPCs", "rectify it first: gdalwarp IN OUT"
            )
        raise NotGeoreferencedError(
            path, "is a picture without geotransform", "export it as a GeoTIFF with its position, or add a world file"
        )
    if dataset.crs is None or not dataset.crs.to_wkt():
        raise NoCrsError(
            path, "names no coordinate reference system", "assign the right one: gdal_edit.py -a_srs EPSG:CODE FILE"
        )


def earth_crs(path: Path, dataset: Any) -> pyproj.CRS:
    """The coordinate reference system, which must lead to latitude and longitude."""
    try:
        crs = pyproj.CRS.from_wkt(dataset.crs.to_wkt())
        pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise NoCrsError(
            path,
            "its coordinate reference system is not tied to the Earth or is unknown",
            "assign the right one: gdal_edit.py -a_srs EPSG:CODE FILE",
        ) from error
    return crs
