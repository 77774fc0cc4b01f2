from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.control import GroundControlPoint

from geodata.errors import (
    EmptyRasterError,
    HugeRasterError,
    NoCrsError,
    NotGeoreferencedError,
    UnsupportedRasterError,
)
from geodata.raster import open_raster
from tests.geodata import rasters

GREY = np.zeros((1, 16, 16), np.uint8)
PLACED = Affine(1.0, 0.0, 500000.0, 0.0, -1.0, 5300000.0)


def test_raster_without_crs_says_how_to_assign_one(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "a.tif", GREY, crs=None, transform=PLACED)
    with pytest.raises(NoCrsError, match=r"a\.tif: names no coordinate reference system.*gdal_edit"):
        open_raster(path)


def test_crs_that_is_not_on_the_earth_is_refused(tmp_path: Path) -> None:
    site = 'ENGCRS["site",EDATUM["stake"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],LENGTHUNIT["metre",1]]'
    path = rasters.write(tmp_path / "a.tif", GREY, crs=site, transform=PLACED)
    with pytest.raises((NoCrsError, NotGeoreferencedError), match=r"a\.tif"):
        open_raster(path)


def test_plain_picture_is_not_georeferenced(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "a.tif", GREY, crs=None, transform=Affine.identity())
    with pytest.raises(NotGeoreferencedError, match="without geotransform"):
        open_raster(path)


def test_control_points_alone_ask_for_rectification(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    points = [GroundControlPoint(r, c, 11.0 + c / 1e4, 48.0 - r / 1e4) for r, c in ((0, 0), (0, 15), (15, 0), (15, 15))]
    with rasterio.open(
        path, "w", driver="GTiff", width=16, height=16, count=1, dtype="uint8", gcps=points, crs="EPSG:4326"
    ) as dataset:
        dataset.write(GREY)
    with pytest.raises(NotGeoreferencedError, match="gdalwarp"):
        open_raster(path)


def test_coordinates_off_the_earth_are_refused(tmp_path: Path) -> None:
    """Metres written under a CRS in degrees, the usual mistake."""
    path = rasters.write(tmp_path / "a.tif", GREY, crs="EPSG:4326", transform=PLACED)
    with pytest.raises(NotGeoreferencedError, match="check that the CRS"):
        open_raster(path)


def test_empty_file_is_named_empty(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    path.touch()
    with pytest.raises(EmptyRasterError, match="0 bytes"):
        open_raster(path)


def test_huge_header_is_refused_without_memory(tmp_path: Path) -> None:
    """A sparse file of a few kilobytes that claims 160 thousand million pixels."""
    path = tmp_path / "a.tif"
    rasterio.open(
        path, "w", driver="GTiff", width=400_000, height=400_000, count=1, dtype="uint8", crs="EPSG:32632",
        transform=PLACED, tiled=True, blockxsize=16384, blockysize=16384, SPARSE_OK=True, BIGTIFF="YES",
    ).close()  # fmt: skip
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    with pytest.raises(HugeRasterError, match="400000 x 400000"):
        open_raster(path)

    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 100_000


def test_single_block_larger_than_memory_allows_is_refused(tmp_path: Path) -> None:
    """A tile of a gigabyte would be decoded for every pixel that is read."""
    path = tmp_path / "a.tif"
    rasterio.open(
        path, "w", driver="GTiff", width=60_000, height=40_000, count=1, dtype="uint8", crs="EPSG:32632",
        transform=PLACED, tiled=True, blockxsize=32_768, blockysize=32_768, SPARSE_OK=True, compress="deflate",
    ).close()  # fmt: skip
    with pytest.raises(HugeRasterError, match="TILED=YES"):
        open_raster(path)


def test_complex_numbers_are_refused(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "a.tif", GREY.astype(np.complex64))
    with pytest.raises(UnsupportedRasterError, match="complex"):
        open_raster(path)
