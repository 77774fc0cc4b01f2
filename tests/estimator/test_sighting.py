"""One click by every method over a painted map: who depends on the pose's position, and who says what."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.errors import GeometryError
from estimator.geometry.rotation import matrix_from_q, q_from_matrix, q_from_rotvec
from estimator.registration.alignment import NoMatch
from estimator.registration.placement import Placement
from estimator.sighting import ClickPlaces, Scene, lay_on_map, locate_click
from estimator.types import Mode, NavigationState
from tests.estimator.registration.test_placement import (
    FRAME,
    POSE_COV,
    TRUE_POS,
    TRUE_ROTATION,
    _opencv_pixel,
)
from tests.estimator.registration.textured_map import CAMERA, MAP, FlatGround, seen_by

LEVER = np.array([0.4, -0.2, 0.3])
TARGET = np.array([20.0, -25.0, 0.0])
SCENE = Scene(CAMERA, FlatGround(), FRAME, MAP, 0.5, 0.0)


def _state(error: np.ndarray, ground_bias_m: float = 0.0) -> NavigationState:
    """A vehicle whose camera is ``error`` (6,) from the true one, position and turn."""
    rotation = matrix_from_q(q_from_rotvec(-error[3:])) @ TRUE_ROTATION
    pos = TRUE_POS - error[:3] - LEVER
    lat, lon, alt = FRAME.geodetic_from_ned(pos)
    joint = np.zeros((7, 7))
    joint[:6, :6], joint[6, 6] = POSE_COV, 1.0
    return NavigationState(
        t_us=0, mode=Mode.VISION, process_model="inertial", lat_rad=float(lat), lon_rad=float(lon),
        alt_amsl_m=float(alt), alt_agl_m=95.0, pos_ned_m=pos, vel_ned_m_s=np.zeros(3),
        q_ned_from_body=np.array([1.0, 0.0, 0.0, 0.0]), q_ned_from_camera=q_from_matrix(rotation),
        cov_pos_ned_m2=POSE_COV[:3, :3], cov_vel_ned_m2_s2=np.eye(3), cov_attitude_rad2=POSE_COV[3:, 3:],
        cov_camera_pose=POSE_COV, last_fix_age_s=1.0, lever_ned_m=LEVER, ground_bias_m=ground_bias_m,
        cov_ground_bias=joint[6],
    )  # fmt: skip


def _click(error: np.ndarray, scene: Scene = SCENE) -> tuple[ClickPlaces, Placement | NoMatch]:
    state = _state(error)
    placed = lay_on_map(seen_by(TRUE_POS, TRUE_ROTATION, MAP), state, scene)
    return locate_click(_opencv_pixel(TARGET), state, placed, scene, 1.0, 0), placed


def test_the_registered_place_does_not_follow_an_error_of_the_position() -> None:
    places, placed = _click(np.array([5.0, -4.0, 0.0, 0.0, 0.0, 0.0]))

    assert isinstance(placed, Placement)
    assert places.ray is not None
    assert places.registered is not None
    assert_allclose((places.ray.pos_ned_m - TARGET)[:2], [-5.0, 4.0], atol=0.1)
    assert np.linalg.norm((places.registered.pos_ned_m - TARGET)[:2]) < 0.5
    # the fused is where the surer method has it
    assert np.linalg.norm((places.fused.pos_ned_m - TARGET)[:2]) < 0.7
    assert places.method == "fused"
    fused, registered = (np.trace(each.cov_ned_m2[:2, :2]) for each in (places.fused, places.registered))
    assert fused < 1.1 * registered < 0.1 * np.trace(places.ray.cov_ned_m2[:2, :2])


def test_a_heading_that_is_wrong_by_degrees_is_searched_as_far_as_the_pose_may_be_wrong() -> None:
    error = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.1])
    state = _state(error)
    unsure = POSE_COV.copy()
    unsure[5, 5] = 0.06**2
    picture = seen_by(TRUE_POS, TRUE_ROTATION, MAP)

    placed = lay_on_map(picture, replace(state, cov_camera_pose=unsure), SCENE)

    assert isinstance(placed, Placement)
    assert placed.correction[5] == pytest.approx(0.1, abs=0.03)


def test_without_a_match_the_ray_stands_alone_and_says_why() -> None:
    places, placed = _click(np.zeros(6), replace(SCENE, reference=None))

    assert isinstance(placed, NoMatch)
    assert places.registered is None
    assert places.refusal == "there is no map"
    assert places.method == "ray_terrain"
    assert places.ray is not None
    assert_allclose(places.fused.pos_ned_m, places.ray.pos_ned_m, atol=1e-6)


def test_a_map_offset_is_in_what_is_said_of_the_registered_and_the_fused() -> None:
    plain, _ = _click(np.zeros(6))
    moved, _ = _click(np.zeros(6), replace(SCENE, map_offset_std_m=3.0))

    for place in ("registered", "fused"):
        grown = getattr(moved, place).cov_ned_m2 - getattr(plain, place).cov_ned_m2
        assert_allclose(grown[:2, :2], 9.0 * np.eye(2), atol=1e-9)


def test_a_pixel_outside_the_picture_is_refused() -> None:
    state = _state(np.zeros(6))
    with pytest.raises(GeometryError, match="outside the"):
        locate_click((-5.0, 10.0), state, NoMatch("no picture"), SCENE, 1.0, 0)
