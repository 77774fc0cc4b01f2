"""A square kilometre of blocks, what a camera over it sees, and a flight across it, without any code of the search."""

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.ground import intersect_plane
from tests.estimator.registration.textured_map import Window

HALF_M = 450
GROUND_ALT_M = 250.0
CAMERA = Camera.from_hfov(240, 180, np.deg2rad(70.0))
SPEED_M_S, HEIGHT_M = 12.0, 60.0
SEASON_NOISE = 12.0


class WideMap:
    """Blocks of every size, tone and direction, in metre pixels; another noise at each look, as another day has."""

    gsd_m = 1.0
    bounds_ne_m = (-float(HALF_M), -float(HALF_M), float(HALF_M), float(HALF_M))

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        side = 2 * HALF_M + 1
        image = np.full((side, side), 110, dtype=np.uint8)
        for _ in range(1500):
            centre = tuple(int(v) for v in rng.integers(0, side, size=2))
            box = cv2.boxPoints((centre, tuple(rng.uniform(6.0, 40.0, size=2)), float(rng.uniform(0.0, 90.0))))
            cv2.fillConvexPoly(image, box.astype(np.int32), int(rng.integers(30, 225)))
        self.seen = cv2.GaussianBlur(image, (0, 0), 0.7)
        noisy = self.seen + SEASON_NOISE * rng.standard_normal(image.shape)
        self.image = np.clip(noisy, 0.0, 255.0).astype(np.uint8)

    def window(self, north_min_m: float, east_min_m: float, north_max_m: float, east_max_m: float) -> Window:
        north = np.arange(np.ceil(north_max_m), np.floor(north_min_m) - 1.0, -1.0)
        east = np.arange(np.floor(east_min_m), np.ceil(east_max_m) + 1.0)
        rows, cols = (HALF_M - north).astype(int), (east + HALF_M).astype(int)
        valid = ((rows >= 0) & (rows <= 2 * HALF_M))[:, None] & ((cols >= 0) & (cols <= 2 * HALF_M))[None]
        image = self.image[np.clip(rows, 0, 2 * HALF_M)[:, None], np.clip(cols, 0, 2 * HALF_M)[None]]
        return Window(np.where(valid, image, 0).astype(np.uint8), valid, float(north[0]), float(east[0]), 1.0)


class Plain:
    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.full(np.shape(north_m), GROUND_ALT_M)


@dataclass(frozen=True, slots=True)
class Flight:
    """A wide left-hand arc at constant height."""

    start_ne_m: tuple[float, float] = (-150.0, -120.0)
    heading_rad: float = 0.6
    turn_rad_s: float = -0.03

    def heading(self, t_s: float) -> float:
        return self.heading_rad + self.turn_rad_s * t_s

    def pos_ned_m(self, t_s: float) -> np.ndarray:
        radius = SPEED_M_S / self.turn_rad_s
        north = self.start_ne_m[0] + radius * (np.sin(self.heading(t_s)) - np.sin(self.heading_rad))
        east = self.start_ne_m[1] - radius * (np.cos(self.heading(t_s)) - np.cos(self.heading_rad))
        return np.array([north, east, -HEIGHT_M])

    def ned_from_camera(self, t_s: float) -> np.ndarray:
        """Straight down, the top of the picture ahead."""
        return yaw_matrix(self.heading(t_s)) @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

    def picture(self, t_s: float, scene: WideMap) -> np.ndarray:
        uv = np.stack(np.meshgrid(np.arange(CAMERA.width_px), np.arange(CAMERA.height_px)), axis=-1).astype(np.float64)
        rays = (CAMERA.rays(uv) @ self.ned_from_camera(t_s).T).reshape(-1, 3)
        points = intersect_plane(self.pos_ned_m(t_s), rays, 0.0)
        col = (points[:, 1] + HALF_M).reshape(CAMERA.height_px, CAMERA.width_px).astype(np.float32)
        row = (HALF_M - points[:, 0]).reshape(CAMERA.height_px, CAMERA.width_px).astype(np.float32)
        return cv2.remap(scene.seen, col, row, cv2.INTER_CUBIC)


def yaw_matrix(angle_rad: float) -> np.ndarray:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
