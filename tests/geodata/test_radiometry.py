from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from geodata.errors import EmptyRasterError
from geodata.radiometry import Radiometry
from geodata.raster import open_raster
from tests.geodata import rasters


@pytest.mark.parametrize(
    ("dtype", "low", "high"), [(np.uint16, 900, 4100), (np.float32, 0.02, 0.4), (np.int16, -50, 700)]
)
def test_stretch_ignores_glints_and_dead_pixels(tmp_path: Path, dtype: type, low: float, high: float) -> None:
    """A few extreme pixels leave the contrast of all others as it is."""
    pixels = rasters.texture(200, 200, low, high).astype(dtype)
    clean = open_raster(rasters.write(tmp_path / "clean.tif", pixels[np.newaxis]))
    pixels.flat[:40] = np.iinfo(dtype).max if np.issubdtype(dtype, np.integer) else 1e6
    spoilt = open_raster(rasters.write(tmp_path / "spoilt.tif", pixels[np.newaxis]))

    with clean, spoilt:
        inner = pixels[np.newaxis, 10:, 10:]
        grey_clean, grey_spoilt = Radiometry.of(clean).grey(inner), Radiometry.of(spoilt).grey(inner)

    assert grey_clean.min() < 5
    assert grey_clean.max() > 250
    assert_allclose(grey_spoilt, grey_clean, atol=3.0)


def test_eight_bits_pass_unchanged(tmp_path: Path) -> None:
    pixels = rasters.texture(30, 30, 100, 140).astype(np.uint8)[np.newaxis]
    with open_raster(rasters.write(tmp_path / "a.tif", pixels)) as raster:
        assert_allclose(Radiometry.of(raster).grey(pixels), pixels)


def test_grey_of_colour_is_luma(tmp_path: Path) -> None:
    bands = np.zeros((3, 4, 4), np.uint8)
    bands[0], bands[1], bands[2] = 200, 100, 50
    with open_raster(rasters.write(tmp_path / "a.tif", bands)) as raster:
        assert_allclose(Radiometry.of(raster).grey(bands), 0.299 * 200 + 0.587 * 100 + 0.114 * 50, rtol=1e-5)


def test_palette_becomes_its_colours(tmp_path: Path) -> None:
    index = np.array([[[0, 1], [2, 1]]], np.uint8)
    colours = {0: (10, 20, 30, 255), 1: (200, 0, 0, 255), 2: (0, 0, 90, 255)}
    with open_raster(rasters.write(tmp_path / "a.tif", index, colormap=colours, nodata=2)) as raster:
        assert_allclose(Radiometry.of(raster).colour(index)[:, 0, 1], [200, 0, 0])
        assert not raster.read(raster.levels[0], 0, 0, 2, 2)[1][1, 0]  # the nodata index


def test_picture_of_one_value_is_mid_grey(tmp_path: Path) -> None:
    pixels = np.full((1, 20, 20), 7000, np.uint16)
    with open_raster(rasters.write(tmp_path / "a.tif", pixels)) as raster:
        assert_allclose(Radiometry.of(raster).grey(pixels), 127.5)


def test_all_nodata_has_no_rendering(tmp_path: Path) -> None:
    with (
        open_raster(rasters.write(tmp_path / "a.tif", np.zeros((1, 20, 20), np.uint16), nodata=0)) as raster,
        pytest.raises(EmptyRasterError, match="no valid pixel"),
    ):
        Radiometry.of(raster)
