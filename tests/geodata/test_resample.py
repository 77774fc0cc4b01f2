from __future__ import annotations

import math
import resource
from pathlib import Path

import numpy as np
import pytest
import rasterio
from numpy.testing import assert_allclose, assert_array_equal
from rasterio.enums import Resampling

from estimator.types import Float
from geodata.raster import Bands, open_raster
from geodata.resample import resample
from tests.geodata import rasters


def as_float(bands: Bands) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return bands.astype(np.float32)


def position_rasters(tmp_path: Path, **options: object) -> tuple[Path, int]:
    """A raster whose two bands hold each pixel's own column and row."""
    size = 1200
    row, col = np.mgrid[0:size, 0:size].astype(np.float32)
    return rasters.write(tmp_path / "p.tif", np.stack([col, row]), tiled=True, **options), size  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("crs", "gsd", "rotation_deg"),
    [
        ("EPSG:32632", 0.5, 0.0),
        ("EPSG:32632", 0.5, 61.0),
        ("EPSG:3857", 0.75, 0.0),
        ("EPSG:4326", 5e-6, 0.0),
        ("EPSG:31468", 0.5, 0.0),
    ],
)
@pytest.mark.parametrize("target_gsd_m", [0.4, 1.3])
def test_every_pixel_shows_the_place_it_stands_for(
    tmp_path: Path, crs: str, gsd: float, rotation_deg: float, target_gsd_m: float
) -> None:
    """
    The raster holds its own pixel coordinates, so that what is read off the grid is where it was taken from.
    Expected: within 2 cm of the full projection chain, point by point, both when refining and when averaging.
    """
    path, size = position_rasters(tmp_path, crs=crs, gsd=gsd, rotation_deg=rotation_deg)
    frame = rasters.frame()
    rows = cols = int(300 / target_gsd_m)

    def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
        return frame.geodetic_from_ne(np.stack([150.0 - row * target_gsd_m, col * target_gsd_m - 150.0], axis=-1))

    with open_raster(path) as raster:
        planes, valid = resample(raster, as_float, geodetic_at, rows, cols, node_step_px=60.0 / target_gsd_m)
        row, col = np.meshgrid(np.arange(0, rows, 17.0), np.arange(0, cols, 13.0), indexing="ij")
        expected = raster.pixel_from_geodetic(*geodetic_at(row, col))
        gsd_m = raster.gsd_m
    at = row.astype(int), col.astype(int)
    inside = (np.abs(expected[0] - size / 2) < size / 2 - 8) & (np.abs(expected[1] - size / 2) < size / 2 - 8)

    assert inside.sum() > 200
    assert valid[at][inside].all()
    for plane, truth in zip(planes, expected, strict=True):
        # cv2.remap knows 1/32 of a pixel; the rest is below a millimetre.
        assert np.abs(plane[at] - truth)[inside].max() * gsd_m < 0.02
        assert abs(np.mean((plane[at] - truth)[inside])) * gsd_m < 0.003


@pytest.mark.parametrize("factor", [2.0, 3.7, 12.0])
def test_finer_source_is_averaged_not_picked(tmp_path: Path, factor: float) -> None:
    """White noise averaged over n pixels keeps its mean and loses its spread by about n."""
    noise = np.random.default_rng(5).normal(100.0, 20.0, (1, 900, 900)).astype(np.float32)
    path = rasters.write(tmp_path / "a.tif", noise, gsd=0.25)
    frame = rasters.frame()
    gsd_m = 0.25 * factor
    side = int(200 / gsd_m)

    def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
        return frame.geodetic_from_ne(np.stack([100.0 - row * gsd_m, col * gsd_m - 100.0], axis=-1))

    with open_raster(path) as raster:
        planes, valid = resample(raster, as_float, geodetic_at, side, side, node_step_px=64)

    assert valid.all()
    assert planes[0].mean() == pytest.approx(100.0, abs=0.6)
    assert 0.5 * 20.0 / factor < planes[0].std() < 1.3 * 20.0 / factor


def test_overviews_do_not_move_the_picture(tmp_path: Path) -> None:
    path, _ = position_rasters(tmp_path, gsd=0.5)
    with rasterio.open(path, "r+") as dataset:
        dataset.build_overviews([2, 4, 8, 16], Resampling.average)
    frame = rasters.frame()
    gsd_m = 9.0
    side = 50

    def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
        return frame.geodetic_from_ne(np.stack([220.0 - row * gsd_m, col * gsd_m - 220.0], axis=-1))

    with open_raster(path) as raster:
        assert len(raster.levels) == 5
        planes, valid = resample(raster, as_float, geodetic_at, side, side, node_step_px=16)
        row, col = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float), indexing="ij")
        expected = raster.pixel_from_geodetic(*geodetic_at(row, col))

    assert valid.all()
    for plane, truth in zip(planes, expected, strict=True):
        assert np.abs(plane - truth).max() * 0.5 < 0.15  # a sixtieth of the 9 m pixels


def test_holes_do_not_bleed_into_their_surroundings(tmp_path: Path) -> None:
    pixels = np.full((1, 200, 200), 80.0, np.float32)
    pixels[0, 60:90, 60:120] = -9999.0
    path = rasters.write(tmp_path / "a.tif", pixels, nodata=-9999.0)
    frame = rasters.frame()

    def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
        return frame.geodetic_from_ne(np.stack([60.0 - row * 0.7, col * 0.7 - 60.0], axis=-1))

    with open_raster(path) as raster:
        planes, valid = resample(raster, as_float, geodetic_at, 170, 170, node_step_px=64)

    assert 0.02 < 1 - valid.mean() < 0.2
    assert_allclose(planes[0][valid], 80.0, atol=1e-3)
    assert_array_equal(planes[0][~valid], 0.0)


def test_far_away_grid_is_invalid_not_an_error(tmp_path: Path) -> None:
    """Transverse Mercator has no image of the other side of the Earth."""
    path = rasters.write(tmp_path / "a.tif", np.ones((1, 20, 20), np.uint8))

    def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
        return np.zeros_like(row) + 0.1 - row * 1e-3, np.zeros_like(col) + math.radians(-120) + col * 1e-3

    with open_raster(path) as raster:
        _, valid = resample(raster, as_float, geodetic_at, 40, 40, node_step_px=10)

    assert not valid.any()


def test_coarse_grid_over_a_large_raster_keeps_memory_small(tmp_path: Path) -> None:
    """
    A source of 8000 x 8000 pixels read onto 5 x 5 pixels, each of them the mean of millions.
    Expected: right means, and never more than a piece of the source in memory.
    """
    path = tmp_path / "a.tif"
    rasters.write(path, np.full((1, 8_000, 8_000), 50, np.uint8), gsd=0.15, tiled=True, compress="deflate")
    frame = rasters.frame()

    def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
        return frame.geodetic_from_ne(np.stack([400.0 - row * 200.0, col * 200.0 - 400.0], axis=-1))

    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with open_raster(path) as raster:
        planes, valid = resample(raster, as_float, geodetic_at, 5, 5, node_step_px=1.0)

    assert valid.all()
    assert_allclose(planes, 50.0, atol=1e-3)
    # The whole as floats with weights would take 0.5 GB.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 300_000
