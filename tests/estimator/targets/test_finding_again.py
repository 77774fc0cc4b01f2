"""A driving car that comes back slower or the other way; what only seems to move; sliding off; the border."""

import cv2
import numpy as np
import pytest

from estimator.targets.silhouette import silhouette
from estimator.targets.tracker import OUTSIDE, Lost, Sighting, TargetTracker
from estimator.targets.view import ExpectedView, Motion
from estimator.types import Float
from tests.estimator.targets.drawn import CAMERA, CAR, RED, STANDS, draw, pixel_of, pose_at, view_of

SPEED_M_S = 9.0
STEP_S = 0.2


def _driving(seconds: float = 1.6) -> tuple[TargetTracker, int, Float]:
    """A tracker that has seen a car drive north, the time and where the car is."""
    pose, ne = pose_at(0.0, 0.0), CAR - np.array([20.0, 0.0])
    tracker = TargetTracker.start(
        draw(*pose, [(ne, 0.0, RED)]), pixel_of(pose, ne), 0, view_of(pose, ne).px_per_m, course_rad=0.0
    )
    t_us = 0
    for k in range(1, round(seconds / STEP_S) + 1):
        t_us, ne = round(1e6 * STEP_S * k), ne + np.array([SPEED_M_S * STEP_S, 0.0])
        answer = tracker.update(draw(*pose, [(ne, 0.0, RED)], k), t_us, view_of(pose, ne, 1.5, _northward(1.0)))
        assert isinstance(answer, Sighting)
    return tracker, t_us, ne


def _northward(std_m_s: float) -> Motion:
    return Motion(np.array([SPEED_M_S, 0.0]), std_m_s**2 * np.eye(2), 0.0, std_m_s / SPEED_M_S, True)


def _away(tracker: TargetTracker, t_us: int, seconds: float) -> int:
    """Look at other ground."""
    pose = pose_at(-75.0, 0.0)
    for k in range(1, round(seconds) + 1):
        t_us += 1_000_000
        there = view_of(pose, CAR + np.array([20.0 + SPEED_M_S * k, 0.0]), 3.0 * k, _northward(4.0))
        assert isinstance(tracker.update(draw(*pose, [], k), t_us, there), Lost)
    return t_us


@pytest.mark.parametrize(("speed_m_s", "yaw_rad"), [(3.2, 0.1), (5.0, np.pi - 0.1), (8.0, np.pi)])
def test_a_car_that_braked_or_turned_about_while_away_is_found_again_among_parked_twins(
    speed_m_s: float, yaw_rad: float
) -> None:
    tracker, t_us, ne = _driving()
    t_us = _away(tracker, t_us, 8.0)
    expected = ne + np.array([SPEED_M_S * 8.0, 0.0])
    ne = np.array([15.0, 6.0])  # some 60 m short of where it should be
    twins = [(np.array([-4.0, -9.0]), 2.0, RED), (np.array([22.0, -14.0]), 0.3, RED)]
    found = []
    for k in range(20):
        t_us += round(1e6 * STEP_S)
        expected = expected + np.array([SPEED_M_S * STEP_S, 0.0])
        ne = ne + speed_m_s * STEP_S * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        pose = pose_at(8.0 - 0.3 * k, 2.0)
        picture = draw(*pose, [*twins, (ne, yaw_rad, RED)], k)
        answer = tracker.update(picture, t_us, view_of(pose, expected, 32.0, _northward(4.0)))
        if isinstance(answer, Sighting):
            found.append(answer)
            assert np.hypot(*(answer.uv_px - pixel_of(pose, ne))) < 4.0
            expected = ne.copy()
            break
    assert len(found) == 1
    assert found[0].found_again
    vel = speed_m_s * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    assert found[0].vel_ne_m_s is not None
    assert np.hypot(*(found[0].vel_ne_m_s - vel)) < 2.0 * found[0].vel_std_m_s


def test_a_parked_twin_that_seems_to_creep_as_the_pose_drifts_is_not_taken_for_a_driving_car() -> None:
    tracker, t_us, ne = _driving()
    t_us = _away(tracker, t_us, 8.0)
    expected = ne + np.array([SPEED_M_S * 8.0, 0.0])
    twin = np.array([12.0, 4.0])
    for k in range(20):
        t_us += round(1e6 * STEP_S)
        expected = expected + np.array([SPEED_M_S * STEP_S, 0.0])
        pose = pose_at(5.0, 2.0)
        drift = 3.2 * STEP_S * k * np.array([1.0, 0.0, 0.0])  # all that stands seems to go north at 3.2 m/s
        picture = draw(*pose, [(twin, 0.05, RED)], k)
        there = view_of((pose[0] + drift, pose[1]), expected, 32.0, _northward(4.0))
        assert isinstance(tracker.update(picture, t_us, there), Lost)


