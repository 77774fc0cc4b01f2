"""The older epoch as a map maker would deliver it: imagery and elevation in UTM."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pyproj
from numpy.typing import NDArray

from estimator.geometry.local import LocalFrame
from estimator.types import Float, Image
from geodata.raster import write_geotiff
from simulator.random_streams import rng_for
from simulator.world.light import leaned
from simulator.world.noise import FractalNoise
from simulator.world.paint import Painter
from simulator.world.patch import Float32, Patch
from simulator.world.terrain import Terrain

_TILE_PX = 1600
_MARGIN_M = 8.0
_ELEVATION_GSD_M = 4.0
_JPEG_QUALITY = 88

Transform = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceRaster:
    """Bands (rows, cols) or (rows, cols, 3) in red, green, blue, with their affine transform at pixel corners."""

    bands: NDArray[np.generic]
    transform: Transform
    crs: str

    def write(self, path: Path) -> None:
        """Write it as a GeoTIFF."""
        write_geotiff(path, self.bands, self.transform, self.crs)


def utm_code(frame: LocalFrame) -> str:
    """The UTM zone that the frame's origin lies in."""
    zone = int((np.degrees(frame.lon_rad) + 180) // 6) + 1
    return f"EPSG:{(32600 if frame.lat_rad >= 0 else 32700) + zone}"


def reference_raster(
    painter: Painter, frame: LocalFrame, half_size_m: float, gsd_m: float, seed: int
) -> ReferenceRaster:
    """The map imagery: painted at half the ground sample distance, averaged, with the older sensor's faults."""
    crs = utm_code(frame)
    x_min, y_max, cols, rows = _utm_box(frame, crs, half_size_m, gsd_m)
    ground_ne = _local_from_utm(frame, crs)
    image = np.empty((rows, cols, 3), np.uint8)
    step = _TILE_PX // 2
    for row in range(0, rows, step):
        for col in range(0, cols, step):
            r1, c1 = min(row + step, rows), min(col + step, cols)
            image[row:r1, col:c1] = _tile(painter, ground_ne, (x_min, y_max), (row, r1), (col, c1), gsd_m)
    bands = _sensed(image, painter, seed)
    return ReferenceRaster(bands[..., ::-1].copy(), (gsd_m, 0.0, x_min, 0.0, -gsd_m, y_max), crs)


def elevation_raster(terrain: Terrain, frame: LocalFrame, half_size_m: float, seed: int) -> ReferenceRaster:
    """A terrain model of 4 m posts, as good as laser scanning of fields: 0.1 to 0.2 m."""
    crs = utm_code(frame)
    gsd_m = _ELEVATION_GSD_M
    x_min, y_max, cols, rows = _utm_box(frame, crs, half_size_m, gsd_m)
    north, east = _grid_ne(_local_from_utm(frame, crs), (x_min, y_max), (0, rows), (0, cols), gsd_m)
    noise = FractalNoise(rng_for(seed, "world", "elevation_error"))
    error = 0.12 * noise.sample(Patch(0.0, 0.0, rows, cols, gsd_m), 60.0, 4)
    # The frame is a plane; heights above the sea follow the Earth's curvature, some 3 cm at the edge.
    _, _, alt_m = frame.geodetic_from_ned(np.stack([north, east, -terrain.at(north, east)], axis=-1))
    bands = (alt_m + error).astype(np.float32)
    return ReferenceRaster(bands, (gsd_m, 0.0, x_min, 0.0, -gsd_m, y_max), crs)


class _LocalFromUtm:
    """North and east of UTM coordinates, at the frame's height."""

    def __init__(self, frame: LocalFrame, crs: str) -> None:
        self._frame = frame
        self._to_geodetic = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)

    def __call__(self, x_m: Float, y_m: Float) -> tuple[Float, Float]:
        lon_deg, lat_deg = self._to_geodetic.transform(x_m, y_m)
        ne = self._frame.ne_from_geodetic(np.radians(lat_deg), np.radians(lon_deg))
        return ne[..., 0], ne[..., 1]


def _local_from_utm(frame: LocalFrame, crs: str) -> _LocalFromUtm:
    return _LocalFromUtm(frame, crs)


