"""Decides where an aeroplane flies: along the route by a point ahead on it, or in circles where others hover."""

from __future__ import annotations

import math

import numpy as np

from estimator.types import Float
from guidance.line_of_sight import ahead_on_circle
from simulator.vehicles.pilot import FlightMode, Pilot
from simulator.vehicles.route import Route
from simulator.world.terrain import Terrain

_POINT_SPACING_M = 2.0
_CLIMB_M_S = 2.5


class WingPilot(Pilot):
    """Turns mode and position into a velocity whose direction leads to a point ``look_ahead_s`` away.

    Goals are circled clockwise with ``radius_m``; a place to hover on the route is a full circle to its right, or as
    many seconds as were asked for if that is longer. Velocities and landing targets from a station are not flown.
    """

    def __init__(
        self, route: Route, home_ned_m: Float, terrain: Terrain, speed_m_s: float, hover_s: float, radius_m: float,
        look_ahead_s: float,
    ) -> None:  # fmt: skip
        super().__init__(route, home_ned_m, terrain, speed_m_s, hover_s)
        self._radius_m, self._ahead_m = radius_m, speed_m_s * look_ahead_s
        self._circle_s = max(hover_s, 2.0 * math.pi * radius_m / speed_m_s) if hover_s > 0.0 else 0.0
        self._centre: Float | None = None

    def fly(self, mode: FlightMode, pos_ned_m: Float, goal_ned_m: Float | None = None) -> None:
        """Change the mode; goals are circled. Raises ValueError for LAND, which it cannot."""
        if mode is FlightMode.LAND:
            message = "an aeroplane has no mode that lands"
            raise ValueError(message)
        super().fly(mode, pos_ned_m, goal_ned_m)
        self._centre, self._hover_left_s = None, 0.0

    def follow(self, vel_ned_m_s: Float) -> None:
        """Velocities are not taken: it could not keep them."""

    def command(self, pos_ned_m: Float, dt_s: float) -> tuple[Float, float]:
        """Velocity (3,) and heading to fly now."""
        if self.mode is not FlightMode.AUTO:
            velocity = self._towards_point(pos_ned_m, self._on_circle(pos_ned_m, self.goal_ned_m))
            return velocity, math.atan2(velocity[1], velocity[0])
        route, count = self._route, len(self._route.pos_ned_m)
        # While it circles, the route waits where it was left.
        while self._centre is None and self._is_nearer(pos_ned_m, (self._index + 1) % count, self._index):
            if self._index == self._next_stop and self._circle_s > 0.0:
                self._begin_circle()
                break
            self._index = (self._index + 1) % count
        ahead = route.pos_ned_m[(self._index + round(self._ahead_m / _POINT_SPACING_M)) % count]
        point = np.array((ahead[0], ahead[1], route.pos_ned_m[self._index, 2]))
        if self._centre is not None:
            point = self._on_circle(pos_ned_m, self._centre)
            self._hover_left_s -= dt_s
            if self._hover_left_s <= 0.0:
                self._centre = None
                self._index = (self._index + 1) % count
                self._next_stop = self._stop_after(self._index)
        velocity = self._towards_point(pos_ned_m, point)
        return velocity, math.atan2(velocity[1], velocity[0])

    def _begin_circle(self) -> None:
        """One that touches the route where it is left."""
        tangent, place = self._route.tangent_ne[self._index], self._route.pos_ned_m[self._index]
        right = np.array((-tangent[1], tangent[0], 0.0))
        self._centre, self._hover_left_s = place + self._radius_m * right, self._circle_s

    def _on_circle(self, pos_ned_m: Float, centre_ned_m: Float) -> Float:
        level = ahead_on_circle(pos_ned_m[:2], centre_ned_m[:2], self._radius_m, self._ahead_m)
        return np.array((level[0], level[1], centre_ned_m[2]))

    def _towards_point(self, pos_ned_m: Float, point_ned_m: Float) -> Float:
        offset = point_ned_m - pos_ned_m
        velocity = np.zeros(3)
        velocity[:2] = self._speed * offset[:2] / max(float(np.hypot(offset[0], offset[1])), 1e-6)
        velocity[2] = min(max(0.4 * float(offset[2]), -_CLIMB_M_S), _CLIMB_M_S)
        return velocity
