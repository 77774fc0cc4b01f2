import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_allclose

from estimator.geometry.camera import Camera
from estimator.geometry.homography import frame_to_frame_homography, ground_homography, rotation_homography
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from tests.authorities.stored import stored
from tests.estimator.geometry.strategies import vectors

ANSWERS = stored("homography_opencv")
POSES = ANSWERS["poses"]
# The distortion must not matter: homographies live in undistorted pictures.
CAMERA = Camera(
    640,
    480,
    ANSWERS["fx_px"],
    ANSWERS["fy_px"],
    ANSWERS["cx_px"],
    ANSWERS["cy_px"],
    (-0.12, 0.05, 0.0008, -0.0004, -0.01),
)
DOWN = ANSWERS["ground_down_m"]


def _apply(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    mapped = np.column_stack((points, np.ones(len(points)))) @ homography.T
    return mapped[:, :2] / mapped[:, 2:]


def _of_ground(pose: dict[str, Any]) -> np.ndarray:
    return ground_homography(CAMERA, np.array(pose["ned_from_camera"]), np.array(pose["camera_pos_ned_m"]), DOWN)


@pytest.mark.parametrize("pose", POSES)
def test_ground_homography_agrees_with_opencv(pose: dict[str, Any]) -> None:
    homography = _of_ground(pose)

    found = _apply(homography, np.array(ANSWERS["ground_ne_m"]))
    assert_allclose(found, pose["ground_uv_px"], rtol=0.0, atol=1e-9)
    # OpenCV's own matrix comes from corners in float32.
    assert_allclose(homography / homography[2, 2], pose["pixel_from_ground"], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("pose", POSES)
def test_third_component_is_the_depth(pose: dict[str, Any]) -> None:
    ned = np.array((30.0, -20.0, DOWN))
    depth = (np.array(pose["ned_from_camera"]).T @ (ned - pose["camera_pos_ned_m"]))[2]

    assert (_of_ground(pose) @ (30.0, -20.0, 1.0))[2] == pytest.approx(depth)
    assert depth > 0.0


@pytest.mark.parametrize(("first", "second"), list(itertools.permutations(POSES, 2)))
def test_frame_to_frame_agrees_with_opencv(first: dict[str, Any], second: dict[str, Any]) -> None:
    """Where the first picture shows the ground's points, the map leads to where the second shows them."""
    camera_1_from_ned = np.array(first["ned_from_camera"]).T
    camera_2_from_ned = np.array(second["ned_from_camera"]).T
    pos_1, pos_2 = np.array(first["camera_pos_ned_m"]), np.array(second["camera_pos_ned_m"])

    homography = frame_to_frame_homography(
        CAMERA,
        camera_2_from_ned @ camera_1_from_ned.T,
        camera_2_from_ned @ (pos_1 - pos_2),
        camera_1_from_ned @ (0.0, 0.0, 1.0),
        DOWN - pos_1[2],
    )

    found = _apply(homography, np.array(first["ground_uv_px"]))
    assert_allclose(found, second["ground_uv_px"], rtol=0.0, atol=1e-8)


@given(vectors(0.2))
def test_turning_is_the_limit_of_a_far_plane(turn: np.ndarray) -> None:
    second_from_first = matrix_from_q(q_from_rotvec(turn))

    far = frame_to_frame_homography(
        CAMERA, second_from_first, np.array((1.0, 2.0, 3.0)), np.array((0.0, 0.0, 1.0)), 1e12
    )

    assert_allclose(rotation_homography(CAMERA, second_from_first), far, rtol=0.0, atol=1e-6)


@given(vectors(0.2))
def test_turning_camera_moves_pixels_of_rays(turn: np.ndarray) -> None:
    ideal = Camera(640, 480, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
    second_from_first = matrix_from_q(q_from_rotvec(turn))
    uv = np.array([[0.0, 0.0], [320.0, 240.0], [639.0, 100.0]])

    expected = ideal.project(ideal.rays(uv) @ second_from_first.T)
    assert_allclose(_apply(rotation_homography(CAMERA, second_from_first), uv), expected, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("distance_m", [0.0, -3.0, float("nan")])
def test_refuses_a_plane_behind_the_camera(distance_m: float) -> None:
    with pytest.raises(ValueError, match="ahead"):
        frame_to_frame_homography(CAMERA, np.eye(3), np.zeros(3), np.array((0.0, 0.0, 1.0)), distance_m)
