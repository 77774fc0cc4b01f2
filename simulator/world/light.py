"""Sun, shade and lean: how relief becomes brightness."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from simulator.world.patch import Float32, Patch

TALLEST_M = 20.0


def sunlight(
    ground_m: Float32, raised_m: Float32, patch: Patch, sun_azimuth_deg: float, sun_elevation_deg: float
) -> tuple[Float32, Float32]:
    """Brightness relative to level ground in full sun, and the share (0 to 1) of cast shadow; both (rows, cols)."""
    azimuth, elevation = np.radians(sun_azimuth_deg), np.radians(sun_elevation_deg)
    surface = ground_m + raised_m
    smooth = cv2.GaussianBlur(surface, (3, 3), 0.7)
    scale = 1.0 / (2 * patch.gsd_m)
    slope_north = np.clip(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=1) * -scale, -1.6, 1.6)
    slope_east = np.clip(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=1) * scale, -1.6, 1.6)
    toward_n, toward_e = np.cos(azimuth) / np.tan(elevation), np.sin(azimuth) / np.tan(elevation)
    facing = 1 - slope_north * np.float32(toward_n) - slope_east * np.float32(toward_e)
    facing /= np.sqrt(1 + slope_north**2 + slope_east**2)
    shadow = _cast_shadow(surface, patch, azimuth, elevation)
    return np.clip(facing, 0.0, 1.7), shadow


def _cast_shadow(surface_m: Float32, patch: Patch, azimuth_rad: float, elevation_rad: float) -> Float32:
    """Marches towards the sun on a raster of half the resolution."""
    low = cv2.resize(surface_m, (patch.cols // 2, patch.rows // 2), interpolation=cv2.INTER_AREA)
    gsd_m = 2 * patch.gsd_m
    horizon = np.full_like(low, -1e6)
    rows, cols = low.shape
    for step in range(2, int(TALLEST_M / np.tan(elevation_rad) / gsd_m) + 1):
        up, right = round(step * np.cos(azimuth_rad)), round(step * np.sin(azimuth_rad))
        drop_m = np.float32(step * gsd_m * np.tan(elevation_rad))
        target = horizon[max(up, 0) : rows + min(up, 0), max(-right, 0) : cols + min(-right, 0)]
        source = low[max(-up, 0) : rows + min(-up, 0), max(right, 0) : cols + min(right, 0)]
        np.maximum(target, source - drop_m, out=target)
    shade = np.clip((horizon - low - 0.1) / np.float32(0.5), 0, 1)
    soft = cv2.GaussianBlur(shade, (3, 3), 0.6)
    full = cv2.resize(soft, (patch.cols, patch.rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(full, np.float32)


def leaned(
    image: NDArray[np.uint8], raised_m: Float32, patch: Patch, lean_tan: float, azimuth_deg: float
) -> NDArray[np.uint8]:
    """The picture as a sensor off to one side sees it: what is raised moves by height times ``lean_tan``."""
    north_per_m = lean_tan * np.cos(np.radians(azimuth_deg)) / patch.gsd_m
    east_per_m = lean_tan * np.sin(np.radians(azimuth_deg)) / patch.gsd_m
    seen_m = np.zeros_like(raised_m)
    col = np.broadcast_to(np.arange(patch.cols, dtype=np.float32), raised_m.shape)
    row = np.broadcast_to(np.arange(patch.rows, dtype=np.float32)[:, None], raised_m.shape)
    for level in np.arange(1.0, TALLEST_M, 1.0):
        shift = np.array([[1, 0, -level * east_per_m], [0, 1, level * north_per_m]])
        moved = cv2.warpAffine(
            raised_m, shift, (patch.cols, patch.rows), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        )
        np.copyto(seen_m, np.minimum(moved, np.float32(level + 1.0)), where=moved >= level)
    out = cv2.remap(
        image,
        col - seen_m * np.float32(east_per_m),
        row + seen_m * np.float32(north_per_m),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(out, np.uint8)
