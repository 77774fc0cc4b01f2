"""Decides where to fly: along the route, to a place, home, or nowhere. ArduPilot's mode numbers."""

from __future__ import annotations

from enum import IntEnum
from math import atan2, hypot, sqrt

import numpy as np

from estimator.types import Float
from simulator.vehicles.mission_flight import MissionFlight
from simulator.vehicles.route import Route
from simulator.world.terrain import Terrain

_LOOK_AHEAD = 4
_DECELERATION_M_S2 = 1.1
_SIDE_ACCELERATION_M_S2 = 2.0
_CLIMB_M_S = 2.5
_ARRIVED_M = 1.5
_POINT_SPACING_M = 2.0
SKID_M = 0.3
# ArduPilot's GUID_TIMEOUT, and how long it lands by a target that it does not hear of any more.
_SET_POINT_S, _TARGET_S = 3.0, 1.0
_LANDING_M_S = 0.4
_ORBIT_GAIN_PER_S, _FOLLOWS_S = 0.4, 1.0


class FlightMode(IntEnum):
    """Custom modes of ArduPilot's copter and helicopter."""

    STABILIZE = 0
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    CIRCLE = 7
    LAND = 9


# By MAV_CMD: what a mission ends with.
_MODE_AFTER = {17: FlightMode.LOITER, 20: FlightMode.RTL, 21: FlightMode.LAND}


