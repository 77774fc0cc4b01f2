"""What differs between two pictures of the same ground, and what is made of it."""

import cv2
import numpy as np
import pytest

from estimator.targets.appearance import Appearance
from estimator.targets.moved import Earlier
from estimator.targets.search import Look, picture_from_grid
from estimator.targets.tracker import Lost, Sighting, TargetTracker
from estimator.targets.view import Motion
from estimator.types import Float
from tests.estimator.targets.drawn import CAR, RED, draw, pixel_of, pose_at, view_of

M_PER_PX = 0.15
SIZE_PX = 30.0
GREY = (98, 112, 106)
OTHER = (80, 70, 150)
SPEED_M_S, STEP_US = 9.0, 200_000
NORTHWARD = Motion(np.array([SPEED_M_S, 0.0]), np.eye(2), 0.0, 0.1, True)


def _look(pose: tuple[Float, Float], ne: Float, cars: list[tuple[Float, float, tuple[int, int, int]]]) -> Look:
    return Look(draw(*pose, cars, round(pose[0][0])), picture_from_grid(view_of(pose, ne), M_PER_PX), 1.0)


def _moved(cars: list[Float], error_m: float, expected: list[Float]) -> list[Float]:
    """Offsets at which a grey car has come or gone, which is at ``cars`` at 0 s and 0.4 s and expected elsewhere."""
    earlier = Earlier()
    earlier.add(0, _look(pose_at(0.0, 0.0), expected[0], [(cars[0], 0.0, GREY)]))
    pose = pose_at(4.0, 1.0)
    believed = (pose[0] + np.array([error_m, -error_m, 0.0]), pose[1])
    picture = draw(*pose, [(cars[1], 0.0, GREY)], 5)
    look = Look(picture, picture_from_grid(view_of(believed, expected[1]), M_PER_PX), 1.0)
    vel_px_s = np.array([0.0, -SPEED_M_S / M_PER_PX])
    return earlier.moved(look, 400_000, vel_px_s, 1000, SIZE_PX, 3)


def test_a_car_that_hardly_differs_from_the_ground_is_known_by_having_moved() -> None:
    start = np.array([2.0, -14.0])
    expected = [np.array([10.0, 3.0]), np.array([10.0 + 0.4 * SPEED_M_S, 3.0])]
    cars = [start, start + np.array([0.4 * SPEED_M_S, 0.0])]
    error_m = 0.5
    found = _moved(cars, error_m, expected)
    # right is east and down south, and the camera is thought to be further north-west than it is
    at = cars[1] + np.array([error_m, -error_m])
    true = np.array([at[1] - expected[1][1], expected[1][0] - at[0]]) / M_PER_PX
    assert 1 <= len(found) <= 3
    assert min(float(np.hypot(*(one - true))) for one in found) < 0.5 * SIZE_PX
    # nothing but where the car is and where it was
    assert max(float(np.hypot(*(one - true))) for one in found) < 1.5 * SIZE_PX


def test_where_nothing_drives_nothing_has_moved_though_the_pose_errs() -> None:
    expected = [np.array([10.0, 3.0]), np.array([10.0 + 0.4 * SPEED_M_S, 3.0])]
    assert _moved([np.array([2.0, -14.0])] * 2, 0.7, expected) == []


def test_a_picture_is_compared_neither_with_the_last_one_nor_with_one_of_long_ago() -> None:
    pose, ne = pose_at(0.0, 0.0), np.array([5.0, 5.0])
    look = _look(pose, ne, [(ne, 0.0, RED)])
    earlier = Earlier()
    earlier.add(0, _look(pose, ne, []))
    for t_us, count in ((200_000, 0), (500_000, 1), (2_000_000, 0)):
        found = earlier.moved(look, t_us, np.zeros(2), 1000, SIZE_PX, 3)
        assert (len(found) > 0) == bool(count)
    earlier.clear()
    assert earlier.moved(look, 500_000, np.zeros(2), 1000, SIZE_PX, 3) == []


@pytest.mark.parametrize("ground", [40, 150])
def test_a_car_that_drove_onto_other_ground_fits_as_well_as_where_it_was_clicked(ground: int) -> None:
    half, size = 45, 30.0

    def patch(grey: int) -> np.ndarray:
        out = np.full((2 * half + 1, 2 * half + 1, 3), grey, np.uint8)
        cv2.rectangle(out, (half - 15, half - 6), (half + 15, half + 6), (90, 90, 95), -1)
        cv2.rectangle(out, (half + 2, half - 5), (half + 7, half + 5), (45, 40, 38), -1)
        cv2.rectangle(out, (half - 11, half - 5), (half - 8, half + 5), (45, 40, 38), -1)
        return np.asarray(cv2.GaussianBlur(out, (0, 0), 0.8), np.uint8)

    inside = np.zeros((2 * half + 1, 2 * half + 1), np.uint8)
    cv2.rectangle(inside, (half - 15, half - 6), (half + 15, half + 6), (1,), -1)
    target = Appearance(patch(190 - ground), size, inside)
    here, template = patch(ground), target.turned(0.0)
    likeness = target.colour.likeness(here, 1.0)
    middle = half - target.half_px
    rimmed, _ = target.fit(here, likeness, template)
    bare, _ = target.fit(here, likeness, template, driven=True)
    assert bare[middle, middle] > 0.65
    assert bare[middle, middle] > rimmed[middle, middle] + 0.3


def test_a_car_of_another_colour_that_comes_the_other_way_is_not_taken_for_one_that_turned_about() -> None:
    pose, ne = pose_at(0.0, 0.0), CAR - np.array([20.0, 0.0])
    tracker = TargetTracker.start(
        draw(*pose, [(ne, 0.0, RED)]), pixel_of(pose, ne), 0, view_of(pose, ne).px_per_m, course_rad=0.0
    )
    t_us = 0
    for k in range(1, 8):
        t_us, ne = k * STEP_US, ne + np.array([SPEED_M_S * 0.2, 0.0])
        answer = tracker.update(draw(*pose, [(ne, 0.0, RED)], k), t_us, view_of(pose, ne, 1.5, NORTHWARD))
        assert isinstance(answer, Sighting)
    t_us += 8_000_000
    expected, other = ne + np.array([8.0 * SPEED_M_S, 0.0]), np.array([40.0, 4.0])
    for k in range(20):
        t_us += STEP_US
        expected, other = expected + np.array([SPEED_M_S * 0.2, 0.0]), other - np.array([SPEED_M_S * 0.2, 0.0])
        pose = pose_at(20.0 - k, 2.0)
        picture = draw(*pose, [(other, np.pi, OTHER)], k)
        assert isinstance(tracker.update(picture, t_us, view_of(pose, expected, 32.0, NORTHWARD)), Lost)