def test_a_driving_car_passes_a_parked_twin_without_a_change_of_target() -> None:
    tracker, t_us, ne = _driving(0.6)
    twin = (ne + np.array([7.0, 3.2]), 0.0, RED)
    pose = pose_at(0.0, 0.0)
    answers = []
    for k in range(16):
        t_us, ne = t_us + round(1e6 * STEP_S), ne + np.array([SPEED_M_S * STEP_S, 0.0])
        # thought to be on the twin's side of where it is
        there = view_of(pose, ne, 2.0, _northward(2.0), (0.0, 1.9))
        answers.append(tracker.update(draw(*pose, [twin, (ne, 0.0, RED)], k), t_us, there))
        if isinstance(answers[-1], Sighting):
            assert np.hypot(*(answers[-1].uv_px - pixel_of(pose, ne))) < 4.0
    assert isinstance(answers[-1], Sighting)


def test_a_car_in_sight_is_not_followed_onto_what_hardly_resembles_it() -> None:
    tracker, t_us, ne = _driving()
    pose, other = pose_at(0.0, 0.0), (95, 85, 112)
    ne = ne + np.array([SPEED_M_S * STEP_S, 0.0])
    # the car is gone; something of its outline stands there
    for k in range(3):
        t_us += round(1e6 * STEP_S)
        there = view_of(pose, ne, 2.0, _northward(1.0))
        answer = tracker.update(draw(*pose, [(ne, 0.0, other)], k), t_us, there)
        assert isinstance(answer, Lost)


def test_what_leaves_the_picture_is_lost_before_it_is_cut_off() -> None:
    pose = pose_at(0.0, 0.0)
    tracker = TargetTracker.start(draw(*pose, [(CAR, 0.4, RED)]), pixel_of(pose, CAR), 0, view_of(pose, CAR).px_per_m)
    seen = []
    for k in range(1, 60):
        pose = pose_at(0.0, -0.9 * k)
        # the pose errs by as much as a car is wide
        there = view_of(pose, CAR, 2.0, STANDS, (0.5, 1.2))
        answer = tracker.update(draw(*pose, [(CAR, 0.4, RED)], k), 100_000 * k, there)
        if isinstance(answer, Sighting):
            seen.append(answer)
            assert np.hypot(*(answer.uv_px - pixel_of(pose, CAR))) < 1.5
            assert answer.uv_px[0] < CAMERA.width_px - 8.0
    assert len(seen) > 30


def test_an_expected_place_at_the_horizon_is_no_view_of_it() -> None:
    pose = pose_at(0.0, 0.0)
    tracker = TargetTracker.start(draw(*pose, [(CAR, 0.4, RED)]), pixel_of(pose, CAR), 0, view_of(pose, CAR).px_per_m)
    edge_on = np.array([[0.0, 6.0, 320.0], [-6.0, 0.0, 240.0], [30.0, 0.0, 1.0]])
    there = ExpectedView(np.array([320.0, 240.0]), np.eye(2), np.eye(2), picture_from_ground=edge_on)
    answer = tracker.update(draw(*pose, [], 1), 200_000, there)
    assert isinstance(answer, Lost)
    assert answer.reason == OUTSIDE


@pytest.mark.parametrize("yaw_deg", [0.0, 35.0, 90.0, 140.0])
@pytest.mark.parametrize("off_px", [(0.0, 0.0), (2.0, -1.5)])
def test_a_car_is_cut_out_with_its_bonnet_and_without_its_shadow(yaw_deg: float, off_px: tuple[float, float]) -> None:
    size, half = 28.0, 34
    rng = np.random.default_rng(2)
    patch = np.full((2 * half + 1, 2 * half + 1, 3), 110.0)
    mask = np.zeros(patch.shape[:2], np.uint8)

    def box(forward: float, length: float, width: float, shift: tuple[float, float] = (0.0, 0.0)) -> Float:
        along = np.array([np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))])
        middle = half + np.array(off_px) + forward * along + shift
        return cv2.boxPoints(((float(middle[0]), float(middle[1])), (length, width), yaw_deg))

    for corners, colour in (
        (box(0.0, 0.9 * size, 0.36 * size, (4.0, -4.0)), (60.0, 60.0, 58.0)),  # shadow
        (box(0.0, 0.9 * size, 0.36 * size), (45.0, 120.0, 50.0)),
        (box(0.15 * size, 0.12 * size, 0.3 * size), (30.0, 28.0, 26.0)),  # windscreen
    ):
        cv2.fillPoly(patch, [np.round(corners).astype(np.int32)], colour)
    cv2.fillPoly(mask, [np.round(box(0.0, 0.9 * size, 0.36 * size)).astype(np.int32)], (1,))
    picture = np.clip(cv2.GaussianBlur(patch, (0, 0), 0.7) + rng.normal(0.0, 2.5, patch.shape), 0, 255)
    cut = silhouette(picture.astype(np.uint8), size)
    assert (cut & mask).sum() / (cut | mask).sum() > 0.65


def test_where_nothing_stands_out_a_disc_is_taken() -> None:
    rng = np.random.default_rng(1)
    flat = np.clip(rng.normal(110.0, 1.0, (69, 69, 3)), 0, 255).astype(np.uint8)
    cut = silhouette(flat, 28.0)
    rows, cols = np.nonzero(cut)
    assert abs(rows.mean() - 34.0) < 4.0
    assert abs(cols.mean() - 34.0) < 4.0
    assert 0.06 < cut.sum() / (np.pi * 14.0**2) < 0.9
