"""Laying a located picture on a painted map, and carrying its pixels there."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_euler, matrix_from_q, q_from_rotvec
from estimator.registration.alignment import CameraPose, NoMatch
from estimator.registration.calibration import calibration_of
from estimator.registration.placement import (
    KEYPOINTS,
    WHOLE,
    WINDOWS,
    Placement,
    PlacementConfig,
    by_centre,
    place,
    place_by_keypoints,
)
from estimator.targets.registered import TargetErrors, locate_registered
from tests.estimator.registration.textured_map import (
    CAMERA,
    MAP,
    NADIR_TOP_NORTH,
    ORIGIN_ALT_M,
    FlatGround,
    TexturedMap,
    seen_by,
)

TRUE_POS = np.array([20.0, -25.0, -95.0])
TRUE_ROTATION = matrix_from_euler(0.12, -0.15, 0.9) @ NADIR_TOP_NORTH
POSE_COV = np.diag([9.0, 9.0, 9.0, 0.02**2, 0.02**2, 0.03**2])
FRAME = LocalFrame(0.8, 0.15, ORIGIN_ALT_M)


def _disturbed(error: np.ndarray) -> CameraPose:
    turn = matrix_from_q(q_from_rotvec(-error[3:]))
    return CameraPose(TRUE_POS - error[:3], turn @ TRUE_ROTATION)


def _place(error: np.ndarray, scene: TexturedMap = MAP, **config: float) -> Placement | NoMatch:
    picture = seen_by(TRUE_POS, TRUE_ROTATION, scene)
    prior_cov = POSE_COV + np.diag([20.0**2, 20.0**2, 0.0, 0.0, 0.0, 0.0])
    return place(
        picture, CAMERA, scene, FlatGround(), ORIGIN_ALT_M, _disturbed(error), POSE_COV, prior_cov,
        PlacementConfig(**config),
    )  # fmt: skip


def _opencv_pixel(point: np.ndarray) -> tuple[float, float]:
    camera_from_ned = TRUE_ROTATION.T
    uv = cv2.projectPoints(
        point.reshape(1, 1, 3), cv2.Rodrigues(camera_from_ned)[0], -camera_from_ned @ TRUE_POS, CAMERA.matrix,
        np.array(CAMERA.distortion),
    )[0]  # fmt: skip
    return float(uv[0, 0, 0]), float(uv[0, 0, 1])


def _misses(placed: Placement) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, 2) in metres and squared by their covariances (n,) of places across the picture."""
    middle = TRUE_POS - TRUE_ROTATION[:, 2] * TRUE_POS[2] / TRUE_ROTATION[2, 2]
    errors, nees = [], []
    for aside in ((0.0, 0.0), (30.0, 20.0), (-25.0, 28.0), (-20.0, -30.0)):
        point = np.array([middle[0] + aside[0], middle[1] + aside[1], 0.0])
        found = locate_registered(placed, CAMERA, _opencv_pixel(point), FlatGround(), FRAME, TargetErrors(0.5, 0.0))
        d = (found.pos_ned_m - point)[:2]
        errors.append(d)
        nees.append(d @ np.linalg.solve(found.cov_on_map_ned_m2[:2, :2], d))
    return np.array(errors), np.array(nees)


@pytest.mark.parametrize("error", [
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (4.0, -3.0, 0.0, 0.0, 0.0, 0.0), (-2.0, 1.5, 2.0, 0.01, -0.015, 0.03),
])  # fmt: skip
@pytest.mark.parametrize(("by", "min_agreement"), [(WINDOWS, 0.4), (WHOLE, 2.0)])
def test_pixels_of_a_pose_that_is_metres_off_come_to_their_place(
    error: tuple[float, ...], by: str, min_agreement: float
) -> None:
    placed = _place(np.array(error), min_agreement=min_agreement)

    assert isinstance(placed, Placement)
    assert placed.by == by
    misses, nees = _misses(placed)
    # a map pixel is a metre; without windows a tilt of 0.02 rad stays in, 40 m from the middle
    assert np.hypot(*misses.T).max() < (1.0 if by == WINDOWS else 3.0)
    assert nees.max() < 9.2  # 99 %


def test_the_maps_own_error_is_what_the_calibration_or_the_caller_says() -> None:
    stated, told = _place(np.zeros(6)), _place(np.zeros(6), map_std_m=0.1)
    calibrated = calibration_of("double_angle").likelihood

    assert isinstance(stated, Placement) and isinstance(told, Placement)
    assert stated.map_std_m == pytest.approx(np.hypot(calibrated.map_std_m, calibrated.map_std_px), rel=1e-3)
    assert_allclose((stated.cov - told.cov)[:2, :2], np.eye(2) * (stated.map_std_m**2 - 0.1**2), atol=1e-9)


def test_a_whole_picture_seen_aslant_lies_as_unsurely_as_what_stands_on_the_ground_is_high() -> None:
    """Ten metres of canopy lean by the tangent of the camera's angle off the vertical, along it and not across."""
    flat, wooded = (_place(np.zeros(6), min_agreement=2.0, surface_std_m=height_m) for height_m in (0.0, 10.0))

    assert isinstance(flat, Placement) and isinstance(wooded, Placement)
    axis = TRUE_ROTATION[:, 2]
    lean_ne_m = 10.0 * axis[:2] / axis[2]
    assert np.hypot(*lean_ne_m) > 1.5
    assert_allclose((wooded.cov - flat.cov)[:2, :2], np.outer(lean_ne_m, lean_ne_m), atol=1e-9)


