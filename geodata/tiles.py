"""Web-Mercator picture tiles (XYZ, 256 px PNG, transparent off the map) from a georeferenced raster."""

from __future__ import annotations

import math
import os
import threading
from collections import OrderedDict

import cv2
import numpy as np

from estimator.types import Float, Image
from geodata.radiometry import Radiometry
from geodata.raster import open_raster
from geodata.resample import resample

TILE_PX = 256
MAX_ZOOM = 24

_NODE_STEP_PX = 16.0


class MapTiles:
    """Tiles of one raster, rendered on demand and kept; safe to use from several threads."""

    def __init__(self, path: str | os.PathLike[str], cache_tiles: int = 256) -> None:
        self._raster = open_raster(path)
        self._radiometry = Radiometry.of(self._raster)
        bounds = self._raster.bounds
        self._south_rad, self._north_rad = math.radians(bounds.south_deg), math.radians(bounds.north_deg)
        self._west_rad, self._east_rad = math.radians(bounds.west_deg), math.radians(bounds.east_deg)
        self._cache: OrderedDict[tuple[int, int, int], bytes] = OrderedDict()
        self._cache_tiles = cache_tiles
        self._lock = threading.Lock()
        self.empty = _png(np.zeros((TILE_PX, TILE_PX, 4), dtype=np.uint8))

    def tile(self, z: int, x: int, y: int) -> bytes:
        """The PNG of one tile; ``empty`` where the raster does not reach.

        Raises
        ------
        ValueError
            There is no such tile.
        CorruptRasterError
            The raster's file is damaged there.
        """
        if not (0 <= z <= MAX_ZOOM and 0 <= x < 2**z and 0 <= y < 2**z):
            message = f"no tile {z}/{x}/{y}: zoom is 0 to {MAX_ZOOM}, x and y are 0 to 2^zoom - 1"
            raise ValueError(message)
        key = (z, x, y)
        with self._lock:
            if key in self._cache:
                self._cache.move_to_end(key)
                return self._cache[key]
        content = self._render(z, x, y) if self._reaches(z, x, y) else self.empty
        with self._lock:
            self._cache[key] = content
            while len(self._cache) > self._cache_tiles:
                self._cache.popitem(last=False)
        return content

    def close(self) -> None:
        """Release the file."""
        self._raster.close()

    def _reaches(self, z: int, x: int, y: int) -> bool:
        west, east = (2 * math.pi * side / 2**z - math.pi for side in (x, x + 1))
        north, south = (float(_latitude(np.float64(side / 2**z))) for side in (y, y + 1))
        if south > self._north_rad or north < self._south_rad:
            return False
        # East of the antimeridian a raster's bounds count on past 180 degrees.
        return any(
            west + turn <= self._east_rad and east + turn >= self._west_rad for turn in (-2 * math.pi, 0.0, 2 * math.pi)
        )

    def _region(self, z: int, x: int, y: int) -> tuple[int, int, int, int] | None:
        """Tile pixels (top, left, bottom, right) around the raster; None when it crosses the antimeridian."""
        if self._east_rad > math.pi:
            return None
        scale = 2**z * TILE_PX
        left, right = (
            scale * (lon_rad / math.pi + 1) / 2 - x * TILE_PX for lon_rad in (self._west_rad, self._east_rad)
        )
        top, bottom = (
            scale * (1 - math.asinh(math.tan(max(-1.5, min(1.5, lat_rad)))) / math.pi) / 2 - y * TILE_PX
            for lat_rad in (self._north_rad, self._south_rad)
        )
        return math.floor(top) - 2, math.floor(left) - 2, math.ceil(bottom) + 3, math.ceil(right) + 3

    def _render(self, z: int, x: int, y: int) -> bytes:
        def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
            across = (x + (col + 0.5) / TILE_PX) / 2**z
            down = (y + (row + 0.5) / TILE_PX) / 2**z
            return _latitude(down), 2 * math.pi * across - math.pi

        planes, valid = resample(
            self._raster,
            self._radiometry.colour,
            geodetic_at,
            TILE_PX,
            TILE_PX,
            node_step_px=_NODE_STEP_PX,
            region=self._region(z, x, y),
        )
        if not valid.any():
            return self.empty
        picture = np.zeros((TILE_PX, TILE_PX, 4), dtype=np.uint8)
        # Blue, green, red for OpenCV; a single plane spreads over all three.
        picture[..., :3] = np.moveaxis(np.rint(planes[::-1]), 0, -1).astype(np.uint8)
        picture[..., 3] = np.where(valid, 255, 0)
        return _png(picture)


def _latitude(down: Float | np.float64) -> Float:
    """Latitude of a fraction of the Web-Mercator square from its top."""
    latitude: Float = np.arctan(np.sinh(math.pi * (1.0 - 2.0 * down)))
    return latitude


def _png(picture: Image) -> bytes:
    # Level 1 is four times as fast as the default and 15 % larger.
    _, content = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return bytes(content.tobytes())
