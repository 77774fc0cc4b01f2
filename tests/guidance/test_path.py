"""Cubic segments against SciPy's, quadrature and the circle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline

from estimator.types import Float
from guidance.path import CubicSegment, PathSegment, as_path, helix, straight

vectors = st.tuples(*[st.floats(-80.0, 80.0)] * 3).map(np.array)
BENT = CubicSegment(
    np.array((1.0, 2.0, -30.0)),
    np.array((60.0, 25.0, -20.0)),
    np.array((70.0, -10.0, 3.0)),
    np.array((20.0, 60.0, 15.0)),
)
S = np.linspace(0.0, 1.0, 41)


@given(vectors, vectors, vectors, vectors)
def test_point_and_derivatives_are_those_of_scipys_cubic(start: Float, end: Float, out: Float, on: Float) -> None:
    try:
        segment = CubicSegment(start, end, out, on)
    except ValueError:
        return
    theirs = CubicHermiteSpline((0.0, 1.0), np.stack((start, end)), np.stack((out, on)))
    assert_allclose(segment.point(S), theirs(S), atol=1e-9)
    assert_allclose(segment.tangent(S), theirs(S, 1), atol=1e-9)
    assert_allclose(segment.second_derivative(S), theirs(S, 2), atol=1e-9)


def test_curvature_is_equation_4_5() -> None:
    t, q = BENT.tangent(S), BENT.second_derivative(S)
    printed = np.cross(np.cross(t, q), t) / np.linalg.norm(t, axis=1)[:, None] ** 4
    assert_allclose(BENT.curvature(S), printed, atol=1e-15)
    assert_allclose(np.sum(BENT.curvature(S) * t, axis=1), 0.0, atol=1e-12)


def test_length_is_that_of_adaptive_quadrature() -> None:
    expected, _ = quad(lambda s: float(np.linalg.norm(BENT.tangent(s))), 0.0, 1.0, epsabs=1e-10)
    assert BENT.length_m == pytest.approx(expected, abs=1e-8)
    assert BENT.s_at(BENT.length_at_m(0.371)) == pytest.approx(0.371, abs=1e-4)
    assert (BENT.s_at(-1.0), BENT.s_at(1e6)) == (0.0, 1.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_helix_lies_on_its_circle_and_climbs_evenly(side: float) -> None:
    radius_m, climb_m = 45.0, 30.0
    pieces = helix((10.0, 20.0, -10.0), 0.4, radius_m, side * 2.0 * math.pi, climb_m, 8)
    centre = np.array((10.0, 20.0)) + side * radius_m * np.array((-math.sin(0.4), math.cos(0.4)))
    for k, piece in enumerate(pieces):
        points = piece.point(S)
        assert_allclose(np.hypot(*(points[:, :2] - centre).T), radius_m, atol=5e-6 * radius_m)
        assert_allclose(-points[:, 2], 10.0 + climb_m * (k + S) / 8, atol=1e-9)
        # Between its ends the curvature of such a cubic swings by two thousandths about the circle's.
        assert_allclose(piece.turn_curvature(S), side / radius_m, rtol=3e-3)
    assert_allclose(pieces[-1].end_ned_m, (10.0, 20.0, -40.0), atol=1e-9)
    assert_allclose(pieces[0].start_tangent_ned_m[:2] / np.hypot(*pieces[0].start_tangent_ned_m[:2]),
                    (math.cos(0.4), math.sin(0.4)))  # fmt: skip


def test_curvature_of_a_helix_in_space_is_less_than_of_its_track() -> None:
    """Of a climb angle g, cos^2 g times that of the circle."""
    climb_m, radius_m = 200.0, 45.0
    piece = helix((0.0, 0.0, 0.0), 0.0, radius_m, math.pi / 2, climb_m / 4, 2)[0]
    share = math.cos(math.atan2(climb_m / 4, radius_m * math.pi / 2)) ** 2
    assert np.linalg.norm(piece.curvature(S), axis=-1).mean() == pytest.approx(share / radius_m, rel=3e-3)


def test_straight_up_has_no_track_to_turn() -> None:
    up = straight((0.0, 0.0, 0.0), (0.0, 0.0, -20.0))
    assert_allclose(up.turn_curvature(S), 0.0)
    assert up.length_m == pytest.approx(20.0)


@pytest.mark.parametrize("bad", [(math.nan, 0.0, 0.0), (math.inf, 0.0, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize("place", range(4))
def test_vectors_that_are_none_are_refused(bad: tuple[float, ...], place: int) -> None:
    boundary = [BENT.start_ned_m, BENT.end_ned_m, BENT.start_tangent_ned_m, BENT.end_tangent_ned_m]
    boundary[place] = np.array(bad)
    with pytest.raises(ValueError, match="three finite numbers"):
        CubicSegment(*boundary)


def test_segments_without_a_direction_are_refused() -> None:
    here, there = np.zeros(3), np.array((10.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="the same"):
        CubicSegment(here, here, there, there)
    with pytest.raises(ValueError, match="vanishes"):
        CubicSegment(here, there, here, there)
    # To the middle and back: it stops where it turns.
    with pytest.raises(ValueError, match="vanishes"):
        CubicSegment(here, np.array((1e-2, 0.0, 0.0)), there, -there)


@pytest.mark.parametrize(
    ("radius_m", "turn_rad", "pieces"), [(0.0, 1.0, 1), (5.0, 0.0, 1), (5.0, 3.0, 1), (5.0, 1.0, 0)]
)
def test_turns_that_are_none_are_refused(radius_m: float, turn_rad: float, pieces: int) -> None:
    with pytest.raises(ValueError, match=r"helix|too few"):
        helix((0.0, 0.0, 0.0), 0.0, radius_m, turn_rad, 0.0, pieces)


def test_speeds_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="cruise_m_s"):
        PathSegment(BENT, math.nan, 0.0)
    with pytest.raises(ValueError, match="end_m_s"):
        PathSegment(BENT, 1.0, -0.1)


def test_a_path_stops_at_its_end_only() -> None:
    ends = [segment.end_m_s for segment in as_path(helix((0.0, 0.0, 0.0), 0.0, 20.0, 3.0, 0.0, 3), 7.0)]
    assert ends == [7.0, 7.0, 0.0]
