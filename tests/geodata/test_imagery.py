from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
from numpy.testing import assert_allclose, assert_array_equal

from estimator.geometry.local import LocalFrame
from geodata.errors import EmptyRasterError, HugeRasterError
from geodata.imagery import ImageryGrid, NeBounds, ReferenceImagery
from tests.geodata import rasters
from tests.shared_data import shared_data


@pytest.mark.parametrize("name", ["flights/copter_120m/reference.tif", "photos/seneca/map_passA_30cm.tif"])
def test_real_map_agrees_with_pyproj_point_by_point(name: str) -> None:
    """Grey values of the grid are those of the file where pyproj says the place is (JPEG colour within 2 levels)."""
    path = shared_data(name)
    with rasterio.open(path) as dataset:
        pixels = dataset.read().astype(np.float64)
        a, b, c, d, e, f = dataset.transform[:6]
        crs = dataset.crs.to_wkt()
    imagery = ReferenceImagery.open(path)
    bounds = imagery.raster.bounds
    frame = LocalFrame(
        math.radians((bounds.south_deg + bounds.north_deg) / 2),
        math.radians((bounds.west_deg + bounds.east_deg) / 2),
        600.0,
    )
    gsd_m = imagery.gsd_m * 0.98  # not coarser than the file on either axis: no averaging
    grid = imagery.grid(frame, gsd_m, NeBounds(-120.0, -90.0, 110.0, 100.0))
    imagery.close()
    grey = np.tensordot([0.299, 0.587, 0.114], pixels, axes=1)
    to_crs = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)

    differences = []
    for row, col in np.random.default_rng(6).integers(5, 180, (200, 2)):
        north_m, east_m = grid.north_max_m - row * gsd_m, grid.east_min_m + col * gsd_m
        lat_rad, lon_rad, _ = _at_origin_height(frame, north_m, east_m)
        x, y = to_crs.transform(math.degrees(lon_rad), math.degrees(lat_rad))
        at_col, at_row = (x - c) / a - 0.5, (y - f) / e - 0.5
        assert b == d == 0.0
        if grid.valid[row, col]:
            differences.append(rasters.bilinear(grey, at_col, at_row) - float(grid.image[row, col]))

    assert len(differences) > 150
    assert np.percentile(np.abs(differences), 95) < 2.0
    assert abs(np.mean(differences)) < 0.3


def _at_origin_height(frame: LocalFrame, north_m: float, east_m: float) -> tuple[float, float, float]:
    """Where the vertical through a tangent-plane point meets the origin's height, by pyproj."""
    local = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=rad +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={math.degrees(frame.lat_rad)} "
        f"+lon_0={math.degrees(frame.lon_rad)} +h_0={frame.alt_m}"
    )
    up_m = 0.0
    for _ in range(4):
        lon_rad, lat_rad, alt_m = local.transform(east_m, north_m, up_m, direction="INVERSE", radians=True)
        up_m += frame.alt_m - alt_m
    return lat_rad, lon_rad, alt_m


def test_grid_is_north_up_whatever_the_file_is(tmp_path: Path) -> None:
    """A bright quarter lies north-east on the ground; the file is turned by 137 degrees."""
    size = 400
    path = tmp_path / "a.tif"
    rasters.write(path, np.full((1, size, size), 60, np.uint8), rotation_deg=137.0)
    frame = rasters.frame()
    with rasterio.open(path, "r+") as dataset:
        a, b, c, d, e, f = dataset.transform[:6]
        row, col = np.mgrid[0:size, 0:size] + 0.5
        lon_deg, lat_deg = pyproj.Transformer.from_crs(rasters.UTM, "EPSG:4326", always_xy=True).transform(
            a * col + b * row + c, d * col + e * row + f
        )
        ne_m = frame.ne_from_geodetic(np.radians(lat_deg), np.radians(lon_deg))
        bright = (ne_m[..., 0] > 0) & (ne_m[..., 1] > 0)
        dataset.write(np.where(bright, 200, 60).astype(np.uint8), 1)

    grid = ReferenceImagery.open(path).grid(frame, 1.0, NeBounds(-100.0, -100.0, 100.0, 100.0))

    assert grid.image[20:90, 110:180].min() == 200
    assert grid.image[110:180, 20:90].max() == 60
    # North and east of pixel (r, c), as the class says.
    assert grid.north_max_m == pytest.approx(99.5)
    assert grid.east_min_m == pytest.approx(-99.5)
    assert grid.image[97, 102] == 200
    assert grid.image[102, 97] == 60


