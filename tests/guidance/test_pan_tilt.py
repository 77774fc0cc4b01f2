"""The pad stays in the middle of the picture, over the point where the yaw is not defined too."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from estimator.geometry.rotation import matrix_from_euler
from estimator.types import Float
from guidance.pan_tilt import GimbalAngles, PanTilt, PanTiltConfig, line_of_sight

angle = st.floats(-math.pi, math.pi)


def off_axis_rad(angles: GimbalAngles, heading_rad: float, target: Float) -> float:
    sight = line_of_sight(angles, heading_rad)
    return math.acos(min(1.0, float(sight @ target) / float(np.linalg.norm(target))))


@given(angle, st.floats(math.radians(-135), math.radians(30)), angle)
def test_the_line_of_sight_is_that_of_euler_angles(heading: float, pitch: float, yaw: float) -> None:
    expected = matrix_from_euler(0.0, pitch, heading + yaw)[:, 0]
    assert_allclose(line_of_sight(GimbalAngles(pitch, yaw), heading), expected, atol=1e-12)


@given(angle, st.floats(-20, 20), st.floats(-20, 20), st.floats(0.5, 25))
def test_a_target_that_stays_comes_near_the_middle(heading: float, north: float, east: float, down: float) -> None:
    target = np.array((north, east, down))
    pan_tilt = PanTilt()
    for tick in range(100):
        angles = pan_tilt.step(50_000 * tick, heading, target)

    assert off_axis_rad(angles, heading, target) <= pan_tilt.config.side_rad + 1e-6


def test_flying_over_the_pad_turns_no_yaw_and_loses_nothing() -> None:
    """From 8 m before to 4 m behind the pad at 10 m height and 2 m/s, 0.3 m beside it."""
    pan_tilt, yaws = PanTilt(start=GimbalAngles(math.radians(-50), 0.0)), []
    for tick in range(120):
        target = np.array((8.0 - 2.0 * 0.05 * tick, 0.3, 10.0))
        angles = pan_tilt.step(50_000 * tick, 0.0, target)
        yaws.append(angles.yaw_rad)
        assert off_axis_rad(angles, 0.0, target) < math.radians(5.0)
    assert max(map(abs, yaws)) == 0.0
    assert angles.pitch_rad < -math.pi / 2


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-2, 9)), min_size=2, max_size=20), angle)
def test_rates_and_limits_hold_for_any_target(targets: list[tuple[float, float, float]], heading: float) -> None:
    config = PanTiltConfig()
    pan_tilt = PanTilt(config)
    before = pan_tilt.angles
    for tick, target in enumerate(targets):
        angles = pan_tilt.step(50_000 * tick, heading, np.array(target))
        for new, old in ((angles.pitch_rad, before.pitch_rad), (angles.yaw_rad, before.yaw_rad)):
            assert abs(new - old) <= config.rate_rad_s * 0.05 + 1e-9
        assert config.pitch_min_rad <= angles.pitch_rad <= config.pitch_max_rad
        assert abs(angles.yaw_rad) <= config.yaw_max_rad
        before = angles


def test_without_a_target_it_holds() -> None:
    pan_tilt = PanTilt(start=GimbalAngles(-1.0, 0.4))
    assert pan_tilt.step(0, 0.0, None) == GimbalAngles(-1.0, 0.4)
    assert pan_tilt.step(50_000, 0.0, np.full(3, np.nan)) == GimbalAngles(-1.0, 0.4)


def test_limits_that_exclude_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="pitch runs"):
        PanTiltConfig(pitch_min_rad=0.5, pitch_max_rad=0.1)
    with pytest.raises(ValueError, match="rate_rad_s"):
        PanTiltConfig(rate_rad_s=0.0)
