"""The finer map of the memory's budget lies where the coarse one does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from benchmarks.flying import MAP_GSD_M, fine_map
from geodata.raster import open_raster, write_geotiff


def test_a_finer_map_shows_every_thing_at_its_place(tmp_path: Path) -> None:
    image = np.full((300, 400, 3), 50, np.uint8)
    image[100:102, 250:252] = 250  # a square metre 125 m east and 50 m south of the corner
    write_geotiff(tmp_path / "coarse.tif", image, (0.5, 0.0, 500_000.0, 0.0, -0.5, 5_205_000.0), "EPSG:32632")
    fine_map(tmp_path / "coarse.tif", tmp_path / "fine.tif")

    with open_raster(tmp_path / "fine.tif") as raster:
        bands, _ = raster.read(raster.levels[0], 0, 0, raster.width_px, raster.height_px)
        transform = tuple(raster.transform)[:6]
        gsd_m = raster.gsd_m
    rows, cols = np.nonzero(bands[0] > 200)
    east, north = transform[2] + transform[0] * (cols.mean() + 0.5), transform[5] + transform[4] * (rows.mean() + 0.5)

    assert_allclose(gsd_m, MAP_GSD_M, rtol=2e-3)
    assert_allclose([east, north], [500_125.5, 5_204_949.5], atol=0.15)