class Pilot:
    """Turns mode and position into a velocity and a heading to fly.

    With ``until_it_stands`` a landing goes on down until something stops it, wherever the ground is thought to be.
    """

    def __init__(
        self, route: Route, home_ned_m: Float, terrain: Terrain, speed_m_s: float, hover_s: float,
        until_it_stands: bool = False,
    ) -> None:  # fmt: skip
        self._terrain = terrain
        self._route, self.home_ned_m, self._speed, self._hover_s = route, home_ned_m, speed_m_s, hover_s
        self._limit_m_s = _speed_limits(route)
        self.mode = FlightMode.AUTO
        self._index = 0
        self._speed_now = 0.0
        self._hover_left_s = 0.0
        self._next_stop = self._stop_after(0)
        self._yaw = float(np.arctan2(route.tangent_ne[0, 1], route.tangent_ne[0, 0]))
        self.goal_ned_m: Float = np.array(route.start_ned_m)
        self._until_it_stands = until_it_stands
        self._set_point: Float | None = None
        self._set_point_s = self._target_s = 0.0
        self._orbit_m = 0.0
        self._mission: MissionFlight | None = None

    def fly(self, mode: FlightMode, pos_ned_m: Float, goal_ned_m: Float | None = None) -> None:
        """Change the mode; GUIDED needs a goal, the others take it from where the vehicle is."""
        self.mode = mode
        self._speed_now = 0.0
        self._set_point, self._target_s = None, 0.0
        self._mission = None
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

    def fly_mission(self, mission: MissionFlight, pos_ned_m: Float) -> None:
        """Fly a mission in place of the route."""
        self.fly(FlightMode.AUTO, pos_ned_m)
        self._mission = mission

    @property
    def mission_seq(self) -> int:
        """The number of the item that is flown to, 0 while none is."""
        return 0 if self._mission is None else self._mission.seq

    def orbit(self, centre_ned_m: Float, radius_m: float, pos_ned_m: Float) -> None:
        """Go round a point (3,) at its height, clockwise as seen from above where ``radius_m`` is positive."""
        self.fly(FlightMode.CIRCLE, pos_ned_m, centre_ned_m)
        self._orbit_m = radius_m

    @property
    def follows_set_points(self) -> bool:
        """Whether a velocity is flown that somebody else decides."""
        return self._set_point is not None

    def follow(self, vel_ned_m_s: Float) -> None:
        """Fly this velocity (3,) until the next comes, for three seconds at most and then none; in GUIDED only."""
        if self.mode is FlightMode.GUIDED:
            self._set_point, self._set_point_s = vel_ned_m_s, _SET_POINT_S

    def aim(self, target_ned_m: Float) -> None:
        """Land there (3,) from now on, while LAND is flown; where nothing more is heard of it, straight down."""
        if self.mode is FlightMode.LAND:
            self.goal_ned_m[:2], self._target_s = target_ned_m[:2], _TARGET_S

    def command(self, pos_ned_m: Float, dt_s: float) -> tuple[Float, float]:
        """Velocity (3,) and heading to fly now."""
        if self._mission is not None:
            self._mission.step(pos_ned_m, dt_s)
            if self._mission.ended_with is not None:
                self.fly(_MODE_AFTER[self._mission.ended_with], pos_ned_m)
                return self.command(pos_ned_m, dt_s)
            self.goal_ned_m = self._mission.goal_ned_m
            return self._towards(self.goal_ned_m - pos_ned_m, dt_s), self._yaw
        if self.mode is FlightMode.AUTO:
            return self._along_route(pos_ned_m, dt_s), self._yaw
        if self.mode is FlightMode.CIRCLE:
            return self._round(self.goal_ned_m - pos_ned_m, dt_s), self._yaw
        if self._set_point is not None:
            self._set_point_s -= dt_s
            return (self._set_point if self._set_point_s > 0.0 else np.zeros(3)), self._yaw
        if self._target_s > 0.0:
            self._target_s -= dt_s
            if self._target_s <= 0.0:
                self.goal_ned_m[:2] = pos_ned_m[:2]
        offset = self.goal_ned_m - pos_ned_m
        if self.mode is FlightMode.RTL and np.hypot(offset[0], offset[1]) < _ARRIVED_M:
            self.goal_ned_m[2] = self.home_ned_m[2] - 15.0
        if self.mode is FlightMode.LAND:
            self.goal_ned_m[2] = -float(self._terrain.at(pos_ned_m[0], pos_ned_m[1])) - SKID_M
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
        if self.mode is FlightMode.LAND and self._until_it_stands:
            velocity[2] = max(velocity[2], _LANDING_M_S)
        return velocity

    def _round(self, to_centre_ned_m: Float, dt_s: float) -> Float:
        """Along the tangent of the circle and towards it; from far off that is straight to it."""
        radius_m = abs(self._orbit_m)
        distance = float(np.hypot(to_centre_ned_m[0], to_centre_ned_m[1]))
        # At the centre itself any way out will do.
        inward = to_centre_ned_m[:2] / distance if distance > 0.1 else np.array((-1.0, 0.0))
        side = np.array((inward[1], -inward[0])) * (1.0 if self._orbit_m > 0.0 else -1.0)
        wanted = min(self._speed, sqrt(_SIDE_ACCELERATION_M_S2 * radius_m))
        self._speed_now += min(max(wanted - self._speed_now, -2.5 * dt_s), 1.2 * dt_s)
        # A velocity that turns is followed late: without a lead inwards the circle comes out too wide.
        lead_m_s = _FOLLOWS_S * self._speed_now**2 / max(distance, radius_m)
        closing = _ORBIT_GAIN_PER_S * (distance - radius_m) + lead_m_s
        closing = min(max(closing, -self._speed_now), self._speed_now)
        around = sqrt(self._speed_now**2 - closing**2)
        north, east = (closing * inward + around * side).tolist()
        self._yaw = atan2(inward[1], inward[0])
        return np.array([north, east, min(max(0.6 * float(to_centre_ned_m[2]), -_CLIMB_M_S), _CLIMB_M_S)])

    def _along_route(self, pos_ned_m: Float, dt_s: float) -> Float:
        route, count = self._route, len(self._route.pos_ned_m)
        while self._is_nearer(pos_ned_m, (self._index + 1) % count, self._index):
            self._index = (self._index + 1) % count
        to_stop_m = ((self._next_stop - self._index) % count) * _POINT_SPACING_M
        if self._hover_left_s > 0.0:
            return self._hover(pos_ned_m, dt_s)
        if self._next_stop >= 0 and to_stop_m < 5.0:
            self._hover_left_s = self._hover_s
        allowed = min(self._speed, float(self._limit_m_s[self._index]))
        if self._next_stop >= 0:
            allowed = min(allowed, sqrt(2 * _DECELERATION_M_S2 * max(to_stop_m - 3.0, 0.3)))
        self._speed_now += min(max(allowed - self._speed_now, -2.5 * dt_s), 1.2 * dt_s)
        north, east, _ = (route.pos_ned_m[(self._index + _LOOK_AHEAD) % count] - pos_ned_m).tolist()
        share = self._speed_now / max(hypot(north, east), 1e-6)
        tangent = route.tangent_ne[(self._index + 6) % count]
        self._yaw = atan2(tangent[1], tangent[0])
        climb = 0.5 * float(route.pos_ned_m[self._index, 2] - pos_ned_m[2])
        return np.array([share * north, share * east, min(max(climb, -_CLIMB_M_S), _CLIMB_M_S)])

    def _is_nearer(self, pos_ned_m: Float, index: int, other: int) -> bool:
        first, second = self._route.pos_ned_m[index] - pos_ned_m, self._route.pos_ned_m[other] - pos_ned_m
        return float(first @ first) < float(second @ second)

    def _hover(self, pos_ned_m: Float, dt_s: float) -> Float:
        self._hover_left_s -= dt_s
        offset = self._route.pos_ned_m[self._next_stop] - pos_ned_m
        if self._hover_left_s <= 0.0:
            self._next_stop = self._stop_after(self._index + 4)
            self._speed_now = 0.0
        hold: Float = np.clip(0.5 * offset, -2.0, 2.0)
        return hold

    def _stop_after(self, index: int) -> int:
        """Index of the next hover stop on the route, -1 when it has none."""
        stops, count = self._route.hover_at, len(self._route.pos_ned_m)
        return min(stops, key=lambda stop: (stop - index - 1) % count) if stops else -1


def _speed_limits(route: Route) -> Float:
    """Speed (n,) at which each point may be passed, so that the bends ahead can still be flown."""
    limit = np.sqrt(_SIDE_ACCELERATION_M_S2 / np.maximum(route.curvature_per_m, 1e-3))
    best = limit.copy()
    for ahead in range(1, 40):
        later = np.roll(limit, -ahead)
        best = np.minimum(best, np.sqrt(later**2 + 2 * _DECELERATION_M_S2 * ahead * _POINT_SPACING_M))
    return best
