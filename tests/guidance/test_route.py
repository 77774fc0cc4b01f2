"""Ways through points: what they touch, how they bend, and how high the ground below them is."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from estimator.types import Float
from guidance.route import highest_ground_amsl_m, route_through

SQUARE = np.array([[0.0, 0.0, -50.0], [200.0, 0.0, -50.0], [200.0, 200.0, -50.0]])


def test_it_passes_the_points_and_bends_without_stopping() -> None:
    first, second = route_through(SQUARE, 8.0)

    assert np.allclose([first.curve.start_ned_m, first.curve.end_ned_m, second.curve.end_ned_m], SQUARE)
    # Equal legs: at the corner half way between both directions.
    assert np.allclose(first.curve.end_tangent_ned_m / 200.0, (math.sqrt(0.5), math.sqrt(0.5), 0.0))
    assert (first.end_m_s, second.end_m_s) == (8.0, 0.0)


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
