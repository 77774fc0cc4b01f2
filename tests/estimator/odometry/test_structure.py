"""Heights of followed points: against OpenCV's triangulation, and their derivatives and noise against experiments."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.odometry.structure import FollowedPoints, Structure, StructureConfig, triangulated

FIRST, SECOND = np.array([3.0, -2.0, -100.0]), np.array([17.0, 6.0, -98.5])
POSITIONS = np.stack((FIRST, SECOND))
CONFIG = StructureConfig()
PIXEL_STD_RAD = 5e-4


def _points(count: int, seed: int) -> np.ndarray:
    """Points (n, 3) between the ground and tree tops."""
    rng = np.random.default_rng(seed)
    north, east = rng.uniform(-40.0, 55.0, size=(2, count))
    return np.stack((north, east, -rng.uniform(0.0, 12.0, size=count)), axis=-1)


def _rays(points: np.ndarray, positions: np.ndarray = POSITIONS) -> np.ndarray:
    rays = points - positions[:, None]
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def _structure(rays: np.ndarray, positions: np.ndarray = POSITIONS) -> Structure:
    found = triangulated(rays, positions, PIXEL_STD_RAD, CONFIG)
    assert found is not None
    return found


def test_heights_are_those_of_opencv() -> None:
    points = _points(60, 1)
    rays = _rays(points)
    # OpenCV's cameras look along their third axis: with the axes of NED that is straight down
    first, second = (np.hstack((np.eye(3), -p[:, None])) for p in POSITIONS)
    image = rays[:, :, :2] / rays[:, :, 2:]
    homogeneous = cv2.triangulatePoints(first, second, image[0].T.copy(), image[1].T.copy())
    expected = homogeneous[2] / homogeneous[3]

    found = _structure(rays)

    assert_allclose(found.down_m, expected, atol=1e-6)
    assert_allclose(found.down_m, points[:, 2], atol=1e-6)


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize("axis", range(6))
def test_errors_of_a_pose_move_the_heights_as_stated(camera: int, axis: int) -> None:
    """The heights by disturbed poses, fitted with a mean and a tilt, against the stated derivatives."""
    rays = _rays(_points(80, 2))
    base = _structure(rays)
    moved = []
    for sign in (1.0, -1.0):
        positions, turned = POSITIONS.copy(), rays.copy()
        if axis < 3:
            positions[camera, axis] += sign * 0.01
        else:
            turn = matrix_from_q(q_from_rotvec(sign * 1e-4 * np.eye(3)[axis - 3]))
            turned[camera] = rays[camera] @ turn.T
        moved.append(_structure(turned, positions).down_m)
    change = (moved[0] - moved[1]) / (0.02 if axis < 3 else 2e-4)

    fitted = np.linalg.lstsq(base.by_error, change, rcond=None)[0]

    stated = base.by_pose[:, 6 * camera + axis]
    assert_allclose(fitted, stated, rtol=0.03, atol=0.01 * np.abs(base.by_pose[:, 6 * camera : 6 * camera + 6]).max())


def test_raising_both_cameras_raises_every_point() -> None:
    by_pose = _structure(_rays(_points(50, 3))).by_pose
    assert_allclose(by_pose[:, 2] + by_pose[:, 8], [1.0, 0.0, 0.0], atol=1e-9)


def test_stated_noise_covers_what_noisy_rays_do() -> None:
    """200 draws: the common errors stay within their covariance, which allows for a third of the points only."""
    points = _points(90, 4)
    rng = np.random.default_rng(6)
    squares = []
    for _ in range(200):
        rays = _rays(points)
        rays = rays + rng.normal(0.0, PIXEL_STD_RAD, rays.shape)
        found = _structure(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
        known = np.isfinite(found.down_m)
        common = np.linalg.lstsq(found.by_error[known], found.down_m[known] - points[known, 2], rcond=None)[0]
        squares.append(common @ np.linalg.solve(found.cov, common))
    # three degrees of freedom, and a variance stated three times as large
    assert 0.5 < np.mean(squares) < 3.0


def test_what_each_point_errs_by_is_as_stated() -> None:
    points = _points(90, 4)
    rng = np.random.default_rng(8)
    errors, stated = [], []
    for _ in range(100):
        rays = _rays(points)
        rays = rays + rng.normal(0.0, PIXEL_STD_RAD, rays.shape)
        found = _structure(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
        errors.append(found.down_m - points[:, 2])
        stated.append(found.std_m)
    ratio = np.nanstd(errors, axis=0) / np.nanmean(stated, axis=0)
    assert_allclose(np.median(ratio), 1.0, atol=0.15)
    # towards the rim of a picture the same angle is more of a slope
    assert ratio.min() > 0.7
    assert ratio.max() < 1.7


def test_points_without_parallax_or_unseen_have_no_height() -> None:
    points = _points(60, 7)
    rays = _rays(points)
    rays[1, 3] = rays[0, 3]
    rays[0, 5] = np.nan
    rays[1, 8] = [1.0, 0.0, 0.05]

    down_m = _structure(rays).down_m

    assert np.isnan(down_m[[3, 5, 8]]).all()
    assert np.isfinite(down_m).sum() == 57


def test_a_track_that_went_astray_has_no_height() -> None:
    points = _points(60, 8)
    seen = points.copy()
    seen[10, 0] += 25.0
    rays = np.stack((_rays(points)[0], _rays(seen)[1]))
    assert np.isnan(_structure(rays).down_m[10])


def test_no_structure_of_few_points_or_of_a_hover() -> None:
    assert triangulated(_rays(_points(CONFIG.min_points - 1, 9)), POSITIONS, PIXEL_STD_RAD, CONFIG) is None
    hover = np.stack((FIRST, FIRST + 0.2))
    assert triangulated(_rays(_points(60, 9), hover), hover, PIXEL_STD_RAD, CONFIG) is None


def test_what_is_known_stays_with_its_corner() -> None:
    points = FollowedPoints()
    structure = Structure(
        np.array([1.0, 2.0, np.nan, 4.0]), np.array([0.1, 0.2, np.nan, 0.4]), np.eye(4, 3), np.zeros((3, 12)), np.eye(3)
    )
    points.take(np.arange(8.0).reshape(4, 2), structure)

    points.follow(np.array([1, 3]), 5)

    assert_allclose(points.down_m, [2.0, 4.0, np.nan, np.nan, np.nan])
    assert_allclose(points.keyframe_uv_px[:2], [[2.0, 3.0], [6.0, 7.0]])
    assert np.isnan(points.keyframe_uv_px[2:]).all()
    known, heights = points.heights(2, np.array([0.5, 10.0, 0.0]), min_points=2)
    assert heights is not None
    assert known.all()
    # the second corner was the fourth, whose row of the errors is zero
    assert_allclose(heights.down_m, [12.0, 4.0])
    assert_allclose(heights.std_m, [0.2, 0.4])


def test_all_points_are_used_where_too_few_have_a_height() -> None:
    points = FollowedPoints()
    points.take(np.zeros((4, 2)), None)
    used, heights = points.heights(4, np.zeros(3), min_points=1)
    assert heights is None
    assert used.all()
