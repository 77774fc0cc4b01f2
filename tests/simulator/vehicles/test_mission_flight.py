"""Missions as they are flown: places out of items, their order, their stays, and what they end with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.local import LocalFrame
from simulator.vehicles.helicopter import Helicopter
from simulator.vehicles.mission_flight import MissionFlight, Stop, stops_of
from simulator.vehicles.pilot import FlightMode, Pilot
from simulator.vehicles.route import make_route
from simulator.world.patch import Patch
from simulator.world.terrain import Terrain

FRAME = LocalFrame(math.radians(58.5), math.radians(15.6), 80.0)
FLAT = Terrain(Patch(800.0, -800.0, 41, 41, 40.0), np.zeros((41, 41), np.float32))
HOME = np.array([0.0, 0.0, -4.0])
DT_S = 0.02


def item(command: int, north_m: float, east_m: float, alt_m: float, frame: int = 3, param1: float = 0.0) -> object:
    lat, lon, _ = FRAME.geodetic_from_ned(np.array([north_m, east_m, 0.0]))
    x, y = (round(math.degrees(float(angle)) * 1e7) for angle in (lat, lon))
    return mavlink.MAVLink_mission_item_int_message(1, 1, 0, frame, command, 0, 1, param1, 0, 0, 0, x, y, alt_m)


def test_heights_count_from_home_or_the_sea_and_what_is_no_place_is_left_out() -> None:
    home = item(16, 0.0, 0.0, 84.0, frame=0)
    items = [home, item(22, 0.0, 0.0, 30.0), item(178, 0.0, 0.0, 0.0, 2)]
    items += [item(16, 40.0, -30.0, 150.0, 0, 2.5), item(20, 0, 0, 0)]
    stops = stops_of(items, FRAME, HOME)

    assert [stop.seq for stop in stops] == [1, 3, 4]
    assert_allclose([stops[0].goal_ned_m, stops[1].goal_ned_m], [[0, 0, -34.0], [40.0, -30.0, -70.0]], atol=0.02)
    assert (stops[1].stay_s, stops[2].ends_with) == (2.5, 20)
    assert np.isnan(stops[2].goal_ned_m).all()


def test_it_is_flown_place_by_place_and_ends_at_home() -> None:
    route = make_route(2, FLAT, 400.0, 8, (100.0, 110.0), 0)
    pilot = Pilot(route, HOME, FLAT, 11.0, 4.0)
    helicopter = Helicopter(FRAME, route.start_ned_m, 0.0, 3, 3.0, 0.5)
    pos = route.start_ned_m
    here = math.nan
    stops = [
        Stop(1, np.array([here, here, -90.0])), Stop(2, np.array([60.0, 20.0, -90.0]), 4.0),
        Stop(4, np.array([-40.0, 50.0, -70.0])), Stop(5, np.full(3, here), ends_with=20),
    ]  # fmt: skip
    pilot.fly_mission(MissionFlight(stops, pos), pos)
    closest: dict[int, float] = {}
    seconds: dict[int, float] = {}
    for _ in range(round(240 / DT_S)):
        velocity, yaw = pilot.command(pos, DT_S)
        pos = helicopter.step(0, DT_S, velocity, yaw).pos_ned_m
        if pilot.mode is not FlightMode.AUTO:
            break
        seq = pilot.mission_seq
        closest[seq] = min(closest.get(seq, math.inf), float(np.linalg.norm(pilot.goal_ned_m - pos)))
        seconds[seq] = seconds.get(seq, 0.0) + DT_S

    assert list(closest) == [1, 2, 4, 5]
    assert seconds[2] > 4.0
    assert max(closest.values()) < 3.0
    assert pilot.mode is FlightMode.RTL
    assert_allclose(pilot.goal_ned_m[:2], HOME[:2])
    assert pilot.mission_seq == 0


def test_a_stay_counts_only_at_its_place() -> None:
    flight = MissionFlight(
        [Stop(1, np.array([50.0, 0.0, -10.0]), 2.0), Stop(2, np.array([0.0, 0.0, -10.0]))], np.zeros(3)
    )
    flight.step(np.array([40.0, 0.0, -10.0]), 10.0)
    assert flight.seq == 1
    flight.step(np.array([49.0, 0.0, -10.0]), 1.5)
    assert flight.seq == 1
    flight.step(np.array([49.0, 0.0, -10.0]), 0.6)
    assert flight.seq == 2
    flight.step(np.array([0.0, 0.0, -10.0]), 0.1)
    assert flight.ended_with == 17  # stays


def test_without_a_place_there_is_nothing_to_fly() -> None:
    with pytest.raises(ValueError, match="at least one place"):
        MissionFlight([], np.zeros(3))
