"""Map imagery and its georeference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj
import pytest

from estimator.geometry.local import LocalFrame
from geodata.imagery import ReferenceImagery
from simulator.world.patch import Patch
from simulator.world.reference import utm_code
from simulator.world.world import World


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "code"),
    [(58.49, 15.62, "EPSG:32633"), (-33.9, 18.4, "EPSG:32734"), (0.5, -179.5, "EPSG:32601")],
)
def test_zone(lat_deg: float, lon_deg: float, code: str) -> None:
    assert utm_code(LocalFrame(np.radians(lat_deg), np.radians(lon_deg), 0.0)) == code


def test_lake_is_where_the_world_has_it(world: World, tmp_path: Path) -> None:
    """Through the file, the station's reader and pyproj, dark water comes back at its place."""
    path = tmp_path / "reference.tif"
    world.reference.write(path)
    imagery = ReferenceImagery.open(path)
    grid = imagery.grid(world.frame, gsd_m=1.0)
    rows, cols = np.indices(grid.image.shape)
    north, east = grid.north_max_m - rows * grid.gsd_m, grid.east_min_m + cols * grid.gsd_m
    patch = Patch(grid.north_max_m, grid.east_min_m, *grid.image.shape, grid.gsd_m)
    assert np.abs(patch.row_col(np.stack([north, east], axis=-1)) - np.stack([rows, cols], axis=-1)).max() < 1e-6
    assert grid.valid.mean() > 0.85
    a, _, x_min, _, e, y_max = world.reference.transform
    to_geodetic = pyproj.Transformer.from_crs(world.reference.crs, "EPSG:4326", always_xy=True)
    for row, col in ((100, 100), (300, 500), (550, 200)):
        lon, lat = to_geodetic.transform(x_min + a * (col + 0.5), y_max + e * (row + 0.5))
        place = world.frame.ne_from_geodetic(np.radians(lat), np.radians(lon))
        r, c = patch.row_col(place).round().astype(int)
        near = world.reference.bands[row - 3 : row + 4, col - 3 : col + 4].mean()
        assert float(grid.image[r - 1 : r + 2, c - 1 : c + 2].mean()) == pytest.approx(near, abs=22)
