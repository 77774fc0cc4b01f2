"""Ways through points: what they touch, how they bend, and how high the ground below them is."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from estimator.types import Float
from guidance.route import highest_ground_amsl_m, route_through

SQUARE = np.array([[0.0, 0.0, -50.0], [200.0, 0.0, -50.0], [200.0, 200.0, -50.0]])


def sampled(points: Float, **options: float) -> Float:
    s = np.linspace(0.0, 1.0, 101)
    return np.concatenate([segment.curve.point(s) for segment in route_through(points, 8.0, **options)])


def test_a_corner_is_cut_by_a_circles_arc() -> None:
    path = sampled(SQUARE, corner_m=40.0)

    assert np.allclose(path[0], SQUARE[0]) and np.allclose(path[-1], SQUARE[-1])
    # A quarter of a circle of 40 m about (160, 40) touches both legs where the bend begins and ends.
    bend = path[(path[:, 0] > 160.01) & (path[:, 1] < 39.99)]
    radius_m = np.hypot(bend[:, 0] - 160.0, bend[:, 1] - 40.0)
    assert bend.shape[0] > 50
    # A cubic is a quarter of a circle to three parts in ten thousand.
    assert np.allclose(radius_m, 40.0, atol=0.02)


def test_segments_join_without_gap_or_kink_and_stop_at_the_last() -> None:
    points = np.array([[0.0, 0, -50], [80, 20, -60], [100, 90, -60], [20, 130, -40], [20, 131.5, -40], [-60, 40, -50]])
    segments = route_through(points, 6.0)

    for before, after in itertools.pairwise(segments):
        assert np.allclose(before.curve.end_ned_m, after.curve.start_ned_m)
        one, other = before.curve.end_tangent_ned_m, after.curve.start_tangent_ned_m
        assert float(one @ other) / float(np.linalg.norm(one) * np.linalg.norm(other)) > 0.999 or before.end_m_s == 0.0
    assert segments[-1].end_m_s == 0.0


def test_the_way_back_is_flown_to_and_left_from_standing() -> None:
    there_and_back = np.array([[0.0, 0, -50], [100, 0, -50], [0, 5, -50]])
    first, second = route_through(there_and_back, 8.0)

    assert first.end_m_s == 0.0
    assert np.allclose(second.curve.start_ned_m, (100.0, 0.0, -50.0))


def test_two_points_in_one_place_are_no_way() -> None:
    with pytest.raises(ValueError, match="two points at least"):
        route_through(np.array([[0.0, 0, -50], [0.3, 0, -50]]), 8.0)
    with pytest.raises(ValueError, match=r"points_ned_m\[1\]"):
        route_through(np.array([[0.0, 0, -50], [math.nan, 0, -50]]), 8.0)


def test_a_hill_beside_the_way_counts_and_one_farther_off_does_not() -> None:
    def hills(north_m: Float, east_m: Float) -> Float:
        near = 130.0 * np.exp(-((north_m - 100) ** 2 + (east_m - 30) ** 2) / 200.0)
        far = 300.0 * np.exp(-((north_m - 100) ** 2 + (east_m - 120) ** 2) / 200.0)
        unknown = np.where(north_m < 50, math.nan, 0.0)
        return 20.0 + near + far + unknown

    found = highest_ground_amsl_m(SQUARE[:2], hills)

    assert 140.0 < found <= 150.0 + 1.0
    assert math.isnan(highest_ground_amsl_m(SQUARE[:2], lambda north_m, _: np.full_like(north_m, math.nan)))
