"""An aeroplane as it is flown by a velocity: what it takes of it, and that it flies on without one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.local import LocalFrame
from simulator.vehicles.airframes import OSPREY, PING_WING, Airframe
from simulator.vehicles.state import VehicleState
from simulator.vehicles.wing_aircraft import BANK_MAX_RAD, WingAircraft, turn_radius_m

FRAME = LocalFrame(math.radians(58.5), math.radians(15.6), 80.0)
BOTH = pytest.mark.parametrize("airframe", [OSPREY, PING_WING], ids=lambda one: one.name)


def fly(
    airframe: Airframe, seconds: float, velocity: tuple[float, float, float], gust_std_m_s: float = 0.8, seed: int = 4
) -> list[VehicleState]:
    wind = np.array((3.0, -2.0, 0.0))
    wing = WingAircraft(FRAME, np.array((30.0, -40.0, -120.0)), 0.3, seed, wind, gust_std_m_s, airframe)
    command = np.array(velocity)
    return [wing.step(k * 5000, 0.005, command, 0.0) for k in range(1, round(seconds * 200) + 1)]


@BOTH
def test_direction_and_climb_are_taken_and_the_airspeed_kept(airframe: Airframe) -> None:
    """South-west, 1.5 m/s up, in wind and gusts; the speed of the command does not count."""
    states = fly(airframe, 60.0, (-4.0, -4.0, -1.5))
    late = states[-6000:]
    velocity = np.mean([one.vel_ned_m_s for one in late], axis=0)
    assert math.degrees(math.atan2(velocity[1], velocity[0])) == pytest.approx(-135.0, abs=1.5)
    assert -velocity[2] == pytest.approx(1.5, abs=0.15)
    air = [float(np.linalg.norm(one.vel_ned_m_s - one.wind_ned_m_s)) for one in late]
    assert np.mean(air) == pytest.approx(airframe.airspeed_m_s, abs=0.2)
    # Gusts change the airspeed at once, by four of their deviations at most.
    assert np.abs(np.array(air) - airframe.airspeed_m_s).max() < 4.0
    assert max(abs(one.roll_rad) for one in states) < BANK_MAX_RAD + math.radians(8.0)


@BOTH
def test_height_is_kept_in_the_steepest_turn(airframe: Airframe) -> None:
    """Half a turn and more with 35 degrees of bank: 3 m at most are lost or gained."""
    states = fly(airframe, 12.0, (-10.0, 0.0, 0.0), 0.0)
    assert max(one.roll_rad for one in states) == pytest.approx(BANK_MAX_RAD, abs=math.radians(4.0))
    assert np.abs(np.array([one.pos_ned_m[2] for one in states]) + 120.0).max() < 3.0


def test_without_a_velocity_it_circles() -> None:
    """20 degrees of bank to the right: 65 s for a turn with 25 m/s; it stays where it is but for the wind."""
    states = fly(OSPREY, 90.0, (0.0, 0.0, 0.0), 0.0)
    late = states[2000:]
    assert np.degrees(np.mean([one.roll_rad for one in late])) == pytest.approx(20.0, abs=1.5)
    headings = np.unwrap([one.yaw_rad for one in late])
    seconds = 2 * math.pi * (late[-1].t_us - late[0].t_us) / 1e6 / (headings[-1] - headings[0])
    assert seconds == pytest.approx(2 * math.pi * 25.0 / (9.81 * math.tan(math.radians(20.0))), rel=0.1)


def test_seeds_differ_and_repeat() -> None:
    one, same, other = (fly(PING_WING, 2.0, (5.0, 0.0, 0.0), seed=seed)[-1].pos_ned_m for seed in (1, 1, 2))
    assert_allclose(one, same, rtol=0, atol=0)
    assert np.linalg.norm(one - other) > 0.01


def test_circles_can_be_flown() -> None:
    """With a bank of 29 degrees in still air."""
    for airframe in (OSPREY, PING_WING):
        bank = math.atan(airframe.airspeed_m_s**2 / (9.81 * turn_radius_m(airframe)))
        assert math.degrees(bank) == pytest.approx(29.3, abs=0.1)


def test_it_does_not_stand() -> None:
    wing = WingAircraft(FRAME, np.zeros(3), 0.0, 1, np.zeros(3), 0.0, OSPREY)
    with pytest.raises(ValueError, match="no wheels"):
        wing.step(1, 0.005, np.zeros(3), 0.0, floor_down_m=10.0)