def _utm_box(frame: LocalFrame, crs: str, half_size_m: float, gsd_m: float) -> tuple[float, float, int, int]:
    """Left, top, columns and rows of the largest upright box that the turned square of the world still fills."""
    edge = np.linspace(-half_size_m, half_size_m, 21)
    side = np.full_like(edge, half_size_m)
    to_utm = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)

    def utm(north: Float, east: Float) -> tuple[Float, Float]:
        lat, lon = frame.geodetic_from_ne(np.stack([north, east], axis=-1))
        x, y = to_utm.transform(np.degrees(lon), np.degrees(lat))
        return np.asarray(x), np.asarray(y)

    left, right = utm(edge, -side)[0].max(), utm(edge, side)[0].min()
    bottom, top = utm(-side, edge)[1].max(), utm(side, edge)[1].min()
    x_min = float(np.ceil((left + _MARGIN_M) / gsd_m) * gsd_m)
    y_max = float(np.floor((top - _MARGIN_M) / gsd_m) * gsd_m)
    return x_min, y_max, int((right - _MARGIN_M - x_min) / gsd_m), int((y_max - bottom - _MARGIN_M) / gsd_m)


def _grid_ne(
    ground_ne: _LocalFromUtm, corner: tuple[float, float], rows: tuple[int, int], cols: tuple[int, int], gsd_m: float
) -> tuple[Float, Float]:
    """North and east of pixel centres; exact every 32 pixels and linear between, which is good to a millimetre."""
    every = 32
    row_nodes = np.arange(rows[0], rows[1] + every, every) + 0.5
    col_nodes = np.arange(cols[0], cols[1] + every, every) + 0.5
    x, y = np.meshgrid(corner[0] + col_nodes * gsd_m, corner[1] - row_nodes * gsd_m)
    node_n, node_e = ground_ne(x, y)
    row = np.arange(rows[1] - rows[0]) / every
    col = np.arange(cols[1] - cols[0]) / every
    return _bilinear(node_n, row, col), _bilinear(node_e, row, col)


def _bilinear(nodes: Float, row: Float, col: Float) -> Float:
    r, c = row.astype(int), col.astype(int)
    fr, fc = (row - r)[:, None], (col - c)[None, :]
    lower = nodes[r] * (1 - fr) + nodes[r + 1] * fr
    return np.asarray(lower[:, c] * (1 - fc) + lower[:, c + 1] * fc)


def _tile(
    painter: Painter,
    ground_ne: _LocalFromUtm,
    corner: tuple[float, float],
    rows: tuple[int, int],
    cols: tuple[int, int],
    gsd_m: float,
) -> Image:
    """One part of the map at its own resolution, before the sensor's faults."""
    fine_m = gsd_m / 2
    north, east = _grid_ne(ground_ne, corner, (2 * rows[0], 2 * rows[1]), (2 * cols[0], 2 * cols[1]), fine_m)
    margin_m = 4.0
    size_rows = 2 * (int(np.ceil((np.ptp(north) + 2 * margin_m) / fine_m / 2)) + 1)
    size_cols = 2 * (int(np.ceil((np.ptp(east) + 2 * margin_m) / fine_m / 2)) + 1)
    patch = Patch(float(north.max()) + margin_m, float(east.min()) - margin_m, size_rows, size_cols, fine_m)
    painted = painter.paint(patch)
    sensor = painter.epoch.sensor
    seen = leaned(painted.colour_bgr, painted.raised_m, patch, sensor.lean_tan, sensor.lean_azimuth_deg)
    warped = cv2.remap(
        seen,
        ((east - patch.east_min_m) / fine_m).astype(np.float32),
        ((patch.north_max_m - north) / fine_m).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    small = cv2.resize(warped, (cols[1] - cols[0], rows[1] - rows[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def _sensed(image: Image, painter: Painter, seed: int) -> Image:
    """Blur, haze, colour and noise of the map's sensor, and the compression it was delivered in."""
    sensor = painter.epoch.sensor
    rng = rng_for(seed, "world", painter.epoch.name, "sensor")
    blurred = cv2.GaussianBlur(image, (5, 5), sensor.blur_sigma_px)
    out = np.empty_like(blurred)
    for start in range(0, len(image), 400):
        part: Float32 = blurred[start : start + 400].astype(np.float32)
        part = (part - sensor.level) * sensor.contrast + sensor.level
        part *= np.array(sensor.gain_rgb[::-1], np.float32)
        part += rng.standard_normal(part.shape, dtype=np.float32) * np.float32(sensor.noise_std)
        out[start : start + 400] = np.clip(np.round(part), 0, 255).astype(np.uint8)
    _, packed = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
