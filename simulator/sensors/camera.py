"""What a camera above the world sees: relief and occlusion, lens, light falling off, exposure, noise."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.geometry.camera import Camera
from estimator.types import Float, Image
from simulator.random_streams import rng_for
from simulator.world.patch import Float32
from simulator.world.world import RAISED_UNIT_M, World

# Geometry is worked out on every second pixel and interpolated; terrain on every tenth of those.
_STEP_PX = 2
_TERRAIN_STEP = 10
_TERRAIN_ITERATIONS = 4
_LEVEL_STEP_M = 1.25
_NOISE_FRAMES = 5
_WALL_BRIGHTNESS = 0.72
_MIN_DOWN = 0.12


class CameraView:
    """Renders pictures (height, width, 3) in blue, green, red for a camera pose in the world's frame."""

    def __init__(
        self, world: World, camera: Camera, seed: int, noise_std: float = 2.4, vignetting: float = 0.28
    ) -> None:
        self.world, self.camera = world, camera
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
        return self._exposed(sharp, wall)

    def _ray_grid(self) -> Float32:
        """Unit rays (rows, cols, 3) on every second pixel with one more around, so that the rim interpolates too."""
        width, height = self.camera.width_px // _STEP_PX + 2, self.camera.height_px // _STEP_PX + 2
        u = (np.arange(width) - 1) * _STEP_PX + (_STEP_PX - 1) / 2
        v = (np.arange(height) - 1) * _STEP_PX + (_STEP_PX - 1) / 2
        return self.camera.rays(np.stack(np.meshgrid(u, v), axis=-1)).astype(np.float32)

    def _ground_map(self, pos_ned_m: Float, ned_from_camera: Float) -> tuple[Float32, Float32, Float32 | None]:
        """Column and row on the ground raster of every pixel, and a brightness where walls show."""
        rays = self._rays @ ned_from_camera.T.astype(np.float32)
        # Rays near or above the horizon have no ground; they are bent down, which smears them into the distance.
        down = np.maximum(rays[..., 2], np.float32(_MIN_DOWN))
        north_per_m, east_per_m = rays[..., 0] / down, rays[..., 1] / down
        height = self._terrain_below(pos_ned_m, north_per_m, east_per_m)
        fall = np.float32(-pos_ned_m[2]) - height
        patch = self.world.raised_patch
        gsd = np.float32(patch.gsd_m)
        col_per_m, row_per_m = east_per_m / gsd, -north_per_m / gsd
        col = np.float32((pos_ned_m[1] - patch.east_min_m) / patch.gsd_m) + col_per_m * fall
        row = np.float32((patch.north_max_m - pos_ned_m[0]) / patch.gsd_m) + row_per_m * fall
        wall = self._climb(col, row, col_per_m, row_per_m, float(fall.min()))
        full_col = self._upsampled(col * self._ratio + self._offset)
        full_row = self._upsampled(row * self._ratio + self._offset)
        return full_col, full_row, wall

    def _terrain_below(self, pos_ned_m: Float, north_per_m: Float32, east_per_m: Float32) -> Float32:
        """Terrain height where each ray comes down, by fixed-point iteration on a thinned grid."""
        rows, cols = north_per_m.shape
        row_at = np.linspace(0, rows - 1, rows // _TERRAIN_STEP + 1)
        col_at = np.linspace(0, cols - 1, cols // _TERRAIN_STEP + 1)
        thin = np.ix_(np.round(row_at).astype(int), np.round(col_at).astype(int))
        north_thin, east_thin = north_per_m[thin], east_per_m[thin]
        height = np.zeros(north_thin.shape)
        for _ in range(_TERRAIN_ITERATIONS):
            fall = -pos_ned_m[2] - height
            height = self.world.terrain.at(pos_ned_m[0] + north_thin * fall, pos_ned_m[1] + east_thin * fall)
        # Corner-aligned interpolation back to the half-resolution grid.
        scale_r, scale_c = (len(row_at) - 1) / (rows - 1), (len(col_at) - 1) / (cols - 1)
        affine = np.array([[scale_c, 0.0, 0.0], [0.0, scale_r, 0.0]])
        smooth: Float32 = cv2.warpAffine(
            height.astype(np.float32),
            affine,
            (cols, rows),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return smooth

    def _climb(
        self, col: Float32, row: Float32, col_per_m: Float32, row_per_m: Float32, lowest_fall_m: float
    ) -> Float32 | None:
        """Move map positions, in place, from the ground up to the first raised thing that each ray meets."""
        raised = self.world.raised
        reach = 3
        r0, r1 = (int(np.clip(f(row), 0, raised.shape[0] - 1)) for f in (np.min, np.max))
        c0, c1 = (int(np.clip(f(col), 0, raised.shape[1] - 1)) for f in (np.min, np.max))
        around = raised[max(r0 - reach, 0) : r1 + reach : 2, max(c0 - reach, 0) : c1 + reach : 2]
        top_m = min(float(around.max(initial=0)) * RAISED_UNIT_M, lowest_fall_m - 1.0)
        if top_m < 0.3:
            return None
        met_m = np.zeros_like(col)
        levels = np.arange(0.3, top_m, _LEVEL_STEP_M, dtype=np.float32)
        for level in levels:
            there = cv2.remap(raised, col - col_per_m * level, row - row_per_m * level, cv2.INTER_NEAREST)
            # Going up, the last level that is hit is the first one that the ray coming down meets.
            cv2.max(met_m, (there >= level / RAISED_UNIT_M).astype(np.float32) * level, dst=met_m)
        hit = met_m > 0
        surface = cv2.remap(raised, col - col_per_m * met_m, row - row_per_m * met_m, cv2.INTER_LINEAR)
        surface_m = surface.astype(np.float32) * np.float32(RAISED_UNIT_M)
        seen_m = np.where(hit, np.clip(surface_m, met_m, met_m + np.float32(_LEVEL_STEP_M)), np.float32(0))
        col -= col_per_m * seen_m
        row -= row_per_m * seen_m
        # Well below the top of what it hit, a ray sees the side of it.
        side = hit & (surface_m > met_m + np.float32(2 * _LEVEL_STEP_M))
        return np.where(side, np.float32(_WALL_BRIGHTNESS), np.float32(1.0))

    def _upsampled(self, half: Float32) -> Float32:
        full = cv2.resize(half, None, fx=_STEP_PX, fy=_STEP_PX, interpolation=cv2.INTER_LINEAR)
        return np.ascontiguousarray(full[_STEP_PX:-_STEP_PX, _STEP_PX:-_STEP_PX])

    def _exposed(self, sharp: Image, wall: Float32 | None) -> Image:
        # Exposure follows the mean brightness with a lag and wanders a little, as automatic exposure does.
        brightness = float(cv2.mean(cv2.resize(sharp, (40, 30), interpolation=cv2.INTER_NEAREST))[1])
        wanted = np.clip(112.0 / max(brightness, 1.0), 0.75, 1.35) ** 0.7
        self._gain += 0.04 * (wanted - self._gain)
        self._wander = 0.99 * self._wander + 0.004 * float(self._rng.standard_normal())
        shading = self._shading
        if wall is not None:
            factor = self._upsampled(wall)
            shading = (shading * factor[..., None]).astype(np.uint8)
        lit = cv2.multiply(sharp, shading, scale=self._gain * (1 + self._wander) / 250.0)
        soft = cv2.GaussianBlur(lit, (3, 3), 0.55)
        frame, dy, dx = self._rng.integers((_NOISE_FRAMES, 32, 32))
        height, width = soft.shape[:2]
        noise = self._noise[frame, dy : dy + height, dx : dx + width]
        out: Image = cv2.add(soft, noise, dtype=cv2.CV_8U)
        return out


def _vignette(camera: Camera, strength: float) -> Image:
    u = np.arange(camera.width_px)[None, :] - camera.cx_px
    v = np.arange(camera.height_px)[:, None] - camera.cy_px
    radius2 = (u**2 + v**2) / (camera.cx_px**2 + camera.cy_px**2)
    fall_off = 250.0 * (1 - strength * radius2 * (0.6 + 0.4 * radius2))
    return np.repeat(np.round(fall_off).astype(np.uint8)[..., None], 3, axis=2)
