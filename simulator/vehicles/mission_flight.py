"""A mission as the pilot flies it: from place to place, with its stays, until it ends in a mode. No I/O, no clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.local import LocalFrame
from estimator.types import Float

_ARRIVED_M = 3.0
_STAY_FOREVER = mavlink.MAV_CMD_NAV_LOITER_UNLIM
_PASSED = (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT, mavlink.MAV_CMD_NAV_LOITER_TIME)
_RISE, _LAND, _RETURN = mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
_ABOVE_SEA = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """Item ``seq``: a place (3,), how long to stay there, and the command that ends the flight there, if one does.

    A coordinate that is NaN is where the vehicle is when the item's turn comes.
    """

    seq: int
    goal_ned_m: Float
    stay_s: float = 0.0
    ends_with: int | None = None


def stops_of(items: Sequence[Any], frame: LocalFrame, home_ned_m: Float) -> list[Stop]:
    """The places of MISSION_ITEM_INT messages, of which the first is home; what is no place is left out."""
    stops: list[Stop] = []
    for seq, item in enumerate(items[1:], 1):
        if item.command not in (*_PASSED, _STAY_FOREVER, _RISE, _LAND, _RETURN):
            continue
        goal = np.full(3, math.nan)
        if (item.x, item.y) != (0, 0) and item.command != _RETURN:
            lat, lon = math.radians(item.x / 1e7), math.radians(item.y / 1e7)
            goal[:2] = frame.ned_from_geodetic(lat, lon, frame.alt_m)[:2]
        if item.command not in (_LAND, _RETURN):
            goal[2] = frame.alt_m - item.z if item.frame in _ABOVE_SEA else home_ned_m[2] - item.z
        ends = item.command if item.command in (_STAY_FOREVER, _LAND, _RETURN) else None
        stops.append(Stop(seq, goal, max(item.param1, 0.0) if item.command in _PASSED else 0.0, ends))
    return stops


class MissionFlight:
    """Which stop comes next. After the last, ``ended_with`` is a command: land, return, or stay."""

    def __init__(self, stops: Sequence[Stop], pos_ned_m: Float) -> None:
        if not stops:
            message = "a mission to fly has at least one place"
            raise ValueError(message)
        self._stops = list(stops)
        self._index = -1
        self._left_s = 0.0
        self.goal_ned_m: Float = np.array(pos_ned_m)
        self.ended_with: int | None = None
        self._next(pos_ned_m)

    @property
    def seq(self) -> int:
        """The item that is being flown to."""
        return self._stops[self._index].seq

    def step(self, pos_ned_m: Float, dt_s: float) -> None:
        """Take the vehicle's place (3,) after ``dt_s`` more."""
        if self.ended_with is not None or float(np.linalg.norm(self.goal_ned_m - pos_ned_m)) > _ARRIVED_M:
            return
        self._left_s -= dt_s
        if self._left_s <= 0.0:
            self._next(pos_ned_m)

    def _next(self, pos_ned_m: Float) -> None:
        before = self._stops[self._index].ends_with if self._index >= 0 else None
        if before is not None or self._index + 1 == len(self._stops):
            self.ended_with = _STAY_FOREVER if before is None else before
            return
        self._index += 1
        stop = self._stops[self._index]
        self.goal_ned_m = np.where(np.isnan(stop.goal_ned_m), pos_ned_m, stop.goal_ned_m)
        self._left_s = stop.stay_s
