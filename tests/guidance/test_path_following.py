"""The control point, the reference there, and what happens where segments do not come."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from estimator.types import Float
from guidance.path import CubicSegment, PathSegment, as_path, helix, straight
from guidance.path_following import PathFollower, PathFollowingConfig, PathReference, as_published
from guidance.velocity_profile import SpeedPhase

BENT = CubicSegment(
    np.array((0.0, 0.0, -30.0)),
    np.array((80.0, 40.0, -20.0)),
    np.array((110.0, -20.0, 3.0)),
    np.array((60.0, 90.0, 15.0)),
)
NORTH = straight((0.0, 0.0, -30.0), (100.0, 0.0, -30.0))
STILL = np.zeros(3)


def follower(
    curves: list[CubicSegment], cruise_m_s: float = 8.0, config: PathFollowingConfig | None = None
) -> PathFollower:
    made = PathFollower(config)
    for segment in as_path(curves, cruise_m_s):
        made.add(segment)
    return made


def drive(made: PathFollower, seconds: float, start: Float, dt_s: float = 0.02) -> list[PathReference]:
    """A point that has each target velocity at once, and is never off the path."""
    pos, vel, references = np.array(start), STILL, []
    for _ in range(round(seconds / dt_s)):
        reference = made.step(dt_s, pos, vel, 0.0)
        vel = reference.vel_ned_m_s
        pos = reference.pos_ned_m + dt_s * vel
        references.append(reference)
    return references


@settings(max_examples=50)
@given(st.floats(0.02, 0.98), st.floats(-15.0, 15.0), st.floats(-15.0, 15.0))
def test_control_point_is_the_closest_of_the_path(s: float, right_m: float, down_m: float) -> None:
    """Led along the path to a place beside it, against a search over all of it."""
    made = follower([BENT])
    t = BENT.tangent(s) / np.linalg.norm(BENT.tangent(s))
    side = np.cross(t, (0.0, 0.0, 1.0)) / np.linalg.norm(np.cross(t, (0.0, 0.0, 1.0)))
    aside = right_m * side + down_m * np.cross(side, t)
    for on in np.linspace(0.0, s, 60):
        reference = made.step(0.02, BENT.point(on), STILL, 0.0)
    for share in np.linspace(0.0, 1.0, 40):
        place = BENT.point(s) + share * aside
        reference = made.step(0.02, place, STILL, 0.0)
    for _ in range(10):
        reference = made.step(0.02, place, STILL, 0.0)
    every = BENT.point(np.linspace(0.0, 1.0, 20_001))
    nearest = every[np.argmin(np.linalg.norm(every - place, axis=1))]
    assert_allclose(reference.pos_ned_m, nearest, atol=0.02)


def test_at_the_control_point_the_error_is_square_to_the_path() -> None:
    made = follower([BENT])
    reference = made.step(0.02, np.array((30.0, 3.0, -22.0)), STILL, 0.0)
    tangent = BENT.tangent(reference.s)
    error = np.array((30.0, 3.0, -22.0)) - reference.pos_ned_m
    assert abs(float(error @ tangent)) / float(np.linalg.norm(tangent)) < 0.05


def test_a_path_that_meets_itself_is_followed_in_order() -> None:
    """A full circle back to where it began: the control point goes around, it does not stay."""
    circle = helix((20.0, 0.0, -30.0), 0.0, 20.0, 2.0 * math.pi, 0.0, 8)
    made = follower(
        [straight((0.0, 0.0, -30.0), (20.0, 0.0, -30.0)), *circle, straight((20.0, 0.0, -30.0), (60.0, 0.0, -30.0))],
        5.0,
    )
    references = drive(made, 60.0, np.array((0.0, 0.0, -30.0)))
    segments = [one.segment for one in references]
    assert segments == sorted(segments)
    assert set(segments) == set(range(10))
    assert_allclose(references[-1].pos_ned_m, (60.0, 0.0, -30.0), atol=0.3)


def test_joints_are_passed_without_a_jump() -> None:
    made = follower([NORTH, *helix((100.0, 0.0, -30.0), 0.0, 60.0, math.pi / 2, 0.0, 2)], 8.0)
    references = drive(made, 25.0, NORTH.start_ned_m)
    moved = np.linalg.norm(np.diff([one.pos_ned_m for one in references], axis=0), axis=1)
    assert moved.max() < 0.02 * 8.0 * 1.05
    assert {one.segment for one in references} == {0, 1, 2}


def test_short_segments_are_passed_several_in_one_step() -> None:
    made = follower([straight((k, 0.0, 0.0), (k + 1.0, 0.0, 0.0)) for k in range(20)])
    assert made.step(0.02, np.array((12.5, 1.0, 0.0)), STILL, 0.0).segment == 12


def test_the_target_speeds_up_cruises_and_brakes() -> None:
    references = drive(follower([NORTH]), 40.0, NORTH.start_ned_m)
    speeds = np.array([one.target.speed_m_s for one in references])
    assert speeds.max() == 8.0
    assert np.diff(speeds).max() <= 1.2 * 0.02 + 1e-9
    assert np.diff(speeds).min() >= -1.2 * 0.02 * 1.05
    assert speeds[-1] < 0.1 and references[-1].remaining_m < 0.1
    phases = [one.target.phase for one in references]
    assert (
        phases[10] is SpeedPhase.ACCELERATION and phases[500] is SpeedPhase.CRUISE and phases[-1] is SpeedPhase.BRAKING
    )


def test_without_a_next_segment_it_is_braked_to_a_stop_at_the_end() -> None:
    """The planner says the end is to be passed at 8 m/s, and is not heard of any more."""
    made = PathFollower()
    made.add(PathSegment(NORTH, 8.0, 8.0))
    references = drive(made, 60.0, NORTH.start_ned_m)
    assert max(one.target.speed_m_s for one in references) == 8.0
    assert np.diff([one.target.speed_m_s for one in references]).min() >= -1.2 * 0.02 * 1.05
    assert references[-1].target.speed_m_s < 0.05
    assert_allclose(references[-1].pos_ned_m, NORTH.end_ned_m, atol=0.2)


@pytest.mark.parametrize("late_s", [5.0, 16.0, 60.0])
def test_a_segment_that_comes_late_is_gone_on_with(late_s: float) -> None:
    """In time; while it brakes; when it has stopped. The target never jumps."""
    made = PathFollower()
    made.add(PathSegment(NORTH, 8.0, 8.0))
    before = drive(made, late_s, NORTH.start_ned_m)
    made.add(PathSegment(straight((100.0, 0.0, -30.0), (200.0, 0.0, -30.0)), 8.0, 8.0))
    after = drive(made, 60.0, before[-1].pos_ned_m)
    slowest = min(one.target.speed_m_s for one in after[: round(3.0 / 0.02)])
    speeds = [one.target.speed_m_s for one in (before[-1], *after)]
    assert np.diff(speeds).max() <= 1.2 * 0.02 + 1e-9
    assert (slowest > 4.0) == (late_s == 5.0)
    assert max(speeds) == 8.0
    assert_allclose(after[-1].pos_ned_m, (200.0, 0.0, -30.0), atol=0.2)


def test_an_end_to_be_passed_faster_than_the_cruise_is_sped_up_to() -> None:
    made = PathFollower()
    made.add(PathSegment(NORTH, 4.0, 7.0))
    made.add(PathSegment(straight((100.0, 0.0, -30.0), (200.0, 0.0, -30.0)), 7.0, 0.0))
    speeds = {one.segment: one.target.speed_m_s for one in drive(made, 30.0, NORTH.start_ned_m)[::-1]}
    assert speeds[1] == pytest.approx(7.0, abs=0.15)


def test_a_bend_is_braked_for_in_time_or_as_published_when_it_is_there() -> None:
    """12 m of radius allow 5.55 m/s by roll."""
    bend = [NORTH, *helix((100.0, 0.0, -30.0), 0.0, 12.0, math.pi / 2, 0.0, 2)]
    bend.append(straight(bend[-1].end_ned_m, bend[-1].end_ned_m + np.array((0.0, 90.0, 0.0))))
    limit = math.sqrt(math.radians(15.0) * 9.81 * 12.0)
    ahead = drive(follower(bend), 18.0, NORTH.start_ned_m)
    published = drive(follower(bend, config=as_published()), 18.0, NORTH.start_ned_m)
    entry = {
        name: [r.target.speed_m_s for r in run if r.segment == 0][-1] for name, run in (("a", ahead), ("p", published))
    }
    assert entry["a"] == pytest.approx(limit, rel=0.03)
    assert entry["p"] == 8.0
    for run in (ahead, published):
        assert max(r.target.speed_m_s for r in run if r.segment == 1) <= limit * 1.03


def test_a_steep_descent_is_flown_slowly() -> None:
    down = straight((0.0, 0.0, -60.0), (30.0, 0.0, -20.0))
    references = drive(follower([down]), 20.0, down.start_ned_m)
    assert max(one.vel_ned_m_s[2] for one in references) == pytest.approx(1.5, abs=1e-6)


def test_feed_forward_is_4_14_on_a_circle() -> None:
    circle = helix((0.0, 0.0, -30.0), 0.0, 50.0, -math.pi, 0.0, 4)
    made = follower(circle, config=as_published())
    pos, heading = circle[1].point(0.5), math.atan2(*circle[1].tangent(0.5)[1::-1])
    vel = 9.0 * np.array((math.cos(heading), math.sin(heading), 0.0))
    for s in np.linspace(0.0, 1.0, 30):
        made.step(0.02, circle[0].point(s), STILL, 0.0)
    for s in np.linspace(0.0, 0.5, 30):
        reference = made.step(0.02, circle[1].point(s), vel, heading)
    assert_allclose(reference.pos_ned_m, pos, atol=1e-3)
    assert reference.yaw_rate_rad_s == pytest.approx(-9.0 / 50.0, rel=5e-3)
    assert math.tan(reference.roll_rad) == pytest.approx(-(9.0**2) / (9.81 * 50.0), rel=1e-2)
    assert reference.yaw_rad == pytest.approx(heading, abs=1e-6)


def test_preview_feeds_forward_what_comes() -> None:
    made = follower(
        [NORTH, *helix((100.0, 0.0, -30.0), 0.0, 50.0, math.pi / 2, 0.0, 2)], config=PathFollowingConfig(preview_s=0.5)
    )
    vel = np.array((8.0, 0.0, 0.0))
    for north in np.linspace(0.0, 95.0, 50):
        before = made.step(0.02, np.array((north, 0.0, -30.0)), vel, 0.0)
    ahead = made.step(0.02, np.array((96.5, 0.0, -30.0)), vel, 0.0)
    assert before.roll_rad == 0.0
    assert ahead.roll_rad == pytest.approx(math.atan(64.0 / (9.81 * 50.0)), rel=1e-2)
    assert ahead.yaw_rate_rad_s == 0.0


def test_a_vertical_segment_keeps_the_heading() -> None:
    up = straight((0.0, 0.0, 0.0), (0.0, 0.0, -20.0))
    reference = follower([up]).step(0.02, STILL, STILL, 1.1)
    assert reference.yaw_rad == 1.1 and reference.yaw_rate_rad_s == 0.0
    assert reference.vel_ned_m_s[2] < 0.0


def test_segments_that_do_not_continue_are_refused() -> None:
    made = PathFollower()
    made.add(PathSegment(NORTH, 8.0, 8.0))
    with pytest.raises(ValueError, match=r"2\.00 m from where"):
        made.add(PathSegment(straight((100.0, 2.0, -30.0), (200.0, 0.0, -30.0)), 8.0, 0.0))
    with pytest.raises(ValueError, match="leads elsewhere"):
        made.add(PathSegment(straight((100.0, 0.0, -30.0), (100.0, 50.0, -30.0)), 8.0, 0.0))
    stops = PathFollower()
    stops.add(PathSegment(NORTH, 8.0, 0.0))
    stops.add(PathSegment(straight((100.0, 0.0, -30.0), (100.0, 50.0, -30.0)), 8.0, 0.0))


def test_input_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="no segment"):
        PathFollower().step(0.02, STILL, STILL, 0.0)
    made = follower([NORTH])
    for dt_s in (0.0, -0.1, math.nan, 2.0):
        with pytest.raises(ValueError, match="dt_s"):
            made.step(dt_s, STILL, STILL, 0.0)
    with pytest.raises(ValueError, match="pos_ned_m"):
        made.step(0.02, np.full(3, math.nan), STILL, 0.0)
    with pytest.raises(ValueError, match="vel_ned_m_s"):
        made.step(0.02, STILL, np.zeros(2), 0.0)
    with pytest.raises(ValueError, match="yaw_rad"):
        made.step(0.02, STILL, STILL, math.inf)
    with pytest.raises(ValueError, match="preview_s"):
        PathFollowingConfig(preview_s=math.nan)
    with pytest.raises(ValueError, match="stop_gain_per_s"):
        PathFollowingConfig(stop_gain_per_s=0.0)