def test_offset_moves_what_is_read_off_the_picture(tmp_path: Path) -> None:
    """A map that lies 6 m west and 2 m south of the truth: its mark is found 6 m further east and 2 m further north."""
    pixels = np.full((1, 201, 201), 50, np.uint8)
    pixels[0, 100, 100] = 250
    path = rasters.write(tmp_path / "a.tif", pixels)
    bounds = NeBounds(-50.0, -50.0, 50.0, 50.0)

    def mark(offset_ne_m: tuple[float, float]) -> tuple[float, float]:
        grid = ReferenceImagery.open(path, offset_ne_m).grid(rasters.frame(), 0.5, bounds)
        weight = grid.image.astype(float) - 50.0
        weight[~grid.valid] = 0.0
        row, col = np.indices(weight.shape)
        row_mean, col_mean = (weight * row).sum() / weight.sum(), (weight * col).sum() / weight.sum()
        return grid.north_max_m - row_mean * 0.5, grid.east_min_m + col_mean * 0.5

    plain, moved = mark((0.0, 0.0)), mark((2.0, 6.0))

    assert_allclose(plain, (0.0, 0.0), atol=0.03)
    assert_allclose(np.subtract(moved, plain), (2.0, 6.0), atol=0.03)


def test_whole_picture_at_its_own_resolution_by_default(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "a.tif", rasters.texture(300, 200).astype(np.uint8)[np.newaxis], gsd=0.5)

    grid = ReferenceImagery.open(path).grid(rasters.frame())

    assert grid.gsd_m == pytest.approx(0.5, rel=1e-3)
    assert grid.valid.mean() > 0.92  # the rest is the corners: the meridians converge by 1.9 degrees here
    assert abs(grid.image.shape[0] - 304) < 6
    assert abs(grid.image.shape[1] - 208) < 8


def test_black_collar_is_no_imagery(tmp_path: Path) -> None:
    """An orthophoto in a black frame without nodata value; a dark pond inside stays."""
    pixels = rasters.texture(300, 300, 60, 200)
    pixels[:, :40] = 2.0
    pixels[120:160, 150:190] = 0.0
    path = rasters.write(tmp_path / "a.tif", pixels.astype(np.uint8)[np.newaxis])

    grid = ReferenceImagery.open(path).grid(rasters.frame(), 1.0, NeBounds(-140.0, -140.0, 140.0, 140.0))

    assert not grid.valid[20:-20, :25].any()
    assert grid.valid[20:-20, 40:].all()


def test_window_is_the_grid_itself_inside_and_invalid_outside() -> None:
    image = np.random.default_rng(7).integers(0, 255, (50, 60)).astype(np.uint8)
    grid = ImageryGrid(image, np.ones((50, 60), bool), north_max_m=100.0, east_min_m=-20.0, gsd_m=2.0)

    inside = grid.window(40.0, 0.0, 60.0, 30.0)
    across = grid.window(90.0, 80.0, 120.0, 110.0)
    outside = grid.window(1000.0, 1000.0, 1010.0, 1010.0)

    assert_array_equal(inside.image, image[20:31, 10:26])
    assert np.shares_memory(inside.image, image)
    assert (inside.north_max_m, inside.east_min_m) == (60.0, 0.0)
    assert (across.north_max_m, across.east_min_m) == (120.0, 80.0)
    assert_array_equal(across.image[10:16, :10], image[:6, 50:60])
    assert across.valid[10:16, :10].all()
    assert across.valid.sum() == 60
    assert not outside.valid.any()


def test_absurd_window_is_refused() -> None:
    grid = ImageryGrid(np.zeros((9, 9), np.uint8), np.ones((9, 9), bool), 0.0, 0.0, 0.5)
    with pytest.raises(ValueError, match="larger than"):
        grid.window(-1e6, -1e6, 1e6, 1e6)
    with pytest.raises(ValueError, match="not a rectangle"):
        grid.window(0.0, 0.0, math.nan, 10.0)


def test_grid_too_large_names_a_resolution_that_fits(tmp_path: Path) -> None:
    """A sparse raster of 60 x 60 km at 1 m: refused whole, readable in part."""
    path = tmp_path / "a.tif"
    x, y = pyproj.Transformer.from_crs("EPSG:4326", rasters.UTM, always_xy=True).transform(
        rasters.LON_DEG, rasters.LAT_DEG
    )
    with rasterio.open(
        path, "w", driver="GTiff", width=60_000, height=60_000, count=1, dtype="uint8", crs=rasters.UTM, tiled=True,
        transform=rasterio.Affine(1.0, 0.0, x - 30_000, 0.0, -1.0, y + 30_000), SPARSE_OK=True, compress="deflate",
    ) as dataset:  # fmt: skip
        dataset.write(np.full((1, 512, 512), 90, np.uint8), window=rasterio.windows.Window(29_952, 29_952, 512, 512))
    imagery = ReferenceImagery.open(path)

    with pytest.raises(HugeRasterError, match=r"use 5.* m per pixel or coarser"):
        imagery.grid(rasters.frame())

    near = imagery.grid(rasters.frame(), 1.0, NeBounds(-300.0, 50.0, -50.0, 300.0))
    assert near.image.max() == 90


def test_area_off_the_picture_is_an_error_that_says_so(tmp_path: Path) -> None:
    imagery = ReferenceImagery.open(rasters.write(tmp_path / "a.tif", np.full((1, 50, 50), 99, np.uint8)))
    with pytest.raises(EmptyRasterError, match="in the area asked for"):
        imagery.grid(rasters.frame(), 1.0, NeBounds(5000.0, 5000.0, 5100.0, 5100.0))
