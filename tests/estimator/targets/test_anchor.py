"""What the ground says of where a target can be: cars that pass or stand beside it, ground known again."""

import numpy as np

from estimator.targets.anchor import anchored_place
from estimator.targets.search import Look, affine_from_grid, surroundings_of
from estimator.targets.tracker import Lost, Sighting, TargetTracker
from estimator.targets.view import Motion
from estimator.types import Float
from tests.estimator.targets.drawn import CAR, RED, STANDS, draw, pixel_of, pose_at, view_of

STEP_US = 200_000
GREY = (112, 122, 118)


def _parked(bgr: tuple[int, int, int] = RED) -> TargetTracker:
    """A tracker that has seen a parked car for a second."""
    pose = pose_at(0.0, 0.0)
    tracker = TargetTracker.start(draw(*pose, [(CAR, 0.4, bgr)]), pixel_of(pose, CAR), 0, view_of(pose, CAR).px_per_m)
    for k in range(1, 6):
        answer = tracker.update(draw(*pose, [(CAR, 0.4, bgr)], k), k * STEP_US, view_of(pose, CAR, 2.0, STANDS))
        assert isinstance(answer, Sighting)
    return tracker


def _off_m(answer: Sighting, pose: tuple[Float, Float], ne: Float) -> float:
    per_m = np.linalg.inv(view_of(pose, ne).px_per_m)
    return float(np.hypot(*(per_m @ (answer.uv_px - pixel_of(pose, ne)))))


def test_a_parked_car_is_not_left_for_a_twin_that_drives_over_it() -> None:
    tracker, pose = _parked(), pose_at(0.0, 0.0)
    ahead, aside = np.array([np.cos(0.4), np.sin(0.4)]), np.array([-np.sin(0.4), np.cos(0.4)])
    seen = 0
    for k in range(24):
        twin = CAR + 1.3 * aside + 1.6 * (k - 8) * ahead
        cars = [(CAR, 0.4, RED), (twin, 0.4, RED)]
        t_us = (6 + k) * STEP_US
        answer = tracker.update(draw(*pose, cars, k), t_us, view_of(pose, CAR, 2.0, STANDS, (0.8, -0.6)))
        if isinstance(answer, Sighting):
            seen += 1
            assert _off_m(answer, pose, CAR) < 2.2
    assert seen >= 20
    assert isinstance(answer, Sighting)
    assert _off_m(answer, pose, CAR) < 0.3


def test_a_parked_car_that_leaves_the_picture_is_not_seen_in_a_twin_beside_it() -> None:
    tracker = _parked()
    twin = CAR + np.array([3.0, 0.0])
    for k in range(14):
        pose = pose_at(2.0 * k + 20.0, 0.0)
        t_us = (6 + k) * STEP_US
        answer = tracker.update(
            draw(*pose, [(CAR, 0.4, RED), (twin, 0.4, RED)], k), t_us, view_of(pose, CAR, 2.0, STANDS)
        )
        if isinstance(answer, Sighting):
            assert _off_m(answer, pose, CAR) < 1.0
    assert isinstance(answer, Lost)


def test_a_parked_car_of_the_grounds_colour_is_found_again_some_metres_from_where_it_was_expected() -> None:
    tracker = _parked(GREY)
    there = pose_at(0.0, 0.0)
    away = pose_at(-75.0, 0.0)
    for k in range(6, 16):
        tracker.update(draw(*away, [], k), k * STEP_US, view_of(away, CAR, 2.5, STANDS))
    assert tracker.lost
    answers = [
        tracker.update(draw(*there, [(CAR, 0.4, GREY)], k), k * STEP_US, view_of(there, CAR, 2.5, STANDS, (2.5, -3.0)))
        for k in range(16, 21)
    ]
    found = [one for one in answers if isinstance(one, Sighting)]
    assert found
    assert found[0].found_again
    assert all(_off_m(one, there, CAR) < 0.5 for one in found)


def test_a_parked_car_that_sets_off_is_followed() -> None:
    tracker, pose = _parked(), pose_at(0.0, 0.0)
    ne = CAR.copy()
    answer: Sighting | Lost | None = None
    for k in range(20):
        speed = min(0.4 * k, 5.0)
        ne = ne + 0.2 * speed * np.array([np.cos(0.4), np.sin(0.4)])
        motion = STANDS if k < 8 else Motion(speed * np.array([np.cos(0.4), np.sin(0.4)]), np.eye(2), moving=True)
        expected = CAR if k < 8 else ne
        t_us = (6 + k) * STEP_US
        answer = tracker.update(draw(*pose, [(ne, 0.4, RED)], k), t_us, view_of(pose, expected, 2.0, motion))
    assert isinstance(answer, Sighting)
    assert _off_m(answer, pose, ne) < 0.5


def test_a_car_that_drives_does_not_stop_at_once() -> None:
    pose, vel = pose_at(0.0, 0.0), np.array([9.0, 0.0])
    ne = CAR - np.array([14.0, 0.0])
    tracker = TargetTracker.start(
        draw(*pose, [(ne, 0.0, RED)]), pixel_of(pose, ne), 0, view_of(pose, ne).px_per_m, course_rad=0.0
    )
    motion = Motion(vel, np.eye(2), 0.0, 0.1, True)
    for k in range(1, 8):
        ne = ne + 0.2 * vel
        answer = tracker.update(draw(*pose, [(ne, 0.0, RED)], k), k * STEP_US, view_of(pose, ne, 1.5, motion))
        assert isinstance(answer, Sighting)
    # something of the same look stands where it was seen last
    for k in range(8, 11):
        expected = ne + 0.2 * (k - 7) * vel
        answer = tracker.update(draw(*pose, [(ne, 0.0, RED)], k), k * STEP_US, view_of(pose, expected, 2.0, motion))
        assert isinstance(answer, Lost)


def test_ground_is_known_again_where_it_is_and_not_where_it_is_another() -> None:
    pose = pose_at(0.0, 0.0)
    picture = draw(*pose, [(CAR, 0.4, RED)])
    look = Look(picture, affine_from_grid(pixel_of(pose, CAR), view_of(pose, CAR).px_per_m, 0.15), 1.0)
    there = np.array([14.0, -9.0])
    ground = surroundings_of(look, there, 48)
    # other cars in the middle do not matter
    found = anchored_place(look, ground, 30.0, np.zeros(2), 20)
    assert found is not None
    assert np.hypot(*(found - there)) < 2.0
    assert anchored_place(look, ground, 30.0, there + 70.0, 12) is None
