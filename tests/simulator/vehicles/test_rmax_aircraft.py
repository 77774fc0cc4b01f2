"""The RMAX as it is flown by a velocity and a heading."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.local import LocalFrame
from simulator.vehicles.rmax_aircraft import RmaxAircraft
from simulator.vehicles.state import VehicleState

FRAME = LocalFrame(math.radians(58.5), math.radians(15.6), 80.0)


def fly(
    seconds: float, velocity: tuple[float, float, float], yaw_rad: float, gust_std_m_s: float
) -> list[VehicleState]:
    rmax = RmaxAircraft(FRAME, np.array((30.0, -40.0, -120.0)), 0.3, 4, np.array((4.0, -2.0, 0.0)), gust_std_m_s)
    command = np.array(velocity)
    return [rmax.step(k * 5000, 0.005, command, yaw_rad) for k in range(1, round(seconds * 200) + 1)]


def test_hovers_in_wind_where_it_is() -> None:
    """Gusts of 1 m/s move it by less than 2 m: the leash and the position's terms hold it."""
    states = fly(40.0, (0.0, 0.0, 0.0), 0.3, 1.0)
    off = np.array([one.pos_ned_m for one in states]) - (30.0, -40.0, -120.0)
    assert np.abs(off).max() < 2.0
    assert np.abs(off[-2000:].mean(axis=0)).max() < 0.4


def test_flies_the_commanded_velocity_and_heading() -> None:
    late = fly(40.0, (5.0, -4.0, -1.0), 2.0, 0.5)[-2000:]
    assert_allclose(np.mean([one.vel_ned_m_s for one in late], axis=0), (5.0, -4.0, -1.0), atol=0.2)
    assert max(abs(one.yaw_rad - 2.0) for one in late) < 0.1


def test_it_does_not_stand() -> None:
    rmax = RmaxAircraft(FRAME, np.zeros(3), 0.0, 1, np.zeros(3), 0.0)
    with pytest.raises(ValueError, match="no skids"):
        rmax.step(1, 0.005, np.zeros(3), 0.0, floor_down_m=10.0)
