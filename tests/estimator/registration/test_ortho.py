import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import matrix_from_euler
from estimator.registration.alignment import CameraPose
from estimator.registration.ortho import Ground, map_area, rectify
from tests.estimator.registration.textured_map import CAMERA, MAP, NADIR_TOP_NORTH, ORIGIN_ALT_M, FlatGround, seen_by

POSE = CameraPose(np.array([20.0, -30.0, -90.0]), matrix_from_euler(0.1, -0.2, 1.0) @ NADIR_TOP_NORTH)
GROUND = Ground(FlatGround(), ORIGIN_ALT_M, POSE.pos_ned_m[:2], 100.0)


class HalfKnown:
    """South of the origin the ground is 260 m high, north of it nobody knows."""

    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.where(np.asarray(north_m) + 0.0 * np.asarray(east_m) > 0.0, np.nan, 260.0)


def test_a_rectified_picture_shows_the_map_under_its_points() -> None:
    ortho = rectify(seen_by(POSE.pos_ned_m, POSE.ned_from_camera), CAMERA, POSE, GROUND, 1.0, 300, 1.2)

    assert ortho is not None
    ne = ortho.points_ned_m[..., :2]
    there = MAP.at(ne[..., 0], ne[..., 1]).astype(float)
    difference = np.abs(ortho.image.astype(float) - there)[ortho.mask]
    # averaging to a metre blurs the blocks' edges
    assert np.median(difference) < 3.0
    assert_allclose(np.diff(ne[:, 0, 0]), -1.0)
    assert_allclose(ne[0, 0], ortho.corner_ne_m)


@pytest.mark.parametrize("gsd_m", [1.0, 1.7, 3.0])
def test_a_coarser_map_lies_where_the_fine_one_does(gsd_m: float) -> None:
    area = map_area(MAP, np.array([10.0, -15.0]), np.array([80.0, 60.0]), gsd_m)

    assert area is not None
    rows, cols = np.mgrid[4 : area.image.shape[0] - 4, 4 : area.image.shape[1] - 4]
    north, east = area.corner_ne_m[0] - rows * area.gsd_m, area.corner_ne_m[1] + cols * area.gsd_m
    there = MAP.at(north, east).astype(float)
    inside = area.image[4:-4, 4:-4].astype(float)
    shifted = MAP.at(north + area.gsd_m, east).astype(float)
    assert np.abs(inside - there).mean() < 0.6 * np.abs(inside - shifted).mean()


def test_holes_in_the_ground_are_filled_and_no_ground_at_all_is_an_error() -> None:
    ground = Ground(HalfKnown(), 250.0, np.zeros(2), 100.0)

    assert_allclose(ground.down_m(np.array([-50.0, 50.0]), np.zeros(2)), [-10.0, -10.0])
    with pytest.raises(ValueError, match="unknown all over"):
        Ground(HalfKnown(), 250.0, np.array([500.0, 0.0]), 100.0)


def test_a_camera_that_looks_at_the_sky_has_no_ortho() -> None:
    up = CameraPose(POSE.pos_ned_m, matrix_from_euler(np.pi, 0.0, 0.0) @ NADIR_TOP_NORTH)

    assert rectify(np.zeros((360, 480), np.uint8), CAMERA, up, GROUND, 1.0, 300, 1.2) is None
