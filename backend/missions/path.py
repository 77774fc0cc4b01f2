"""The path of a plan as it would be flown, and what of it an operator should look at before it is sent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from backend.link.events import VehicleType
from backend.missions.plan import Plan
from estimator.geometry.local import LocalFrame
from estimator.types import Float
from guidance.geofence import Geofence, InclusionRule
from guidance.mission import AltitudeDatum, Home, MissionItem
from guidance.plan_path import PathLimits, PlannedPath, PlanPoint, planned_path
from guidance.velocity_profile import FlightEnvelope, turn_speeds

_DO_CHANGE_SPEED, _RETURN, _LAND, _TAKEOFF, _DELAY = 178, 20, 21, 22, 93
_STAYS = frozenset({17, 18, 19, 31})
_FLOWN = _STAYS | {16, _LAND, _TAKEOFF, 82, 84, 85}
_STAY_PARAMETER_IS_SECONDS = frozenset({16, 19})
_ENDS = frozenset({17, _RETURN, _LAND, 85})
_SAME_PLACE_M = 0.05
_DEFAULT_CRUISE_M_S = {True: 5.0, False: 15.0}
_MOST_M_S = 100.0
# A plan over more than this is no plan for a small aircraft, and a flat frame would not fit it.
_FARTHEST_M = 100_000.0

HOVERING = PathLimits()
FIXED_WING = PathLimits(
    FlightEnvelope(roll_max_rad=math.radians(35.0), load_factor_max=1.22), climb_m_s=3.0,
    climb_max_rad=math.radians(12.0), descent_max_rad=math.radians(12.0), hovers=False,
)  # fmt: skip


class ProblemKind(StrEnum):
    """What is wrong with a part of a path."""

    FENCE = "fence"
    EXCLUSION = "exclusion"
    BEND = "bend"
    CLIMB = "climb"
    DESCENT = "descent"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class PathProblem:
    """In the operator's words; ``from_item`` and ``to_item`` are of its leg (None: home).

    The place is where it begins, of a bend where that is tightest.
    """

    kind: ProblemKind
    text: str
    from_item: int | None = None
    to_item: int | None = None
    place_deg: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlanPath:
    """``path`` is None where there are no two places to fly between. ``items`` (n,) are the numbers of its points."""

    path: PlannedPath | None
    lat_deg: Float
    lon_deg: Float
    items: tuple[int | None, ...]
    problems: tuple[PathProblem, ...]


@dataclass(slots=True)
class _Point:
    point: PlanPoint
    item: int | None
    rises: bool = False


def path_of(plan: Plan, vehicle_type: VehicleType, rule: InclusionRule) -> PlanPath:
    """The path of a plan for a kind of vehicle, with heights above home.

    Jumps are not followed: each item is flown once. Circles are points. Heights above the ground count from home.
    """
    limits = FIXED_WING if vehicle_type is VehicleType.FIXED_WING else HOVERING
    origin = _origin(plan)
    nothing = np.zeros(0)
    if origin is None:
        return PlanPath(None, nothing, nothing, (), ())
    frame = LocalFrame(math.radians(origin.lat_deg), math.radians(origin.lon_deg), origin.alt_amsl_m)
    points, notes = _points(plan, frame, limits)
    far_m = max((float(np.linalg.norm(p.point.pos_ned_m[:2])) for p in points), default=0.0)
    if far_m > _FARTHEST_M:
        text = (
            f"an item lies {far_m / 1e3:.0f} km from home: no path is drawn over more than {_FARTHEST_M / 1e3:.0f} km"
        )
        return PlanPath(None, nothing, nothing, (), (PathProblem(ProblemKind.UNKNOWN, text), *notes))
    if len(points) < 2:
        return PlanPath(None, nothing, nothing, (), tuple(notes))
    path = planned_path([p.point for p in points], limits)
    lat, lon = frame.geodetic_from_ne(path.pos_ned_m[:, :2])
    lat_deg, lon_deg = np.degrees(lat), np.degrees(lon)
    found = _problems(path, points, limits, plan.fence, rule, lat_deg, lon_deg)
    return PlanPath(path, lat_deg, lon_deg, tuple(p.item for p in points), (*found, *notes))


def _origin(plan: Plan) -> Home | None:
    if plan.mission.home is not None:
        return plan.mission.home
    places = [item.place_deg for item in plan.mission.items if item.place_deg is not None]
    return Home(*places[0], 0.0) if places else None


def _cruise_m_s(plan: Plan, limits: PathLimits) -> float:
    """QGroundControl's own estimate of the speed, which it keeps in the plan."""
    value = plan.document["mission"].get("hoverSpeed" if limits.hovers else "cruiseSpeed")
    sensible = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value <= _MOST_M_S
    return float(value) if sensible else _DEFAULT_CRUISE_M_S[limits.hovers]


