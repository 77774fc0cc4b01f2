"""What a camera above the world sees: relief and occlusion, lens, light falling off, exposure, noise."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.types import Float, Image
from simulator.random_streams import rng_for
from simulator.sensors.pad_view import PadView
from simulator.world.pad_place import PadPlace
from simulator.world.patch import Float32
from simulator.world.world import RAISED_UNIT_M, World

# Geometry is worked out on every second pixel and interpolated; terrain on every tenth of those.
_STEP_PX = 2
_TERRAIN_STEP = 10
_TERRAIN_ITERATIONS = 4
# Heights at which rays are tested; tall things are wide, so the steps may grow.
_LEVELS_M = np.array([0.3, 0.9, 1.7, 2.7, 3.9, 5.3, 6.9, 8.7, 10.7, 12.9, 15.3, 18.0, 21.0], np.float32)
_FLOOR_M = np.concatenate([[0.0], _LEVELS_M]).astype(np.float32)
_CEILING_M = np.concatenate([[0.0], _LEVELS_M[1:], [25.5]]).astype(np.float32)
_SIDE_M = np.float32(1.2)
_NOISE_FRAMES = 5
_WALL_BRIGHTNESS = 180
_MIN_DOWN = 0.12


class CameraView:
    """Renders pictures (height, width, 3) in blue, green, red for a camera pose in the world's frame."""

    def __init__(
        self, world: World, camera: Camera, seed: int, noise_std: float = 2.4, vignetting: float = 0.28,
        pad: PadPlace | None = None,
    ) -> None:  # fmt: skip
        self.world, self.camera = world, camera
        self._pad = None if pad is None else PadView(pad, camera, seed)
        self._grid = (camera.height_px // _STEP_PX + 2, camera.width_px // _STEP_PX + 2)
        self._rays = self._ray_grid()
        rng = rng_for(seed, "camera")
        size = (camera.height_px, camera.width_px)
        self._shading = _vignette(camera, vignetting)
        coloured = rng.normal(0, noise_std, (_NOISE_FRAMES, size[0] + 32, size[1] + 32, 3))
        self._noise = np.clip(np.round(coloured), -127, 127).astype(np.int8)
        self._rng = rng
        self._gain = 1.0
        self._wander = 0.0
        ground = world.ground_patch
        raised = world.raised_patch
        self._ratio = np.float32(raised.gsd_m / ground.gsd_m)
        # The raised raster's pixels are blocks of the ground's, so their centres are offset.
        self._offset = np.float32((self._ratio - 1) / 2)

    def render(self, pos_ned_m: Float, ned_from_camera: Float) -> Image:
        """The picture from a position (3,) with a rotation (3, 3); camera axes are right, down, forward."""
        col, row, wall = self._ground_map(pos_ned_m, ned_from_camera)
        sharp = cv2.remap(self.world.ground_bgr, col, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        if self._pad is not None:
            sharp = self._pad.roughen(_image(sharp), col, row, self.world.ground_patch, float(-pos_ned_m[2]))
            self._pad.draw(sharp, pos_ned_m, ned_from_camera)
        return self._exposed(_image(sharp), wall)

    def _ray_grid(self) -> Float32:
        """Unit rays (3, rows * cols) on every second pixel with one more around, so that the rim interpolates too."""
        rows, cols = self._grid
        u = (np.arange(cols) - 1) * _STEP_PX + (_STEP_PX - 1) / 2
        v = (np.arange(rows) - 1) * _STEP_PX + (_STEP_PX - 1) / 2
        rays = self.camera.rays(np.stack(np.meshgrid(u, v), axis=-1))
        return np.ascontiguousarray(rays.reshape(-1, 3).T, dtype=np.float32)

    def _ground_map(self, pos_ned_m: Float, ned_from_camera: Float) -> tuple[Float32, Float32, Image | None]:
        """Column and row on the ground raster of every pixel, and where walls show."""
        rays = (ned_from_camera.astype(np.float32) @ self._rays).reshape(3, *self._grid)
        # Rays near or above the horizon have no ground; they are bent down, which smears them into the distance.
        down = np.maximum(rays[2], np.float32(_MIN_DOWN))
        patch = self.world.raised_patch
        col_per_m = cv2.divide(rays[1], down, scale=1 / patch.gsd_m)
        row_per_m = cv2.divide(rays[0], down, scale=-1 / patch.gsd_m)
        col_0 = (pos_ned_m[1] - patch.east_min_m) / patch.gsd_m
        row_0 = (patch.north_max_m - pos_ned_m[0]) / patch.gsd_m
        fall = self._fall(float(pos_ned_m[2]), (row_0, col_0), (_float32(row_per_m), _float32(col_per_m)))
        col = _float32(cv2.add(cv2.multiply(col_per_m, fall), col_0))
        row = _float32(cv2.add(cv2.multiply(row_per_m, fall), row_0))
        ground_m = np.float32(-pos_ned_m[2]) - fall
        wall = self._climb(col, row, (_float32(row_per_m), _float32(col_per_m)), ground_m, float(fall.min()))
        # Onto the finer raster of colours, whose pixel centres are offset.
        return (
            self._upsampled(col * self._ratio + self._offset),
            self._upsampled(row * self._ratio + self._offset),
            wall,
        )

    def _fall(self, down_m: float, origin: tuple[float, float], per_m: tuple[Float32, Float32]) -> Float32:
        """Height of the camera above the terrain where each ray comes down; fixed-point steps on a thinned grid."""
        rows, cols = self._grid
        thin_rows, thin_cols = rows // _TERRAIN_STEP + 1, cols // _TERRAIN_STEP + 1
        at = np.ix_(
            np.round(np.linspace(0, rows - 1, thin_rows)).astype(int),
            np.round(np.linspace(0, cols - 1, thin_cols)).astype(int),
        )
        row_per_m, col_per_m = per_m[0][at], per_m[1][at]
        row_0, col_0 = np.float32(origin[0]), np.float32(origin[1])
        fall = np.full((thin_rows, thin_cols), -down_m, np.float32)
        for _ in range(_TERRAIN_ITERATIONS):
            fall = np.float32(-down_m) - self._terrain_m(row_0 + row_per_m * fall, col_0 + col_per_m * fall)
        # Corner-aligned interpolation back to the half-resolution grid.
        affine = np.array([[(thin_cols - 1) / (cols - 1), 0.0, 0.0], [0.0, (thin_rows - 1) / (rows - 1), 0.0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return _float32(cv2.warpAffine(fall, affine, (cols, rows), flags=flags, borderMode=cv2.BORDER_REPLICATE))

    def _terrain_m(self, row: Float32, col: Float32) -> Float32:
        """Terrain height at positions on the raster of raised things."""
        raised, terrain = self.world.raised_patch, self.world.terrain.patch
        scale = np.float32(raised.gsd_m / terrain.gsd_m)
        row_shift = np.float32((terrain.north_max_m - raised.north_max_m) / terrain.gsd_m)
        col_shift = np.float32((raised.east_min_m - terrain.east_min_m) / terrain.gsd_m)
        height = cv2.remap(
            self.world.terrain.height_m,
            col * scale + col_shift,
            row * scale + row_shift,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return _float32(height)

    def _climb(
        self, col: Float32, row: Float32, per_m: tuple[Float32, Float32], ground_m: Float32, lowest_fall_m: float
    ) -> Image | None:
        """Move map positions, in place, from the ground up to the first raised thing that each ray meets."""
        row_per_m, col_per_m = per_m
        top_m = min(self._tallest_m(col, row), lowest_fall_m - 1.0)
        levels = _LEVELS_M[top_m > _LEVELS_M]
        if not len(levels):
            return None
        met = np.zeros(col.shape, np.uint8)
        col_there, row_there = np.empty_like(col), np.empty_like(row)
        for number, level in enumerate(levels.tolist(), start=1):
            cv2.scaleAdd(col_per_m, -level, col, dst=col_there)
            cv2.scaleAdd(row_per_m, -level, row, dst=row_there)
            there = cv2.remap(self.world.raised, col_there, row_there, cv2.INTER_NEAREST)
            # Going up, the last level that is hit is the first one that the ray coming down meets.
            np.copyto(met, np.uint8(number), where=there >= level / RAISED_UNIT_M)
        met_m = _FLOOR_M[met]
        surface = cv2.remap(
            self.world.raised, col - col_per_m * met_m, row - row_per_m * met_m, cv2.INTER_LINEAR
        ).astype(np.float32)
        surface *= np.float32(RAISED_UNIT_M)
        ceiling_m = _CEILING_M[met]
        seen_m = np.minimum(np.maximum(surface, met_m), ceiling_m)
        col -= col_per_m * seen_m
        row -= row_per_m * seen_m
        # What was met stands on other ground than where the ray would have come down.
        rise_m = self._terrain_m(row, col) - ground_m
        col -= col_per_m * rise_m
        row -= row_per_m * rise_m
        # Well below the top of what it hit, a ray sees the side of it.
        side = (surface > ceiling_m + _SIDE_M) & (met > 0)
        return np.where(side, np.uint8(_WALL_BRIGHTNESS), np.uint8(255)) if side.any() else None

    def _tallest_m(self, col: Float32, row: Float32) -> float:
        """The tallest thing around the picture's footprint."""
        raised = self.world.raised
        rim = np.concatenate([np.stack([row[i], col[i]]) for i in (0, -1)], axis=1)
        rim = np.concatenate([rim, *(np.stack([row[:, i], col[:, i]]) for i in (0, -1))], axis=1)
        low = np.clip(rim.min(axis=1), 0, np.array(raised.shape) - 1).astype(int)
        high = np.clip(rim.max(axis=1), 0, np.array(raised.shape) - 1).astype(int)
        return float(raised[low[0] : high[0] + 1 : 2, low[1] : high[1] + 1 : 2].max()) * RAISED_UNIT_M

    def _upsampled(self, half: Float32) -> Float32:
        full = cv2.resize(half, None, fx=_STEP_PX, fy=_STEP_PX, interpolation=cv2.INTER_LINEAR)
        return _float32(full[_STEP_PX:-_STEP_PX, _STEP_PX:-_STEP_PX])

    def _exposed(self, sharp: Image, wall: Image | None) -> Image:
        # Exposure follows the mean brightness with a lag and wanders a little, as automatic exposure does.
        brightness = float(sharp[8::16, 8::16, 1].mean())
        wanted = min(max(112.0 / max(brightness, 1.0), 0.75), 1.35) ** 0.7
        self._gain += 0.04 * (wanted - self._gain)
        self._wander = 0.99 * self._wander + 0.004 * float(self._rng.standard_normal())
        shading = self._shading
        if wall is not None:
            inner = cv2.resize(wall, None, fx=_STEP_PX, fy=_STEP_PX, interpolation=cv2.INTER_NEAREST)
            inner = inner[_STEP_PX:-_STEP_PX, _STEP_PX:-_STEP_PX]
            shading = _image(cv2.multiply(shading, cv2.merge([inner, inner, inner]), scale=1 / 255.0))
        lit = cv2.multiply(sharp, shading, scale=self._gain * (1 + self._wander) / 250.0)
        soft = cv2.GaussianBlur(lit, (3, 3), 0.55)
        frame, dy, dx = self._rng.integers((_NOISE_FRAMES, 32, 32))
        height, width = soft.shape[:2]
        noise = self._noise[frame, dy : dy + height, dx : dx + width]
        return _image(cv2.add(soft, noise, dtype=cv2.CV_8U))


def _float32(array: NDArray[Any]) -> Float32:
    """What OpenCV returned, under its real type; no copy."""
    return np.asarray(array, np.float32)


def _image(array: NDArray[Any]) -> Image:
    return np.asarray(array, np.uint8)


def _vignette(camera: Camera, strength: float) -> Image:
    u = np.arange(camera.width_px)[None, :] - camera.cx_px
    v = np.arange(camera.height_px)[:, None] - camera.cy_px
    radius2 = (u**2 + v**2) / (camera.cx_px**2 + camera.cy_px**2)
    fall_off = 250.0 * (1 - strength * radius2 * (0.6 + 0.4 * radius2))
    return np.repeat(np.round(fall_off).astype(np.uint8)[..., None], 3, axis=2)
