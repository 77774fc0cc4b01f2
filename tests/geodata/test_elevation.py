from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
from numpy.testing import assert_allclose, assert_array_equal

from estimator.geometry.local import LocalFrame
from geodata.elevation import ElevationGrid, FlatGround
from geodata.errors import EmptyRasterError, UnsupportedRasterError
from tests.geodata import rasters
from tests.shared_data import shared_data


def test_real_terrain_agrees_with_the_file_point_by_point() -> None:
    """Bilinear heights at scattered places, projected by pyproj, where the file knows them."""
    path = shared_data("flights/ariel_b/elevation.tif")
    frame = LocalFrame(math.radians(32.1025), math.radians(35.2097), 710.0)
    grid = ElevationGrid.open(path, frame)
    with rasterio.open(path) as dataset:
        heights, transform = dataset.read(1), dataset.transform
        to_crs = pyproj.Transformer.from_crs("EPSG:4326", dataset.crs.to_wkt(), always_xy=True)
    ne_m = np.random.default_rng(8).uniform(-250.0, 250.0, (400, 2))
    lat_rad, lon_rad = frame.geodetic_from_ne(ne_m)
    x, y = to_crs.transform(np.degrees(lon_rad), np.degrees(lat_rad))
    col, row = (x - transform.c) / transform.a - 0.5, (y - transform.f) / transform.e - 0.5
    expected = np.array([rasters.bilinear(heights, c, r) for c, r in zip(col, row, strict=True)])
    known = expected > 0

    found = grid.alt_amsl_m(ne_m[:, 0], ne_m[:, 1])

    both = known & np.isfinite(found)
    assert both.sum() > 200
    # Two bilinear interpolations of 5 m cells over buildings and walls: the median says they lie in place.
    assert np.median(np.abs(found - expected)[both]) < 0.15
    assert abs(np.median((found - expected)[both])) < 0.02


@pytest.mark.parametrize("gsd", [2.0, 30.0])
def test_plane_is_reproduced_exactly(tmp_path: Path, gsd: float) -> None:
    """A plane in the raster's own coordinates stays one to a few millimetres, whatever the cell size."""
    rows = cols = int(1200 / gsd)
    row, col = np.mgrid[0:rows, 0:cols]
    path = rasters.write(
        tmp_path / "a.tif", (500.0 + 0.3 * gsd * col - 0.2 * gsd * row).astype(np.float32)[np.newaxis], gsd=gsd
    )
    frame = rasters.frame()
    grid = ElevationGrid.open(path, frame)
    ne_m = np.random.default_rng(9).uniform(-400.0, 400.0, (300, 2))
    with rasterio.open(path) as dataset:
        a, _, c, _, e, f = dataset.transform[:6]
    lat_rad, lon_rad = frame.geodetic_from_ne(ne_m)
    x, y = pyproj.Transformer.from_crs("EPSG:4326", rasters.UTM, always_xy=True).transform(
        np.degrees(lon_rad), np.degrees(lat_rad)
    )
    expected = 500.0 + 0.3 * gsd * ((x - c) / a - 0.5) - 0.2 * gsd * ((y - f) / e - 0.5)

    assert_allclose(grid.alt_amsl_m(ne_m[:, 0], ne_m[:, 1]), expected, atol=0.005)


def test_lookup_is_bilinear_and_nan_where_nothing_is_known() -> None:
    heights = np.array([[10.0, 20.0, 30.0], [20.0, 30.0, 40.0], [30.0, 40.0, np.nan]])
    grid = ElevationGrid(heights, north_max_m=20.0, east_min_m=0.0, gsd_m=10.0)

    assert grid.alt_amsl_m(np.float64(20.0), np.float64(0.0)) == pytest.approx(10.0)
    assert_allclose(grid.alt_amsl_m(np.array([15.0, 12.5]), np.array([5.0, 7.5])), [20.0, 25.0])
    unknown = grid.alt_amsl_m(
        np.array([0.0, 5.0, 500.0, np.nan, 15.0, np.inf]), np.array([20.0, 15.0, 0.0, 0.0, np.nan, 0.0])
    )
    assert np.isnan(unknown).all()
    assert grid.alt_amsl_m(np.zeros((4, 1)) + 12.0, np.array([1.0, 2.0, 3.0])).shape == (4, 3)


def test_declared_and_undeclared_nodata_become_nan(tmp_path: Path) -> None:
    heights = np.full((1, 60, 60), 200.0, np.float32)
    heights[0, :20, :20] = -9999.0
    heights[0, 40:, 40:] = -32768.0
    heights[0, :20, 40:] = np.nan
    path = rasters.write(tmp_path / "a.tif", heights, nodata=-9999.0)

    grid = ElevationGrid.open(path, rasters.frame())

    known = grid.alt_amsl_grid_m[np.isfinite(grid.alt_amsl_grid_m)]
    assert_allclose(known, 200.0, atol=1e-3)
    assert 0.5 < np.isfinite(grid.alt_amsl_grid_m).mean() < 0.75


@pytest.mark.parametrize(("unit", "factor"), [("ft", 0.3048), ("m", 1.0), ("US survey foot", 1200 / 3937)])
def test_feet_become_metres(tmp_path: Path, unit: str, factor: float) -> None:
    path = rasters.write(tmp_path / "a.tif", np.full((1, 20, 20), 1000, np.int16))
    with rasterio.open(path, "r+") as dataset:
        dataset.units = [unit]
    assert ElevationGrid.open(path, rasters.frame()).alt_amsl_m(np.float64(0), np.float64(0)) == pytest.approx(
        1000 * factor
    )


def test_scaled_integers_become_metres(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "a.tif", np.full((1, 20, 20), 5000, np.int32))
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = [0.1], [100.0]
    assert ElevationGrid.open(path, rasters.frame()).alt_amsl_m(np.float64(0), np.float64(0)) == pytest.approx(600.0)


def test_picture_is_refused_as_elevation(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "a.tif", np.zeros((3, 20, 20), np.uint8))
    with pytest.raises(UnsupportedRasterError, match="picture"):
        ElevationGrid.open(path, rasters.frame())


def test_all_nodata_is_an_error(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "a.tif", np.full((1, 20, 20), -9999.0, np.float32), nodata=-9999.0)
    with pytest.raises(EmptyRasterError, match="no known height"):
        ElevationGrid.open(path, rasters.frame())


def test_national_model_is_cut_to_what_is_near(tmp_path: Path) -> None:
    """30 m cells over 90 x 90 km keep their resolution within reach of the origin."""
    path = rasters.write(tmp_path / "a.tif", np.full((1, 3000, 3000), 321, np.int16), gsd=30.0, compress="deflate")

    grid = ElevationGrid.open(path, rasters.frame())

    assert grid.gsd_m == pytest.approx(30.0, rel=1e-3)
    assert grid.alt_amsl_grid_m.shape == pytest.approx((667, 667), abs=2)
    assert_array_equal(grid.alt_amsl_m(np.array([0.0, 9900.0]), np.array([0.0, -9900.0])), [321.0, 321.0])


def test_flat_ground_is_flat() -> None:
    ground = FlatGround(152.0)
    assert_array_equal(ground.alt_amsl_m(np.array([0.0, 1e5]), np.array([3.0, 4.0])), [152.0, 152.0])
    assert np.isnan(ground.alt_amsl_m(np.array(np.nan), np.array(0.0)))
    assert ground.gsd_m == math.inf
    with pytest.raises(ValueError, match="finite"):
        FlatGround(math.nan)
