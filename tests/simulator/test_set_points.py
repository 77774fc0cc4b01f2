"""What a station streams, in both forms of a landing target and in the frames of a velocity."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.rotation import q_from_euler
from simulator.set_points import target_of, velocity_of

LEVEL = q_from_euler(0.0, 0.0, 0.0)


def target(x: float, y: float, z: float, *, valid: bool, frame: int = 12) -> object:
    """A place, or its angles as ArduPilot's recorded landings have them: atan2(y, z) and -atan2(x, z)."""
    place = (x, y, z) if valid else (0.0, 0.0, 0.0)
    angles = (0.0, 0.0) if valid else (math.atan2(y, z), -math.atan2(x, z))
    return mavlink.MAVLink_landing_target_message(
        *(0, 0, frame, *angles, math.hypot(x, y, z), 0.0, 0.0, *place, [1.0, 0.0, 0.0, 0.0], 2, int(valid))
    )


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.5, 20), st.floats(-0.3, 0.3), st.floats(-3, 3))
def test_both_forms_say_the_same(x: float, y: float, z: float, roll: float, yaw: float) -> None:
    q = q_from_euler(roll, -0.5 * roll, yaw)
    assert_allclose(target_of(target(x, y, z, valid=False), q), target_of(target(x, y, z, valid=True), q), atol=1e-9)


def test_forward_is_north_of_a_vehicle_that_heads_there_and_east_after_a_quarter_turn() -> None:
    ahead = target(3.0, 0.0, 10.0, valid=True)
    assert_allclose(target_of(ahead, LEVEL), [3.0, 0.0, 10.0], atol=1e-9)
    assert_allclose(target_of(ahead, q_from_euler(0.0, 0.0, math.pi / 2)), [0.0, 3.0, 10.0], atol=1e-9)
    # Rolled right, the body's down leads to the left.
    assert_allclose(target_of(target(0, 0, 10, valid=True), q_from_euler(0.1, 0.0, 0.0)), [0, -0.998, 9.95], atol=1e-3)


@pytest.mark.parametrize(
    "message",
    [target(1, 1, 5, valid=True, frame=1), target(math.nan, 0, 5, valid=True), target(0, 0, 500, valid=True)],
)
def test_targets_that_ardupilot_refuses(message: object) -> None:
    assert target_of(message, LEVEL) is None


def velocity(frame: int, mask: int = 0x0DC7, north: float = 2.0) -> object:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        *(0, 1, 1, frame, mask, 0.0, 0.0, 0.0, north, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0)
    )


def test_velocities_in_the_frames_of_earth_and_body() -> None:
    east = q_from_euler(0.2, 0.1, math.pi / 2)
    assert_allclose(velocity_of(velocity(1), east), [2.0, 1.0, 0.5])
    assert_allclose(velocity_of(velocity(8), east), [-1.0, 2.0, 0.5], atol=1e-9)
    assert velocity_of(velocity(0), east) is None
    assert velocity_of(velocity(1, mask=0x0DF8), east) is None
    assert velocity_of(velocity(1, north=50.0), east) is None
