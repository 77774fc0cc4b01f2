"""Rendered pictures against OpenCV's own projection."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from estimator.geometry.camera import Camera, Mount
from estimator.geometry.rotation import matrix_from_euler
from estimator.types import Float, Image
from simulator.sensors.camera import CameraView
from simulator.world.patch import Patch
from simulator.world.reference import ReferenceRaster
from simulator.world.terrain import Terrain
from simulator.world.world import World, WorldSpec

CAMERA = Camera(640, 480, 554.3, 554.3, 319.5, 239.5, (-0.12, 0.05, 0.0008, -0.0006, 0.0))
GROUND = Patch(150.0 - 0.1, -150.0 + 0.1, 1500, 1500, 0.2)
SPOTS = np.array([[0.0, 0.0], [30.0, 45.0], [-42.0, 20.0], [25.0, -50.0], [-30.0, -44.0], [48.0, 4.0]])
# Roofs: centre north, east, height; 12 m square.
ROOFS = np.array([[14.0, 28.0, 9.0], [-18.0, -22.0, 14.0]])


def relief_m(north_m: Float, east_m: Float) -> Float:
    return 8.0 * np.sin(north_m / 45.0) + 0.06 * east_m


@pytest.fixture(scope="module")
def world() -> World:
    """Dark ground with a white disc at every spot and in the middle of every roof; relief of some 20 m."""
    ground = np.full((GROUND.rows, GROUND.cols, 3), 40, np.uint8)
    raised_patch = GROUND.coarser(2)
    raised = np.zeros((raised_patch.rows, raised_patch.cols), np.uint8)
    for north, east in np.vstack([SPOTS, ROOFS[:, :2]]):
        row, col = GROUND.row_col(np.array([north, east]))
        disc = (round(16 * col), round(16 * row))
        cv2.circle(ground, disc, 16 * 6, (230, 230, 230), -1, lineType=cv2.LINE_AA, shift=4)
    for north, east, height in ROOFS:
        rows, cols = raised_patch.box(np.array([[north - 6, east - 6], [north + 6, east + 6]]))
        raised[rows, cols] = round(10 * height)
    posts = Patch(400.0, -400.0, 401, 401, 2.0)
    terrain = Terrain(posts, relief_m(posts.norths_m(), posts.easts_m()).astype(np.float32))
    nothing = ReferenceRaster(np.zeros((1, 1), np.uint8), (1.0, 0.0, 0.0, 0.0, -1.0, 0.0), "EPSG:32633")
    spec = WorldSpec(0)
    return World(spec, spec.frame, ground, GROUND, raised, raised_patch, terrain, nothing, nothing, ())


def projected(points_ned_m: Float, pos_ned_m: Float, ned_from_camera: Float) -> Float:
    """Pixels (n, 2) by cv2.projectPoints."""
    camera_from_ned = ned_from_camera.T
    rotation, _ = cv2.Rodrigues(camera_from_ned)
    shift = -camera_from_ned @ pos_ned_m
    uv, _ = cv2.projectPoints(points_ned_m, rotation, shift, CAMERA.matrix, np.array(CAMERA.distortion))
    return uv.reshape(-1, 2)


def disc_centre(picture: Image, near_px: Float) -> Float:
    u, v = np.round(near_px).astype(int)
    part = picture[v - 14 : v + 15, u - 14 : u + 15, 1].astype(float) - 90.0
    weight = np.clip(part, 0, None)
    assert weight.sum() > 500.0, "no disc where it should be"
    rows, cols = np.mgrid[v - 14 : v + 15, u - 14 : u + 15]
    return np.array([(weight * cols).sum(), (weight * rows).sum()]) / weight.sum()


@pytest.mark.parametrize(
    "attitude_deg", [(0.0, 0.0, 0.0), (8.0, -12.0, 70.0), (-14.0, 6.0, 200.0), (3.0, 15.0, -100.0)]
)
def test_ground_is_seen_where_opencv_projects_it(world: World, attitude_deg: tuple[float, float, float]) -> None:
    ned_from_camera = matrix_from_euler(*np.radians(attitude_deg)) @ Mount().body_from_camera
    pos = np.array([3.0, -5.0, -110.0])
    picture = CameraView(world, CAMERA, seed=1).render(pos, ned_from_camera)
    points = np.column_stack([SPOTS, -relief_m(SPOTS[:, 0], SPOTS[:, 1])])
    uv_px = projected(points, pos, ned_from_camera)
    seen = np.all((uv_px > 20) & (uv_px < (619, 459)), axis=1)
    assert seen.sum() >= 3
    errors = np.array([disc_centre(picture, uv) - uv for uv in uv_px[seen]])
    # A third of a pixel is 7 cm on the ground.
    assert np.abs(errors).max() < 0.35


@pytest.mark.parametrize("offset_ne_m", [(0.0, 0.0), (18.0, -25.0), (-25.0, 12.0)])
def test_roofs_are_displaced_by_their_height(world: World, offset_ne_m: tuple[float, float]) -> None:
    ned_from_camera = matrix_from_euler(0.0, 0.0, 0.4) @ Mount().body_from_camera
    pos = np.array([*offset_ne_m, -115.0])
    picture = CameraView(world, CAMERA, seed=1).render(pos, ned_from_camera)
    points = np.column_stack([ROOFS[:, :2], -relief_m(ROOFS[:, 0], ROOFS[:, 1]) - ROOFS[:, 2]])
    uv_px = projected(points, pos, ned_from_camera)
    checked = 0
    for uv in uv_px:
        if np.all((uv > 20) & (uv < (619, 459))):
            assert np.abs(disc_centre(picture, uv) - uv).max() < 0.8
            checked += 1
    assert checked


def test_same_seed_gives_the_same_picture_and_noise_changes_between_pictures(world: World) -> None:
    ned_from_camera = Mount().body_from_camera
    pos = np.array([0.0, 0.0, -100.0])
    first, second = (CameraView(world, CAMERA, seed=4) for _ in range(2))
    a, b = first.render(pos, ned_from_camera), first.render(pos, ned_from_camera)
    np.testing.assert_array_equal(a, second.render(pos, ned_from_camera))
    difference = a[200:280, 280:360].astype(float) - b[200:280, 280:360]
    assert 1.0 < difference.std() < 8.0


def test_corners_are_darker_than_the_centre(world: World) -> None:
    picture = CameraView(world, CAMERA, seed=1).render(np.array([120.0, 120.0, -60.0]), Mount().body_from_camera)
    grey = picture.mean(axis=2)
    assert grey[:40, :40].mean() < 0.9 * grey[210:270, 290:350].mean()
