"""Numbers of modes, and aircraft that share their air."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.local import LocalFrame
from simulator.scenario import VehicleSection
from simulator.vehicles.kinds import VEHICLES, make_aircraft
from simulator.vehicles.pilot import FlightMode

FRAME = LocalFrame(math.radians(58.5), math.radians(15.6), 80.0)


def test_modes_have_ardupilots_numbers() -> None:
    """Copter: 3 AUTO, 5 LOITER, 9 LAND. Plane: 10 AUTO, 11 RTL, 12 LOITER, 15 GUIDED."""
    copter, plane = VEHICLES["multirotor"], VEHICLES["fixed_wing"]
    assert [copter.mode(number) for number in (3, 5, 9)] == [FlightMode.AUTO, FlightMode.LOITER, FlightMode.LAND]
    assert [plane.mode(number) for number in (10, 11, 12, 15)] == [
        FlightMode.AUTO,
        FlightMode.RTL,
        FlightMode.LOITER,
        FlightMode.GUIDED,
    ]
    # Stabilised flight needs a pilot with sticks, which nobody has here.
    assert copter.mode(0) is None
    assert plane.mode(2) is None
    assert plane.mode(math.nan) is None
    assert FlightMode.LAND not in plane.modes


@pytest.mark.parametrize("kind", list(VEHICLES))
def test_every_kind_meets_the_same_mean_wind(kind: str) -> None:
    """Its direction is the seed's, for the same weather under other wings."""
    section = VehicleSection.model_validate({"type": kind})
    winds = []
    for one in (VehicleSection(), section):
        aircraft = make_aircraft(one, FRAME, np.array((0.0, 0.0, -80.0)), 0.0, 11, 6.0, 0.0)
        winds.append(aircraft.step(5000, 0.005, np.array((5.0, 0.0, 0.0)), 0.0).wind_ned_m_s)
    assert_allclose(winds[1], winds[0], atol=1e-12)
    assert np.linalg.norm(winds[1]) == pytest.approx(6.0)
