"""Drawn pictures whose camera and cars are known."""

import cv2
import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_euler
from estimator.targets.view import ExpectedView, Motion, expected_view
from estimator.types import Float, Image

CAMERA = Camera.from_hfov(640, 480, np.radians(60.0))
DOWN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # camera right is east, picture up is north
RED, BLUE = (40, 40, 190), (170, 60, 30)
GSD_M = 0.1


def _ground(seed: int = 0) -> Image:
    """A raster of ground 240 m wide, a pixel 0.1 m: blotches at several sizes."""
    rng = np.random.default_rng(seed)
    size = 2400
    ground = np.full((size, size), 105.0, np.float32)
    for cells, strength in ((20, 14.0), (120, 12.0), (600, 8.0)):
        blotches = rng.standard_normal((cells, cells)).astype(np.float32)
        ground += strength * cv2.resize(blotches, (size, size), interpolation=cv2.INTER_CUBIC)
    tinted = np.stack((0.85 * ground, ground, 0.95 * ground), axis=-1)
    return np.clip(tinted, 0, 255).astype(np.uint8)


GROUND = _ground()


def _car(raster: Image, ne_m: Float, yaw_rad: float, bgr: tuple[int, int, int]) -> None:
    along = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    across = np.array([-along[1], along[0]])

    def box(front: float, back: float, half: float, colour: tuple[int, int, int]) -> None:
        corners = [
            ne_m + a * along + b * across for a, b in ((front, half), (front, -half), (back, -half), (back, half))
        ]
        pixels = np.array([[c[1] / GSD_M + 1200.0, 1200.0 - c[0] / GSD_M] for c in corners])
        cv2.fillConvexPoly(raster, np.round(pixels * 16).astype(np.int32), colour, cv2.LINE_AA, 4)

    box(2.25, -2.25, 0.9, bgr)
    box(1.1, 0.4, 0.75, (45, 40, 38))
    box(-1.3, -1.8, 0.75, (45, 40, 38))


def draw(pos: Float, rotation: Float, cars: list[tuple[Float, float, tuple[int, int, int]]], noise: int = 0) -> Image:
    """The ground with cars on it as the camera sees it: a plane at down 0."""
    raster = GROUND.copy()
    for ne, yaw, bgr in cars:
        _car(raster, ne, yaw, bgr)
    # raster pixel (c, r) -> NED -> camera -> picture
    to_ned = np.array([[0.0, -GSD_M, 1200 * GSD_M], [GSD_M, 0.0, -1200 * GSD_M], [0.0, 0.0, 0.0]])
    to_ned[:, 2] -= pos
    homography = CAMERA.matrix @ rotation.T @ to_ned
    seen = cv2.warpPerspective(raster, homography, (640, 480), flags=cv2.INTER_AREA)
    rng = np.random.default_rng(noise)
    return np.asarray(np.clip(seen + rng.normal(0.0, 2.5, seen.shape), 0, 255), np.uint8)


def pose_at(
    north: float, east: float, height: float = 90.0, yaw: float = 0.0, tilt: float = 0.0
) -> tuple[Float, Float]:
    """A camera's place (3,) and rotation (3, 3), looking down."""
    return np.array([north, east, -height]), matrix_from_euler(tilt, 0.0, yaw) @ DOWN


def pixel_of(pose: tuple[Float, Float], ne: Float) -> Float:
    """Where the camera sees a place on the ground."""
    return CAMERA.project((np.array([*ne, 0.0]) - pose[0]) @ pose[1])


def view_of(
    pose: tuple[Float, Float],
    ne: Float,
    std_m: float = 2.0,
    motion: Motion | None = None,
    off_m: tuple[float, float] = (0, 0),
) -> ExpectedView:
    """What is expected of a target at ``ne`` (2,) and thought ``off_m`` away from it."""
    place = np.array([ne[0] + off_m[0], ne[1] + off_m[1], 0.0])
    return expected_view(*pose, CAMERA, place, std_m**2 * np.eye(2), motion)


STANDS = Motion(np.zeros(2), 1e-4 * np.eye(2), moving=False)
CAR = np.array([3.0, -2.0])
