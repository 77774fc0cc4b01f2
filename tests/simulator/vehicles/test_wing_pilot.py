"""Where an aeroplane is told to fly: ahead on the route, around goals, and not where it cannot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from simulator.vehicles.pilot import FlightMode
from simulator.vehicles.route import Route
from simulator.vehicles.wing_pilot import WingPilot
from simulator.world.patch import Patch
from simulator.world.terrain import Terrain

TERRAIN = Terrain(Patch(400.0, -400.0, 9, 9, 100.0), np.zeros((9, 9), np.float32))
HOME = np.zeros(3)
SPEED_M_S, RADIUS_M, LOOK_S, DT_S = 20.0, 60.0, 2.0, 0.1


def circle_route(hover_at: tuple[int, ...] = ()) -> Route:
    """A circle of 200 m radius, clockwise from north, 80 m up."""
    count = round(2 * math.pi * 200.0 / 2.0)
    angle = 2 * math.pi * np.arange(count) / count
    points = np.column_stack((200.0 * np.cos(angle), 200.0 * np.sin(angle), np.full(count, -80.0)))
    tangent = np.column_stack((-np.sin(angle), np.cos(angle)))
    return Route(points, tangent, np.full(count, 1 / 200.0), hover_at)


def pilot(hover_at: tuple[int, ...] = (), hover_s: float = 5.0) -> WingPilot:
    return WingPilot(circle_route(hover_at), HOME, TERRAIN, SPEED_M_S, hover_s, RADIUS_M, LOOK_S)


def test_it_is_led_to_a_point_ahead_on_the_route() -> None:
    """40 m on: a chord that leaves the tangent by 40 / 200 / 2 rad; the height is that of where it is."""
    velocity, yaw = pilot().command(np.array((200.0, 0.0, -75.0)), DT_S)
    assert np.hypot(*velocity[:2]) == pytest.approx(SPEED_M_S)
    assert yaw == pytest.approx(math.pi / 2 + 0.1, abs=0.01)
    assert velocity[2] == pytest.approx(0.4 * -5.0)


def test_climb_is_limited() -> None:
    velocity, _ = pilot().command(np.array((200.0, 0.0, -20.0)), DT_S)
    assert velocity[2] == pytest.approx(-2.5)


def test_a_place_to_hover_is_a_whole_circle_to_the_right() -> None:
    """Flown along exactly what is commanded: back at the place, having been once around the centre."""
    one, pos = pilot(hover_at=(40,)), np.array((200.0, 0.0, -80.0))
    route = circle_route()
    centre = route.pos_ned_m[40, :2] * (1 - RADIUS_M / 200.0)
    turned, before, seconds = 0.0, None, 0
    for _ in range(400):
        velocity, _ = one.command(pos, DT_S)
        pos = pos + DT_S * velocity
        bearing = math.atan2(pos[1] - centre[1], pos[0] - centre[0])
        if one._centre is not None:
            assert_allclose(one._centre[:2], centre, atol=1e-6)
            turned += 0.0 if before is None else math.remainder(bearing - before, 2 * math.pi)
            before, seconds = bearing, seconds + 1
    # 2 pi 60 / 20 = 18.8 s, longer than the 5 s that were asked for. Flying straight at a point ahead cuts the corner.
    assert seconds * DT_S == pytest.approx(18.8, abs=0.3)
    assert turned > 2 * math.pi
    assert one._centre is None


def test_without_a_time_to_hover_there_is_no_circle() -> None:
    one, pos = pilot(hover_at=(40,), hover_s=0.0), np.array((200.0, 0.0, -80.0))
    for _ in range(200):
        pos = pos + DT_S * one.command(pos, DT_S)[0]
        assert one._centre is None
    assert float(np.hypot(*pos[:2])) == pytest.approx(200.0, abs=6.0)


def test_goals_are_circled_at_their_height() -> None:
    one = pilot()
    one.fly(FlightMode.GUIDED, np.array((200.0, 0.0, -80.0)), np.array((0.0, 0.0, -100.0)))
    velocity, _ = one.command(np.array((60.0, 0.0, -100.0)), DT_S)
    # On the circle in the north: eastwards, inwards by half of 40 / 60 rad.
    assert math.atan2(velocity[1], velocity[0]) == pytest.approx(math.pi / 2 + 40.0 / 60.0 / 2, abs=1e-6)
    assert velocity[2] == pytest.approx(0.0)


def test_what_it_cannot_is_refused() -> None:
    one = pilot()
    with pytest.raises(ValueError, match="no mode that lands"):
        one.fly(FlightMode.LAND, np.zeros(3))
    one.fly(FlightMode.GUIDED, np.zeros(3), np.array((0.0, 0.0, -100.0)))
    one.follow(np.array((1.0, 0.0, 0.0)))
    assert not one.follows_set_points
