"""Paths through the points of a plan, against what can be worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from guidance.plan_path import PathLimits, PlannedPath, PlanPoint, planned_path
from guidance.velocity_profile import FlightEnvelope

LIMITS = PathLimits()
A = FlightEnvelope().acceleration_m_s2


def points(*places: tuple[float, float, float], cruise_m_s: float = 5.0) -> list[PlanPoint]:
    return [PlanPoint(np.array(place), cruise_m_s) for place in places]


def check_flyable(path: PlannedPath, limits: PathLimits = LIMITS) -> None:
    """No speed above what is allowed there, no change of it above what can be accelerated or braked."""
    step_m = np.diff(path.length_m)
    assert np.all(step_m > 0.0)
    assert np.all(np.diff(path.time_s) > 0.0)
    level = np.cos(path.climb_rad)
    assert np.all(path.speed_m_s * level <= path.allowed_turn_m_s + 1e-6)
    change = np.diff(path.speed_m_s**2) / (2.0 * step_m)
    assert change.max() <= limits.envelope.acceleration_m_s2 + 1e-6
    assert change.min() >= -limits.envelope.braking_m_s2 - 1e-6


def test_a_straight_leg_takes_as_long_as_the_trapezium_says() -> None:
    path = planned_path(points((0, 0, -50), (300, 400, -50)), LIMITS)

    assert path.length_m[-1] == pytest.approx(500.0)
    # Cruise all the way, and once more the time that the two ramps cost: v / a.
    assert path.time_s[-1] == pytest.approx(500.0 / 5.0 + 5.0 / A, rel=0.005)
    assert path.speed_m_s.max() == pytest.approx(5.0)
    assert (path.speed_m_s[0], path.speed_m_s[-1]) == (0.0, 0.0)
    assert np.all(np.isinf(path.turn_radius_m))
    check_flyable(path)


def test_points_on_a_circle_are_flown_as_that_circle() -> None:
    radius_m = 60.0
    angle = np.radians(np.arange(0, 360, 30))
    around = [(radius_m * math.cos(a), radius_m * math.sin(a), -40.0) for a in angle]
    path = planned_path(points(*around, cruise_m_s=30.0), LIMITS)
    # The first and the last leg begin and end straight.
    inner = (path.leg > 1) & (path.leg < 9)
    assert_allclose(np.linalg.norm(path.pos_ned_m[inner, :2], axis=1), radius_m, rtol=0.01)
    assert_allclose(path.turn_radius_m[inner], radius_m, rtol=0.2)
    # (4.15) of the thesis: the roll of 15 degrees is the least of the three at this radius.
    roll_m_s = math.sqrt(math.radians(15.0) * 9.81 * radius_m)
    assert path.speed_m_s[inner].max() == pytest.approx(roll_m_s, rel=0.1)
    check_flyable(path)


def test_it_passes_every_point_and_stands_where_it_stays() -> None:
    plan = points((0, 0, -30), (80, 10, -30), (120, 90, -45), (40, 140, -30))
    through = planned_path(plan, LIMITS)
    plan[2] = PlanPoint(plan[2].pos_ned_m, 5.0, stops=True, stay_s=12.0)
    stays = planned_path(plan, LIMITS)
    for path in (through, stays):
        assert_allclose(path.pos_ned_m[path.arrivals], [p.pos_ned_m for p in plan], atol=1e-9)
        check_flyable(path)
    at = stays.arrivals[2]
    assert (through.speed_m_s[through.arrivals[2]] > 2.0, stays.speed_m_s[at]) == (True, 0.0)
    # It arrives before it stays.
    assert stays.time_s[at + 1] - stays.time_s[at] > 12.0
    assert stays.time_s[at] - stays.time_s[at - 1] < 3.0
    # Heights stay between those of the points.
    assert_allclose(through.pos_ned_m[through.leg == 0, 2], -30.0)
    assert through.pos_ned_m[:, 2].min() >= -45.0 - 1e-9


def test_climbs_and_descents_are_as_slow_as_the_envelope_says() -> None:
    up = planned_path(points((0, 0, 0), (0, 0, -100), cruise_m_s=20.0), LIMITS)
    down = planned_path(points((0, 0, -100), (0, 0, 0), cruise_m_s=20.0), LIMITS)
    gentle = planned_path(points((0, 0, -100), (500, 0, 0), cruise_m_s=20.0), LIMITS)

    assert up.speed_m_s.max() == pytest.approx(2.5)
    assert down.speed_m_s.max() == pytest.approx(1.5)  # steeper than 30 degrees: its own downwash
    assert (gentle.speed_m_s * -np.sin(gentle.climb_rad)).max() == pytest.approx(3.0)
    assert_allclose(up.climb_rad, math.pi / 2)
    assert_allclose(gentle.climb_rad, -math.atan(0.2))


def test_turning_back_is_done_standing() -> None:
    path = planned_path(points((0, 0, -50), (100, 0, -50), (0, 5, -50)), LIMITS)
    assert path.speed_m_s[path.arrivals[1]] == 0.0
    assert np.all(np.isinf(path.turn_radius_m))


def test_what_does_not_hover_keeps_its_speed() -> None:
    plan = [PlanPoint(p.pos_ned_m, 18.0, True, 5.0) for p in points((0, 0, -50), (300, 0, -50), (300, 300, -50))]
    path = planned_path(plan, PathLimits(hovers=False))
    assert_allclose(path.speed_m_s, 18.0)


def test_cruising_speed_changes_from_its_point_on() -> None:
    plan = points((0, 0, -50), (200, 0, -50), (400, 0, -50))
    plan[1] = PlanPoint(plan[1].pos_ned_m, 9.0)
    path = planned_path(plan, LIMITS)
    assert path.speed_m_s[path.leg == 0].max() == pytest.approx(5.0)
    assert path.speed_m_s[path.leg == 1].max() == pytest.approx(9.0)
    check_flyable(path)


@pytest.mark.parametrize("places", [[(0, 0, 0)], [(0, 0, 0), (0, 0, 0)], [(0, 0, 0), (9, 0, 0), (9, 0, 0.001)]])
def test_no_path_without_different_places(places: list[tuple[float, float, float]]) -> None:
    with pytest.raises(ValueError, match="two points or more"):
        planned_path(points(*places), LIMITS)


def test_limits_are_checked() -> None:
    with pytest.raises(ValueError, match="climb_m_s must be positive"):
        PathLimits(climb_m_s=0.0)
