"""Decides where to fly: along the route, to a place, home, or nowhere. ArduPilot's mode numbers."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from estimator.types import Float
from simulator.vehicles.route import Route

_LOOK_AHEAD_M = 9.0
_DECELERATION_M_S2 = 1.1
_SIDE_ACCELERATION_M_S2 = 2.0
_CLIMB_M_S = 2.5
_ARRIVED_M = 1.5
_POINT_SPACING_M = 2.0


class FlightMode(IntEnum):
    """Custom modes of ArduPilot's copter and helicopter."""

    STABILIZE = 0
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9


class Pilot:
    """Turns mode and position into a velocity and a heading to fly."""

    def __init__(self, route: Route, home_ned_m: Float, speed_m_s: float, hover_s: float) -> None:
        self._route, self.home_ned_m, self._speed, self._hover_s = route, home_ned_m, speed_m_s, hover_s
        self.mode = FlightMode.AUTO
        self._index = 0
        self._speed_now = 0.0
        self._hover_left_s = 0.0
        self._next_stop = self._stop_after(0)
        self._yaw = float(np.arctan2(route.tangent_ne[0, 1], route.tangent_ne[0, 0]))
        self.goal_ned_m: Float = np.array(route.start_ned_m)

    def fly(self, mode: FlightMode, pos_ned_m: Float, goal_ned_m: Float | None = None) -> None:
        """Change the mode; GUIDED needs a goal, the others take it from where the vehicle is."""
        self.mode = mode
        self._speed_now = 0.0
        if goal_ned_m is not None:
            self.goal_ned_m = np.array(goal_ned_m)
        elif mode is FlightMode.RTL:
            self.goal_ned_m = np.array([self.home_ned_m[0], self.home_ned_m[1], pos_ned_m[2]])
        elif mode is FlightMode.LAND:
            self.goal_ned_m = np.array([pos_ned_m[0], pos_ned_m[1], self.home_ned_m[2]])
        elif mode is FlightMode.AUTO:
            self._index = int(np.argmin(np.linalg.norm(self._route.pos_ned_m - pos_ned_m, axis=1)))
            self._next_stop = self._stop_after(self._index)
        else:
            self.goal_ned_m = np.array(pos_ned_m)

    def command(self, pos_ned_m: Float, dt_s: float, ground_down_m: float) -> tuple[Float, float]:
        """Velocity (3,) and heading to fly now."""
        if self.mode is FlightMode.AUTO:
            return self._along_route(pos_ned_m, dt_s), self._yaw
        offset = self.goal_ned_m - pos_ned_m
        if self.mode is FlightMode.RTL and np.hypot(offset[0], offset[1]) < _ARRIVED_M:
            self.goal_ned_m[2] = self.home_ned_m[2] - 15.0
        if self.mode is FlightMode.LAND:
            self.goal_ned_m[2] = ground_down_m - 0.3
        return self._towards(offset, dt_s), self._yaw

    def _towards(self, offset_ned_m: Float, dt_s: float) -> Float:
        distance = float(np.hypot(offset_ned_m[0], offset_ned_m[1]))
        wanted = min(self._speed, np.sqrt(2 * _DECELERATION_M_S2 * distance), 0.6 * distance)
        self._speed_now += float(np.clip(wanted - self._speed_now, -4 * dt_s, 1.5 * dt_s))
        velocity = np.zeros(3)
        if distance > 0.1:
            velocity[:2] = offset_ned_m[:2] / distance * min(self._speed_now, 0.8 * distance)
        if distance > 15.0:
            self._yaw = float(np.arctan2(offset_ned_m[1], offset_ned_m[0]))
        climb = 1.0 if self.mode is FlightMode.LAND and abs(offset_ned_m[2]) < 8 else _CLIMB_M_S
        velocity[2] = np.clip(0.6 * offset_ned_m[2], -climb, climb)
        return velocity

    def _along_route(self, pos_ned_m: Float, dt_s: float) -> Float:
        route, count = self._route, len(self._route.pos_ned_m)
        window = (self._index + np.arange(12)) % count
        self._index = int(window[np.argmin(np.linalg.norm(route.pos_ned_m[window] - pos_ned_m, axis=1))])
        to_stop_m = ((self._next_stop - self._index) % count) * _POINT_SPACING_M
        if self._hover_left_s > 0.0:
            self._hover_left_s -= dt_s
            offset = route.pos_ned_m[self._next_stop] - pos_ned_m
            if self._hover_left_s <= 0.0:
                self._next_stop = self._stop_after(self._index + 4)
                self._speed_now = 0.0
            return np.clip(0.5 * offset, -2.0, 2.0)
        if self._next_stop >= 0 and to_stop_m < 5.0:
            self._hover_left_s = self._hover_s
        allowed = self._speed
        for ahead in (0, 8, 16, 24, 32):
            bend = route.curvature_per_m[(self._index + ahead) % count]
            there = np.sqrt(_SIDE_ACCELERATION_M_S2 / max(bend, 1e-3))
            allowed = min(allowed, np.sqrt(there**2 + 2 * _DECELERATION_M_S2 * ahead * _POINT_SPACING_M))
        if self._next_stop >= 0:
            allowed = min(allowed, np.sqrt(2 * _DECELERATION_M_S2 * max(to_stop_m - 3.0, 0.3)))
        self._speed_now += float(np.clip(allowed - self._speed_now, -2.5 * dt_s, 1.2 * dt_s))
        carrot = route.pos_ned_m[(self._index + int(_LOOK_AHEAD_M / _POINT_SPACING_M)) % count]
        offset = carrot - pos_ned_m
        direction = offset[:2] / max(float(np.hypot(offset[0], offset[1])), 1e-6)
        tangent = route.tangent_ne[(self._index + 6) % count]
        self._yaw = float(np.arctan2(tangent[1], tangent[0]))
        climb = np.clip(0.5 * (route.pos_ned_m[self._index, 2] - pos_ned_m[2]), -_CLIMB_M_S, _CLIMB_M_S)
        return np.array([*(direction * self._speed_now), climb])

    def _stop_after(self, index: int) -> int:
        """Index of the next hover stop on the route, -1 when it has none."""
        stops, count = self._route.hover_at, len(self._route.pos_ned_m)
        return min(stops, key=lambda stop: (stop - index - 1) % count) if stops else -1
