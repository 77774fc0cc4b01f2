"""The L1 law: its closed forms, and what it does to a point that flies by it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.types import Float
from guidance.line_of_sight import acceleration_right_m_s2, ahead_on_circle

LOOK_S, SPEED_M_S, DT_S = 2.0, 20.0, 0.01


def turned(velocity: Float, right_m_s2: float) -> Float:
    """A velocity (2,) that keeps its size, a step later."""
    angle = right_m_s2 / SPEED_M_S * DT_S
    c, s = math.cos(angle), math.sin(angle)
    return np.array((c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1]))


def test_acceleration_is_of_the_published_equation() -> None:
    """2 V^2 / L1 sin(eta), L1 = 40 m: 30 degrees to the right are 10 m/s2; scale of the direction does not count."""
    for bearing, expected in ((0.0, 0.0), (30.0, 10.0), (-30.0, -10.0), (90.0, 20.0), (150.0, 20.0), (-100.0, -20.0)):
        towards = 7.0 * np.array((math.cos(math.radians(bearing)), math.sin(math.radians(bearing))))
        found = acceleration_right_m_s2(np.array((SPEED_M_S, 0.0)), towards, LOOK_S)
        assert found == pytest.approx(expected, abs=1e-9)


def test_nothing_to_turn_is_no_acceleration() -> None:
    assert acceleration_right_m_s2(np.zeros(2), np.array((1.0, 0.0)), LOOK_S) == 0.0
    assert acceleration_right_m_s2(np.array((SPEED_M_S, 0.0)), np.zeros(2), LOOK_S) == 0.0


def test_a_line_is_met_as_a_second_order_system_does() -> None:
    """sqrt(2) V / L1 = 0.71 rad/s with a damping of 0.71, from 5 m aside: overshoot 4 %, in the small angles' limit."""
    pos, velocity, track = np.array((0.0, 5.0)), np.array((SPEED_M_S, 0.0)), []
    for _ in range(1500):
        aside = float(pos[1])
        ahead = math.sqrt((LOOK_S * SPEED_M_S) ** 2 - aside**2)
        velocity = turned(velocity, acceleration_right_m_s2(velocity, np.array((ahead, -aside)), LOOK_S))
        pos = pos + velocity * DT_S
        track.append(float(pos[1]))
    t_s = DT_S * np.arange(1, 1501)
    rate = 1.0 / LOOK_S
    expected = 5.0 * np.exp(-rate * t_s) * (np.cos(rate * t_s) + np.sin(rate * t_s))
    assert_allclose(track, expected, atol=0.1)


@pytest.mark.parametrize("start", [(0.0, 0.0), (300.0, -200.0), (80.0, 0.0)])
def test_a_circle_is_entered_from_anywhere_and_kept(start: tuple[float, float]) -> None:
    """Clockwise from above. The aim is an arc ahead where the law has a chord: 1 / 24 (L1 / R)^2 of the radius out."""
    centre, radius = np.array((10.0, 20.0)), 80.0
    pos, velocity = np.add(start, (3.0, 0.0)), np.array((0.0, SPEED_M_S))
    for _ in range(9000):
        point = ahead_on_circle(pos, centre, radius, LOOK_S * SPEED_M_S)
        velocity = turned(velocity, acceleration_right_m_s2(velocity, point - pos, LOOK_S))
        pos = pos + velocity * DT_S
    off = pos - centre
    assert float(np.linalg.norm(off)) == pytest.approx(radius, abs=1.5)
    assert off[0] * velocity[1] - off[1] * velocity[0] > 0.99 * radius * SPEED_M_S


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="look_ahead_s must be positive"):
        acceleration_right_m_s2(np.ones(2), np.ones(2), 0.0)
    with pytest.raises(ValueError, match="radius_m and ahead_m"):
        ahead_on_circle(np.ones(2), np.ones(2), -1.0, 5.0)