def _points(plan: Plan, frame: LocalFrame, limits: PathLimits) -> tuple[list[_Point], list[PathProblem]]:
    """Places to fly through, no two neighbours the same, and what of the plan could not be drawn."""
    speed_m_s = _cruise_m_s(plan, limits)
    points: list[_Point] = []
    notes: list[PathProblem] = []

    def add(pos: Float, item: int | None, stops: bool = False, stay_s: float = 0.0, rises: bool = False) -> None:
        stops = stops and limits.hovers
        if points and float(np.linalg.norm(pos - points[-1].point.pos_ned_m)) < _SAME_PLACE_M:
            last = points[-1].point
            both = PlanPoint(last.pos_ned_m, speed_m_s, last.stops or stops, last.stay_s + stay_s)
            points[-1] = _Point(both, points[-1].item if item is None else item, points[-1].rises)
        else:
            points.append(_Point(PlanPoint(pos, speed_m_s, stops, stay_s), item, rises))

    home = np.zeros(3)
    for number, item in enumerate(plan.mission.items, 1):
        if item.command == _DO_CHANGE_SPEED and 0.0 < item.params[1] <= _MOST_M_S:
            speed_m_s = item.params[1]
            if points:
                last = points[-1].point
                points[-1].point = PlanPoint(last.pos_ned_m, speed_m_s, last.stops, last.stay_s)
        if item.command == _DELAY and points and item.params[0] > 0.0:
            add(points[-1].point.pos_ned_m, None, True, item.params[0])
        if item.command == _RETURN:
            if plan.mission.home is None:
                notes.append(PathProblem(ProblemKind.UNKNOWN, f"item {number} returns home, and the plan has no home"))
            elif points:
                add(np.array([0.0, 0.0, points[-1].point.pos_ned_m[2]]), number, True)
                add(home, None, True, rises=True)
        if item.command in _FLOWN:
            pos = _place(item, frame, points[-1].point.pos_ned_m if points else home)
            if item.command == _TAKEOFF and not points:
                add(np.array([pos[0], pos[1], 0.0]), None, True)
            if item.command == _LAND:
                above = points[-1].point.pos_ned_m[2] if points else pos[2]
                add(np.array([pos[0], pos[1], above]), number, True)
            stay_s = item.params[0] if item.command in _STAY_PARAMETER_IS_SECONDS else 0.0
            vertical = item.command in (_TAKEOFF, _LAND)
            add(pos, number, stay_s > 0.0 or vertical or item.command in _STAYS, max(stay_s, 0.0), vertical)
        if item.datum is AltitudeDatum.GROUND and item.command in _FLOWN:
            text = f"item {number} counts its height from the ground: it is drawn as a height above home"
            notes.append(PathProblem(ProblemKind.UNKNOWN, text, to_item=number))
        if item.command in _ENDS:
            break
    return points, notes


def _place(item: MissionItem, frame: LocalFrame, before_ned_m: Float) -> Float:
    """Where an item lies; what it leaves open is as before."""
    pos = np.array(before_ned_m)
    place = item.place_deg
    if place is not None:
        pos[:2] = frame.ned_from_geodetic(math.radians(place[0]), math.radians(place[1]), frame.alt_m)[:2]
    if item.alt_m is not None:
        pos[2] = -(item.alt_m - frame.alt_m if item.datum is AltitudeDatum.AMSL else item.alt_m)
    return pos


def _problems(
    path: PlannedPath, points: Sequence[_Point], limits: PathLimits, fence: Geofence, rule: InclusionRule,
    lat_deg: Float, lon_deg: Float,
) -> list[PathProblem]:  # fmt: skip
    """One for each leg and kind, along the path."""
    straight_up = np.array([points[k].rises for k in range(1, len(points))])[path.leg]
    slowest = turn_speeds(1.0 / path.turn_radius_m, limits.envelope).least_m_s
    floor_m_s = path.speed_m_s if not limits.hovers else np.full(len(slowest), limits.slowest_turn_m_s)
    wrong = {
        ProblemKind.FENCE: fence.left_by(lat_deg, lon_deg, rule),
        ProblemKind.EXCLUSION: fence.entered_by(lat_deg, lon_deg),
        ProblemKind.BEND: slowest < floor_m_s,
        ProblemKind.CLIMB: (path.climb_rad > limits.climb_max_rad + 1e-6) & ~straight_up,
        ProblemKind.DESCENT: (path.climb_rad < -limits.descent_max_rad - 1e-6) & ~straight_up,
    }
    found: list[tuple[int, PathProblem]] = []
    for kind, mask in wrong.items():
        for leg in np.unique(path.leg[mask]).tolist():
            on_leg = np.flatnonzero(mask & (path.leg == leg))
            at = int(on_leg[0])
            if kind is ProblemKind.BEND:
                at = int(on_leg[np.argmin(path.turn_radius_m[on_leg])])
            items = (points[leg].item, points[leg + 1].item)
            text = f"{_leg_words(*items)} {_words(kind, path, on_leg, limits)}"
            found.append((at, PathProblem(kind, text, *items, (float(lat_deg[at]), float(lon_deg[at])))))
    return [problem for _, problem in sorted(found, key=lambda entry: entry[0])]


def _words(kind: ProblemKind, path: PlannedPath, on_leg: NDArray[np.int64], limits: PathLimits) -> str:
    match kind:
        case ProblemKind.FENCE:
            return "leaves the fence"
        case ProblemKind.EXCLUSION:
            return "enters a zone to stay out of"
        case ProblemKind.BEND:
            radius_m = float(path.turn_radius_m[on_leg].min())
            speed_m_s = float(path.allowed_turn_m_s[on_leg].min())
            return f"has a bend of {radius_m:.1f} m radius: no faster than {speed_m_s:.1f} m/s there"
        case ProblemKind.CLIMB:
            steepest = math.degrees(float(path.climb_rad[on_leg].max()))
            return f"climbs at {steepest:.0f}°, more than {math.degrees(limits.climb_max_rad):.0f}°"
        case _:
            steepest = -math.degrees(float(path.climb_rad[on_leg].min()))
            return f"descends at {steepest:.0f}°, more than {math.degrees(limits.descent_max_rad):.0f}°"


def _leg_words(from_item: int | None, to_item: int | None) -> str:
    if from_item is not None and from_item == to_item:
        return f"item {from_item}"
    names = ["home" if item is None else f"item {item}" for item in (from_item, to_item)]
    return f"the leg from {names[0]} to {names[1]}"
