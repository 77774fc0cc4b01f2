"""The three target velocities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from estimator.types import Float
from guidance.velocity_profile import (
    FlightEnvelope,
    SpeedPhase,
    SpeedTarget,
    allowed_ahead_m_s,
    braking_speed_m_s,
    descent_speed_m_s,
    stopping_speed_m_s,
    turn_speeds,
    turning_speed_m_s,
)

ENVELOPE = FlightEnvelope()
LEVEL = np.array((0.6, 0.8, 0.0))


def down_at(angle_deg: float) -> Float:
    angle = math.radians(angle_deg)
    return np.array((math.cos(angle), 0.0, math.sin(angle)))


def test_turn_speeds_by_hand() -> None:
    """At 40 m: 40 degrees a second is 27.9 m/s; 15 degrees of roll 10.1; a load of 1.1 gives 11.1 (figure 4.6)."""
    speeds = turn_speeds(1.0 / 40.0, ENVELOPE)
    assert speeds.yaw_rate_m_s == pytest.approx(27.925, abs=1e-3)
    assert speeds.roll_m_s == pytest.approx(10.136, abs=1e-3)
    assert speeds.load_factor_m_s == pytest.approx(11.140, abs=1e-3)


@given(st.floats(5.0, 500.0))
def test_roll_limits_most_at_any_radius_of_figure_4_6(radius_m: float) -> None:
    """Down to 5.3 m, below which the yaw rate does."""
    speeds = turn_speeds(-1.0 / radius_m, ENVELOPE)
    least = speeds.roll_m_s if radius_m > 5.3 else speeds.yaw_rate_m_s
    assert float(speeds.least_m_s) == float(least)


def test_at_the_load_factors_limit_the_thrust_of_4_14_is_the_greatest() -> None:
    u, radius_m, g = float(turn_speeds(1.0 / 60.0, ENVELOPE).load_factor_m_s), 60.0, 9.81
    assert -(u**4) / (g * radius_m**2) - g == pytest.approx(-1.1 * g)


def test_a_straight_path_is_not_limited_by_turns_and_a_steep_one_less() -> None:
    assert float(turning_speed_m_s(LEVEL, 0.0, ENVELOPE)) == math.inf
    level = float(turning_speed_m_s(LEVEL, 0.02, ENVELOPE))
    assert float(turning_speed_m_s(down_at(60.0), 0.02, ENVELOPE)) == pytest.approx(2.0 * level)


@pytest.mark.parametrize(
    ("angle_deg", "sink_m_s"),
    [(5.0, 3.0), (29.9, 3.0), (30.1, 1.5), (60.0, 1.5), (90.0, 1.5), (0.0, None), (-40.0, None)],
)
def test_descents_stay_out_of_the_vortex_ring(angle_deg: float, sink_m_s: float | None) -> None:
    direction = down_at(angle_deg)
    speed = float(descent_speed_m_s(direction, ENVELOPE))
    if sink_m_s is None:
        assert speed == math.inf
    else:
        assert speed * direction[2] == pytest.approx(sink_m_s)


def test_braking_by_hand() -> None:
    """From 10 m/s at 1.2 m/s2: 41.7 m to a stop."""
    assert_allclose(braking_speed_m_s((41.6667, 0.0, -3.0), (0.0, 4.0, 0.0), ENVELOPE), (10.0, 4.0, 0.0), atol=1e-4)


def test_a_stop_is_nowhere_braked_for_harder() -> None:
    left = np.linspace(0.0, 60.0, 60_001)
    speed = np.array([stopping_speed_m_s(one, 0.6, ENVELOPE) for one in left])
    braking = speed[1:] * np.diff(speed) / np.diff(left)
    assert braking.max() == pytest.approx(1.2, rel=1e-3)
    assert_allclose(speed[1:3000], 0.6 * left[1:3000])
    assert np.all(speed <= braking_speed_m_s(left, 0.0, ENVELOPE) + 1e-9)


@given(arrays(np.float64, 30, elements=st.floats(0.0, 20.0)), arrays(np.float64, 30, elements=st.floats(0.0, 5.0)))
def test_every_limit_ahead_can_be_braked_down_to(limit: Float, steps: Float) -> None:
    length = np.cumsum(steps)
    allowed = allowed_ahead_m_s(length, limit, ENVELOPE)
    # Rounding is 1e-14 of squares of hundreds, under a root.
    assert np.all(allowed <= limit + 1e-5)
    assert np.all(allowed[:-1] ** 2 - allowed[1:] ** 2 <= 2.0 * 1.2 * np.diff(length) + 1e-6)
    # It is slower than the limit only where one ahead asks for it.
    for k in range(30):
        reach = np.sqrt(np.min(limit[k:] ** 2 + 2.0 * 1.2 * (length[k:] - length[k])))
        assert allowed[k] == pytest.approx(reach, abs=1e-5)


def test_phases_of_a_short_flight() -> None:
    target, phases, speeds, left = SpeedTarget(ENVELOPE), [], [], 120.0
    for _ in range(4000):
        brake = float(braking_speed_m_s(left, 0.0, ENVELOPE))
        now = target.step(0.02, 8.0, brake, math.inf, math.inf)
        left -= 0.02 * now.speed_m_s
        phases.append(now.phase)
        speeds.append(now.speed_m_s)
    kept = [phase for phase, before in zip(phases, [None, *phases], strict=False) if phase is not before]
    assert kept[:3] == [SpeedPhase.ACCELERATION, SpeedPhase.CRUISE, SpeedPhase.BRAKING]
    assert max(speeds) == 8.0
    # In the last moment before the stop the steps are too coarse for (4.20).
    changes = np.abs(np.diff(speeds))[np.array(speeds[:-1]) > 0.3]
    assert changes.max() <= 1.2 * 0.02 * 1.1
    assert speeds[-1] < 0.1


def test_the_least_counts_and_no_rise_is_a_jump() -> None:
    target = SpeedTarget(ENVELOPE, 6.0)
    bend = target.step(0.02, 10.0, 50.0, 3.0, 7.0)
    assert bend.speed_m_s == 3.0
    assert target.step(0.02, 10.0, 50.0, math.inf, math.inf).speed_m_s == pytest.approx(3.0 + 1.2 * 0.02)


@pytest.mark.parametrize(
    ("name", "value"), [("roll_max_rad", 0.0), ("acceleration_m_s2", math.nan), ("load_factor_max", 1.0)]
)
def test_limits_that_are_none_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        FlightEnvelope(**{name: value})
