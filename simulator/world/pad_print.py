"""The print of a landing pad as rays see it: which points of its plane are ink, and which pixels may show it.

Poses are those of the pad in the camera: ``camera_from_pad`` (3, 3) turns pad coordinates (x forward, y right, z into
the ground), the pad's centre is at ``pad_in_camera_m`` (3,).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.landing.pad import Ring
from estimator.types import Float

Float32 = NDArray[np.float32]
Sheet = tuple[float, float, float, float]

SUPERSAMPLING = 4
"""Rays along each side of a pixel."""
PAPER, INK = 205.0, 22.0
"""Grey levels."""


def on_plane(xy: Float32, camera_from_pad: Float, pad_in_camera_m: Float) -> Float32:
    """Pad coordinates x, y of rays (..., 2) at z = 1; far away where a ray does not come down."""
    pad_from_camera = camera_from_pad.T.astype(np.float32)
    origin = (-camera_from_pad.T @ pad_in_camera_m).astype(np.float32)
    down = pad_from_camera[2, 0] * xy[..., 0] + pad_from_camera[2, 1] * xy[..., 1] + pad_from_camera[2, 2]
    fall = -origin[2] / np.maximum(down, np.float32(1e-3))
    out = np.empty((*xy.shape[:-1], 2), np.float32)
    for axis in range(2):
        along = pad_from_camera[axis, 0] * xy[..., 0] + pad_from_camera[axis, 1] * xy[..., 1] + pad_from_camera[axis, 2]
        out[..., axis] = origin[axis] + fall * along
    return out


def in_ring(x: Float32, y: Float32, ring: Ring) -> NDArray[np.bool_]:
    """Whether points of the pad's plane are on the black of a ring."""
    squared = (x - np.float32(ring.x_m)) ** 2 + (y - np.float32(ring.y_m)) ** 2
    black: NDArray[np.bool_] = (squared <= ring.outer_m**2) & (squared > ring.inner_m**2)
    return black


def in_sheet(x: Float32, y: Float32, sheet: Sheet | tuple[Float32, Float32, Float32, Float32]) -> NDArray[np.bool_]:
    """Whether points of the pad's plane are on a rectangle: least x, least y, greatest x, greatest y."""
    inside: NDArray[np.bool_] = (x >= sheet[0]) & (y >= sheet[1]) & (x <= sheet[2]) & (y <= sheet[3])
    return inside


def box_of(
    sheet: Sheet, camera: Camera, camera_from_pad: Float, pad_in_camera_m: Float, place: tuple[float, float] = (0, 0)
) -> tuple[slice, slice] | None:
    """Rows and columns of the picture that may show a rectangle of the pad's plane, ``place`` beside where it is."""
    x = np.linspace(sheet[0], sheet[2], 9) + place[0]
    y = np.linspace(sheet[1], sheet[3], 9) + place[1]
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    at = np.column_stack((grid, np.zeros(len(grid)))) @ camera_from_pad.T + pad_in_camera_m
    size = np.array((camera.width_px, camera.height_px))
    near = at[:, 2] < 0.05
    ideal = Camera(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    uv = ideal.project(at[~near])
    if not len(uv):
        return None
    low = np.floor(np.nanmin(uv, axis=0)) - 12 if not near.any() else np.zeros(2)
    high = np.ceil(np.nanmax(uv, axis=0)) + 13 if not near.any() else size.astype(float)
    low, high = np.clip(low, 0, size).astype(int), np.clip(high, 0, size).astype(int)
    # Barrel distortion draws everything inwards, by more at the rim than the margin above.
    if near.any() or np.any(low <= 12) or np.any(high >= size - 13):
        low, high = np.zeros(2, int), size
    if np.any(high - low < 4):
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