def test_a_wider_search_makes_a_weak_picture_no_less_sure_of_its_place() -> None:
    there, elsewhere = (seen_by(TRUE_POS, TRUE_ROTATION, scene) for scene in (MAP, TexturedMap(9)))
    picture = (0.2 * there + 0.8 * elsewhere).astype(np.uint8)

    def spread_m(hill_share: float, radius_m: float) -> float:
        config = PlacementConfig(min_agreement=2.0, max_sigmas=6.0, radius_m=radius_m, hill_share=hill_share)
        pose = _disturbed(np.zeros(6))
        placed = place(picture, CAMERA, MAP, FlatGround(), ORIGIN_ALT_M, pose, POSE_COV, POSE_COV, config)
        assert isinstance(placed, Placement)
        return float(np.sqrt(np.trace(placed.cov[:2, :2])))

    assert spread_m(0.2, 20.0) == pytest.approx(spread_m(0.2, 10.0), rel=0.02)
    assert spread_m(0.0, 20.0) > 1.2 * spread_m(0.0, 10.0)


def test_without_windows_the_errors_still_fit_their_ellipses() -> None:
    """Errors drawn from the pose's stated covariance, over six maps: squared errors are two on average if exact."""
    rng = np.random.default_rng(3)
    nees = []
    for seed in range(6):
        placed = _place(rng.multivariate_normal(np.zeros(6), POSE_COV), TexturedMap(seed), min_agreement=2.0)
        assert isinstance(placed, Placement)
        nees.append(_misses(placed)[1].mean())
    # the map is exact here and its 1.2 m are stated all the same: below two, and not far above
    assert np.mean(nees) < 2.5


def test_a_pose_error_is_split_about_the_matched_middle() -> None:
    """Against the middle's own motion: the ray through it cut with level ground, before and after."""
    pos, rotation = np.array([3.0, 4.0, -80.0]), matrix_from_euler(0.2, -0.1, 0.4) @ NADIR_TOP_NORTH
    centre = pos + rotation[:, 2] * 80.0 / rotation[2, 2]
    matrix = by_centre(centre, pos)

    for axis in range(6):
        x = np.zeros(6)
        x[axis] = 1e-5
        ray = matrix_from_q(q_from_rotvec(x[3:])) @ rotation[:, 2]
        there = pos + x[:3]
        seen = there - ray * there[2] / ray[2]
        assert_allclose((seen - centre)[:2] / 1e-5, matrix[:2, axis], atol=2e-3)
    assert matrix[2] @ np.array([0, 0, 8.0, 0, 0, 0]) == pytest.approx(-0.1)


def test_keypoints_carry_pixels_as_surely_as_their_pose_is_known() -> None:
    rng = np.random.default_rng(8)
    # a pose of keypoints: position and tilt pull against each other, the ground seen stays
    sloping = by_centre(TRUE_POS - TRUE_ROTATION[:, 2] * TRUE_POS[2] / TRUE_ROTATION[2, 2], TRUE_POS)
    back = np.linalg.inv(sloping)
    cov_pose = back @ np.diag([0.3**2, 0.3**2, 0.01**2, 0.01**2, 0.01**2, 0.008**2]) @ back.T
    nees = []
    for _ in range(60):
        pose = _disturbed(rng.multivariate_normal(np.zeros(6), cov_pose))
        placed = place_by_keypoints(FlatGround(), ORIGIN_ALT_M, pose, cov_pose, PlacementConfig(map_std_m=0.01))
        assert isinstance(placed, Placement) and placed.by == KEYPOINTS
        nees.append(_misses(placed)[1].mean())

    # two in the mean; 60 draws of four places that err alike are good to about 0.25, less the click's stated half pixel
    assert np.mean(nees) == pytest.approx(2.0, abs=0.6)


def test_a_match_that_contradicts_a_sure_pose_is_none() -> None:
    picture = seen_by(TRUE_POS, TRUE_ROTATION)
    away = CameraPose(TRUE_POS + np.array([8.0, -6.0, 0.0]), TRUE_ROTATION)
    sure = POSE_COV * 0.01

    found = place(picture, CAMERA, MAP, FlatGround(), ORIGIN_ALT_M, away, sure, POSE_COV + np.eye(6))

    assert isinstance(found, NoMatch)
    assert "contradicts the place of the photo" in found.reason or "edge of the search" in found.reason


def test_a_picture_of_something_else_is_no_placement() -> None:
    elsewhere = seen_by(TRUE_POS, TRUE_ROTATION, TexturedMap(77))

    found = place(
        elsewhere, CAMERA, MAP, FlatGround(), ORIGIN_ALT_M, CameraPose(TRUE_POS, TRUE_ROTATION), POSE_COV, POSE_COV
    )

    assert isinstance(found, NoMatch)


def test_a_pose_beyond_the_search_is_no_placement() -> None:
    off_map = CameraPose(TRUE_POS + np.array([2000.0, 0.0, 0.0]), TRUE_ROTATION)
    picture = seen_by(TRUE_POS, TRUE_ROTATION)

    found = place(picture, CAMERA, MAP, FlatGround(), ORIGIN_ALT_M, off_map, POSE_COV, POSE_COV)

    assert isinstance(found, NoMatch)
