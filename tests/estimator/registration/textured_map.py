"""A textured map known at any point, and what a camera over it sees: no code of the registration takes part."""

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.ground import intersect_plane

ORIGIN_ALT_M = 250.0
CAMERA = Camera(480, 360, 400.0, 402.0, 236.0, 183.0, (-0.18, 0.06, 0.001, -0.0008, -0.008))
NADIR_TOP_NORTH = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    image: np.ndarray
    valid: np.ndarray
    north_max_m: float
    east_min_m: float
    gsd_m: float


class PaintedMap:
    """A square of 400 m about the origin in metre pixels, from a picture (1601, 1601) of quarter metres."""

    gsd_m = 1.0
    bounds_ne_m = (-200.0, -200.0, 200.0, 200.0)

    def __init__(self, fine: np.ndarray) -> None:
        self._fine = cv2.GaussianBlur(fine, (0, 0), 2.0)
        coarse = cv2.GaussianBlur(self._fine, (0, 0), 1.6)
        self.image = coarse[::4, ::4]

    def at(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        col, row = (east_m + 200.0) * 4.0, (200.0 - north_m) * 4.0
        return cv2.remap(self._fine, col.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR)

    def window(self, north_min_m: float, east_min_m: float, north_max_m: float, east_max_m: float) -> Window:
        north = np.arange(np.ceil(north_max_m), np.floor(north_min_m) - 1.0, -1.0)
        east = np.arange(np.floor(east_min_m), np.ceil(east_max_m) + 1.0)
        rows, cols = (200.0 - north).astype(int), (east + 200.0).astype(int)
        valid = ((rows >= 0) & (rows <= 400))[:, None] & ((cols >= 0) & (cols <= 400))[None]
        image = self.image[np.clip(rows, 0, 400)[:, None], np.clip(cols, 0, 400)[None]]
        return Window(np.where(valid, image, 0).astype(np.uint8), valid, float(north[0]), float(east[0]), 1.0)


class TexturedMap(PaintedMap):
    """Blocks of every size, tone and direction."""

    def __init__(self, seed: int = 5) -> None:
        rng = np.random.default_rng(seed)
        fine = np.full((1601, 1601), 110, dtype=np.uint8)
        for _ in range(900):
            centre = tuple(int(v) for v in rng.integers(0, 1601, size=2))
            box = cv2.boxPoints((centre, tuple(rng.uniform(20.0, 130.0, size=2)), float(rng.uniform(0.0, 90.0))))
            cv2.fillConvexPoly(fine, box.astype(np.int32), int(rng.integers(30, 225)))
        super().__init__(fine)


def straight_road(bearing_rad: float, through_ne_m: tuple[float, float]) -> PaintedMap:
    """Level fields with nothing on them but one road, seven metres wide."""
    fine = np.full((1601, 1601), 90, dtype=np.uint8)
    north, east = 1500.0 * np.cos(bearing_rad), 1500.0 * np.sin(bearing_rad)
    col, row = (through_ne_m[1] + 200.0) * 4.0, (200.0 - through_ne_m[0]) * 4.0
    cv2.line(fine, (round(col - east), round(row + north)), (round(col + east), round(row - north)), 200, 28)
    return PaintedMap(fine)


class FlatGround:
    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.full(np.shape(north_m), ORIGIN_ALT_M)


MAP = TexturedMap()


def seen_by(
    pos_ned_m: np.ndarray, ned_from_camera: np.ndarray, scene: PaintedMap = MAP, camera: Camera = CAMERA
) -> np.ndarray:
    """What the camera sees, ray by ray through its distortion."""
    uv = np.stack(np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px)), axis=-1).astype(np.float64)
    points = intersect_plane(pos_ned_m, (camera.rays(uv) @ ned_from_camera.T).reshape(-1, 3), 0.0)
    north, east = (points[:, i].reshape(camera.height_px, camera.width_px) for i in (0, 1))
    return scene.at(north, east)
