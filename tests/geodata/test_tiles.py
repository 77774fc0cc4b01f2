from __future__ import annotations

import math
import threading
from pathlib import Path

import cv2
import numpy as np
import pyproj
import pytest

from geodata.raster import open_raster
from geodata.tiles import MapTiles
from tests.geodata import rasters
from tests.shared_data import shared_data


def decoded(content: bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (256, 256, 4)
    return np.asarray(picture, dtype=np.uint8)


def tile_of(lat_deg: float, lon_deg: float, zoom: int) -> tuple[int, int, float, float]:
    """Tile numbers and the pixel inside, by pyproj's Web Mercator."""
    half = 20037508.342789244
    x, y = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3857", always_xy=True).transform(lon_deg, lat_deg)
    across, down = (x + half) / (2 * half) * 2**zoom, (half - y) / (2 * half) * 2**zoom
    return int(across), int(down), (across % 1) * 256 - 0.5, (down % 1) * 256 - 0.5


@pytest.mark.parametrize("zoom", [17, 19, 21])
def test_a_mark_on_the_ground_is_on_the_right_pixel_of_the_right_tile(tmp_path: Path, zoom: int) -> None:
    """A red square of 12 m: the centre of red in the tile is where Web Mercator puts the square's centre."""
    bands = np.full((3, 401, 401), 40, np.uint8)
    bands[0, 185:209, 215:239] = 250
    path = rasters.write(tmp_path / "a.tif", bands, gsd=0.5, photometric="RGB")
    with open_raster(path) as raster:
        lat_rad, lon_rad = raster.geodetic_from_pixel(np.array([226.5]), np.array([196.5]))
    x, y, u_px, v_px = tile_of(math.degrees(lat_rad[0]), math.degrees(lon_rad[0]), zoom)

    # The square may lie across tiles: lay nine together.
    tiles = MapTiles(path)
    mosaic = np.vstack([np.hstack([decoded(tiles.tile(zoom, x + i, y + j)) for i in (-1, 0, 1)]) for j in (-1, 0, 1)])
    red = np.where(mosaic[..., 3] > 0, mosaic[..., 2].astype(float) - mosaic[..., 0], 0.0)
    row, col = np.indices(red.shape)

    assert red.max() > 150
    assert (red * col).sum() / red.sum() - 256 == pytest.approx(u_px, abs=0.15)
    assert (red * row).sum() / red.sum() - 256 == pytest.approx(v_px, abs=0.15)


def test_neighbouring_tiles_join_without_a_seam() -> None:
    """Across the border of two tiles a real map changes no more than inside them."""
    tiles = MapTiles(shared_data("flights/copter_120m/reference.tif"))
    x, y, _, _ = tile_of(32.1043, 35.2070, 18)
    left, right = (decoded(tiles.tile(18, x + i, y)).astype(float) for i in (0, 1))
    assert (left[..., 3] == 255).all()
    at_border = np.abs(right[:, 0, :3] - left[:, -1, :3]).mean()
    inside = np.abs(np.diff(left[..., :3], axis=1)).mean()
    assert at_border < 2 * inside + 1


def test_off_the_map_and_in_its_holes_a_tile_is_transparent(tmp_path: Path) -> None:
    hole = np.ones((400, 400), bool)
    hole[150:250, 150:250] = False
    path = rasters.write(tmp_path / "a.tif", np.full((1, 400, 400), 90, np.uint8), mask=hole)
    tiles = MapTiles(path)
    x, y, u_px, v_px = tile_of(rasters.LAT_DEG, rasters.LON_DEG, 17)

    picture = decoded(tiles.tile(17, x, y))

    assert picture[round(v_px), round(u_px), 3] == 0
    assert 0 < np.mean(picture[..., 3] == 255) < 1
    assert tiles.tile(17, x + 40, y) == tiles.empty
    assert not decoded(tiles.empty).any()


def test_whole_world_tile_shows_a_small_map_as_nothing_or_a_dot(tmp_path: Path) -> None:
    """A pixel of that tile stands for 100 000 pixels of the map; memory must not follow."""
    tiles = MapTiles(rasters.write(tmp_path / "a.tif", np.full((1, 400, 400), 90, np.uint8)))
    assert np.mean(decoded(tiles.tile(0, 0, 0))[..., 3] > 0) < 1e-3


@pytest.mark.parametrize("numbers", [(-1, 0, 0), (25, 0, 0), (3, 8, 0), (3, 0, -1)])
def test_impossible_tile_is_refused(tmp_path: Path, numbers: tuple[int, int, int]) -> None:
    tiles = MapTiles(rasters.write(tmp_path / "a.tif", np.full((1, 40, 40), 90, np.uint8)))
    with pytest.raises(ValueError, match="no tile"):
        tiles.tile(*numbers)


def test_sixteen_bit_map_is_shown_stretched(tmp_path: Path) -> None:
    pixels = rasters.texture(400, 400, 1000, 3000).astype(np.uint16)
    tiles = MapTiles(rasters.write(tmp_path / "a.tif", pixels[np.newaxis]))
    x, y, _, _ = tile_of(rasters.LAT_DEG, rasters.LON_DEG, 18)
    picture = decoded(tiles.tile(18, x, y))
    assert np.ptp(picture[..., 0][picture[..., 3] > 0]) > 150


def test_several_threads_get_the_same_tiles() -> None:
    path = shared_data("photos/seneca/map_passA_30cm.tif")
    x, y, _, _ = tile_of(41.0365, -83.3057, 19)
    wanted = [(19, x + i, y + j) for i in range(2) for j in range(2)]
    alone = {numbers: MapTiles(path).tile(*numbers) for numbers in wanted}
    shared = MapTiles(path, cache_tiles=1)
    wrong: list[tuple[int, int, int]] = []

    def fetch(order: int) -> None:
        for numbers in wanted[order:] + wanted[:order]:
            if shared.tile(*numbers) != alone[numbers]:
                wrong.append(numbers)

    threads = [threading.Thread(target=fetch, args=(order,)) for order in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
