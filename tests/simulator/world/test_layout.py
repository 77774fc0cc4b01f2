"""Shapes on the ground."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from simulator.world.layout import (
    densified,
    distance_to_line_m,
    long_axis,
    polygon_area_m2,
    rectangle,
)


def test_rectangle_length_points_along_the_azimuth() -> None:
    corners = rectangle(np.array([10.0, 20.0]), 40.0, 10.0, np.radians(90))
    assert_allclose(np.ptp(corners, axis=0), [10.0, 40.0], atol=1e-9)
    assert_allclose(corners.mean(axis=0), [10.0, 20.0])
    assert polygon_area_m2(corners) == pytest.approx(400.0)


def test_long_axis_of_a_turned_rectangle() -> None:
    azimuth, along_m, across_m = long_axis(rectangle(np.zeros(2), 50.0, 20.0, 0.7))
    assert np.sin(azimuth - 0.7) == pytest.approx(0.0, abs=1e-9)
    assert (along_m, across_m) == (pytest.approx(50.0), pytest.approx(20.0))


def test_distance_to_a_bent_line() -> None:
    line = np.array([[0.0, 0.0], [0.0, 10.0], [10.0, 10.0]])
    distance = distance_to_line_m(np.array([[3.0, 5.0], [5.0, 13.0], [-3.0, -4.0]]), line)
    assert_allclose(distance, [3.0, 3.0, 5.0])


def test_densified_keeps_ends_and_length() -> None:
    line = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 7.0]])
    dense = densified(line, 4.0)
    steps = np.linalg.norm(np.diff(dense, axis=0), axis=1)
    assert steps.max() <= 4.0
    assert steps.sum() == pytest.approx(37.0)
    assert_allclose(dense[[0, -1]], line[[0, -1]])
