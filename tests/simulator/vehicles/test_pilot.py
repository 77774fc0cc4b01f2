"""Where the pilot flies: checked by flying."""

from __future__ import annotations

import numpy as np

from estimator.geometry.local import LocalFrame
from simulator.vehicles.helicopter import Helicopter
from simulator.vehicles.pilot import FlightMode, Pilot
from simulator.vehicles.route import Route, make_route
from simulator.world.patch import Patch
from simulator.world.terrain import Terrain

FRAME = LocalFrame(np.radians(58.5), np.radians(15.6), 80.0)
FLAT = Terrain(Patch(800.0, -800.0, 41, 41, 40.0), np.zeros((41, 41), np.float32))
DT_S = 0.02
HOME = np.array([0.0, 0.0, 0.0])


class Flight:
    """A pilot with a helicopter."""

    def __init__(self, route: Route) -> None:
        self.pilot = Pilot(route, HOME, FLAT, 11.0, 4.0)
        heading = float(np.arctan2(*route.tangent_ne[0, ::-1]))
        self._helicopter = Helicopter(FRAME, route.start_ned_m, heading, 3, 3.0, 0.5)
        self.pos = route.start_ned_m
        self.track: list[np.ndarray] = []
        self.speed: list[float] = []

    def fly(self, seconds: float) -> None:
        for _ in range(int(seconds / DT_S)):
            velocity, yaw = self.pilot.command(self.pos, DT_S)
            state = self._helicopter.step(0, DT_S, velocity, yaw)
            self.pos = state.pos_ned_m
            self.track.append(self.pos)
            self.speed.append(float(np.hypot(*state.vel_ned_m_s[:2])))


def route(stops: int) -> Route:
    return make_route(2, FLAT, 400.0, 8, (100.0, 110.0), stops)


def test_goes_round_the_route_and_keeps_to_it() -> None:
    flight = Flight(route(0))
    length_m = 2.0 * len(route(0).pos_ned_m)
    flight.fly(1.35 * length_m / 9.0)
    points = route(0).pos_ned_m
    track = np.array(flight.track[::25])
    off_m = np.linalg.norm(track[:, None, :2] - points[None, :, :2], axis=2).min(axis=1)
    assert off_m.max() < 8.0
    reached = np.linalg.norm(points[:, None, :2] - track[None, :, :2], axis=2).min(axis=1)
    assert reached.max() < 10.0
    assert np.median(flight.speed[1000:]) > 8.0
    assert max(flight.speed) < 13.0


def test_hovers_at_its_stops() -> None:
    flight = Flight(route(2))
    flight.fly(2.0 * len(route(2).pos_ned_m) / 6.0)
    slow = np.array(flight.speed[500:]) < 1.5
    assert slow.sum() * DT_S > 4.0
    assert (~slow).sum() > slow.sum()


def test_goes_to_a_place_and_home_and_lands() -> None:
    flight = Flight(route(0))
    flight.fly(3.0)
    flight.pilot.fly(FlightMode.GUIDED, flight.pos, np.array([-60.0, 80.0, -90.0]))
    flight.fly(60.0)
    np.testing.assert_allclose(flight.pos, [-60.0, 80.0, -90.0], atol=2.0)
    flight.pilot.fly(FlightMode.LOITER, flight.pos)
    flight.fly(5.0)
    np.testing.assert_allclose(flight.pos, [-60.0, 80.0, -90.0], atol=3.0)
    flight.pilot.fly(FlightMode.RTL, flight.pos)
    flight.fly(90.0)
    np.testing.assert_allclose(flight.pos, [0.0, 0.0, -15.0], atol=2.0)
    flight.pilot.fly(FlightMode.LAND, flight.pos)
    flight.fly(40.0)
    assert -1.5 < flight.pos[2] <= 0.3
