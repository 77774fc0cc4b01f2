"""QGroundControl's plan file (.plan, JSON), read and written.

Its format is at docs.qgroundcontrol.com, "Plan File Format": latitude before longitude; ``mission`` and ``geoFence`` of
version 2, ``rallyPoints`` of version 1 or 2. The document is kept as it is, so that what is not understood here (camera
settings of a survey, altitude modes) is there again when it is written.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any, NoReturn, TypeVar

from backend.errors import PlanFileError
from backend.link.events import Autopilot, VehicleType
from backend.missions.plan import MAX_RALLY_POINTS, Plan, RallyPoint
from backend.missions.waypoint_file import MARK, read_waypoints
from guidance.geofence import FenceCircle, FencePolygon, Geofence
from guidance.mission import DO_JUMP, MAX_ITEMS, PARAMETERS, Home, Mission, MissionError, MissionItem

MAX_BYTES = 4_000_000
_MAX_DEPTH = 100  # what can be read must also be writable
T = TypeVar("T")
_NAME = "plan"
_FIRMWARE = {Autopilot.ARDUPILOT: 3, Autopilot.PX4: 12, Autopilot.OTHER: 0}
_VEHICLE = {
    VehicleType.FIXED_WING: 1, VehicleType.MULTIROTOR: 2, VehicleType.HELICOPTER: 4, VehicleType.VTOL: 20,
    VehicleType.OTHER: 0,
}  # fmt: skip
# QGroundControl wants both; they only serve its estimate of the flying time.
_CRUISE_M_S, _HOVER_M_S = 15.0, 5.0


def read_plan(data: bytes) -> Plan:
    """The plan of a file's content, ``.plan`` or waypoints; PlanFileError says where it is wrong."""
    if len(data) > MAX_BYTES:
        raise PlanFileError(_NAME, f"{len(data)} bytes, a plan has at most {MAX_BYTES}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise PlanFileError(f"byte {error.start}", "not UTF-8 text: this is no plan") from None
    if text.lstrip().startswith(MARK):
        mission = read_waypoints(text)
        return plan_of(document_of(mission, Geofence(), ()))
    return plan_of(_parsed(text))


def plan_of(document: object) -> Plan:
    """The plan of a parsed document; PlanFileError as ``read_plan``."""
    top = _object(document, _NAME)
    if top.get("fileType") != "Plan":
        raise PlanFileError("fileType", f"'Plan' expected, not {_shown(top.get('fileType'))}")
    _version(top, "", (1,))
    if "mission" not in top:
        raise PlanFileError("mission", "missing: a plan has one, be it without items")
    mission = _mission(_object(top["mission"], "mission"))
    fence = _fence(_object(top["geoFence"], "geoFence")) if "geoFence" in top else Geofence()
    rally = _rally(_object(top["rallyPoints"], "rallyPoints")) if "rallyPoints" in top else ()
    return Plan(mission, fence, rally, top)


def write_plan(plan: Plan) -> bytes:
    """The file of a plan."""
    # ASCII, as a lone half of a UTF-16 pair, which JSON can hold, has no UTF-8
    return (json.dumps(plan.document, indent=4, allow_nan=False) + "\n").encode("ascii")


def document_of(
    mission: Mission, fence: Geofence, rally: tuple[RallyPoint, ...],
    autopilot: Autopilot = Autopilot.OTHER, vehicle_type: VehicleType = VehicleType.OTHER,
) -> dict[str, Any]:  # fmt: skip
    """A new document. Without a planned home it stands at the first item's place, as QGroundControl wants one."""
    places = [item.place_deg for item in mission.items if item.place_deg is not None]
    home = [*(places[0] if places else (0.0, 0.0)), 0.0]
    if mission.home is not None:
        home = [mission.home.lat_deg, mission.home.lon_deg, mission.home.alt_amsl_m]
    fence_document: dict[str, Any] = {
        "version": 2,
        "polygons": [
            {"inclusion": zone.inclusion, "polygon": [list(place) for place in zone.vertices_deg], "version": 1}
            for zone in fence.polygons
        ],
        "circles": [
            {"inclusion": zone.inclusion, "version": 1,
             "circle": {"center": [zone.lat_deg, zone.lon_deg], "radius": zone.radius_m}}
            for zone in fence.circles
        ],
    }  # fmt: skip
    if fence.breach_return is not None:
        at = fence.breach_return
        fence_document["breachReturn"] = [at.lat_deg, at.lon_deg, at.alt_amsl_m]
    return {
        "fileType": "Plan", "version": 1, "groundStation": "Pilotage",
        "mission": {
            "version": 2, "firmwareType": _FIRMWARE[autopilot], "vehicleType": _VEHICLE[vehicle_type],
            "cruiseSpeed": _CRUISE_M_S, "hoverSpeed": _HOVER_M_S, "globalPlanAltitudeMode": 0,
            "plannedHomePosition": home,
            "items": [_item_document(item, number) for number, item in enumerate(mission.items, 1)],
        },
        "geoFence": fence_document,
        "rallyPoints": {"version": 2, "points": [[p.lat_deg, p.lon_deg, p.alt_rel_m] for p in rally]},
    }  # fmt: skip


def _item_document(item: MissionItem, number: int) -> dict[str, Any]:
    return {
        "type": "SimpleItem", "autoContinue": item.auto_continue, "command": item.command, "doJumpId": number,
        "frame": item.frame, "params": [None if math.isnan(value) else value for value in item.params],
    }  # fmt: skip


# --- mission ---


def _mission(section: dict[str, Any]) -> Mission:
    _version(section, "mission.", (2,))
    home = None
    if section.get("plannedHomePosition") is not None:
        where = "mission.plannedHomePosition"
        home = _made(where, Home, *_numbers(section["plannedHomePosition"], where, 3))
    found: list[tuple[str, MissionItem, object]] = []
    for index, value in enumerate(_array(section.get("items"), "mission.items", MAX_ITEMS)):
        where = f"mission.items[{index}]"
        entry = _object(value, where)
        match entry.get("type"):
            case "SimpleItem":
                found.append((where, _item(entry, where), entry.get("doJumpId", len(found) + 1)))
            case "ComplexItem":
                found += _items_of_complex(entry, where)
            case other:
                raise PlanFileError(f"{where}.type", f"'SimpleItem' or 'ComplexItem' expected, not {_shown(other)}")
        if len(found) > MAX_ITEMS:
            raise PlanFileError(where, f"a mission has at most {MAX_ITEMS} items, those of complex items included")
    items = _with_numbered_jumps(found)
    try:
        return Mission(items, home)
    except MissionError as error:
        raise PlanFileError(found[error.number - 1][0], error.reason) from None


def _items_of_complex(entry: dict[str, Any], where: str) -> list[tuple[str, MissionItem, object]]:
    """The simple items that QGroundControl has made of a survey, a corridor or a structure."""
    transect = entry.get("TransectStyleComplexItem")
    if not isinstance(transect, dict) or "Items" not in transect:
        kind = _shown(entry.get("complexItemType"))
        raise PlanFileError(
            where, f"the complex item {kind} holds no ready items (TransectStyleComplexItem.Items): replace it by "
            "waypoints, or upload it with the program that made it and download it here",
        )  # fmt: skip
    where = f"{where}.TransectStyleComplexItem.Items"
    made: list[tuple[str, MissionItem, object]] = []
    for index, value in enumerate(_array(transect["Items"], where, MAX_ITEMS)):
        inner = _object(value, f"{where}[{index}]")
        if inner.get("type", "SimpleItem") != "SimpleItem":
            raise PlanFileError(f"{where}[{index}].type", f"'SimpleItem' expected, not {_shown(inner['type'])}")
        made.append((f"{where}[{index}]", _item(inner, f"{where}[{index}]"), inner.get("doJumpId")))
    return made


def _item(entry: dict[str, Any], where: str) -> MissionItem:
    command, frame = (_whole(entry.get(name), f"{where}.{name}") for name in ("command", "frame"))
    goes_on = entry.get("autoContinue", True)
    if not isinstance(goes_on, bool):
        raise PlanFileError(f"{where}.autoContinue", f"true or false expected, not {_shown(goes_on)}")
    values = _array(entry.get("params"), f"{where}.params", PARAMETERS)
    if len(values) != PARAMETERS:
        raise PlanFileError(f"{where}.params", f"{PARAMETERS} values expected, not {len(values)}")
    p1, p2, p3, p4, p5, p6, p7 = (
        math.nan if value is None else _number(value, f"{where}.params[{index}]") for index, value in enumerate(values)
    )
    return _made(where, MissionItem, command, frame, (p1, p2, p3, p4, p5, p6, p7), goes_on)


def _with_numbered_jumps(found: list[tuple[str, MissionItem, object]]) -> tuple[MissionItem, ...]:
    """Items whose jumps name the number of their target (from 1) instead of its ``doJumpId``."""
    numbers: dict[int, int] = {}
    twice: set[int] = set()
    for number, (where, _, jump_id) in enumerate(found, 1):
        if jump_id is not None:
            key = _whole(jump_id, f"{where}.doJumpId")
            twice |= {key} & numbers.keys()
            numbers[key] = number
    items: list[MissionItem] = []
    for where, item, _ in found:
        if item.command != DO_JUMP:
            items.append(item)
            continue
        target = item.params[0]
        if target not in numbers:
            raise PlanFileError(f"{where}.params[0]", f"jumps to doJumpId {target:g}, which no item has")
        if target in twice:
            raise PlanFileError(f"{where}.params[0]", f"jumps to doJumpId {target:g}, which several items have")
        params = (float(numbers[int(target)]), *item.params[1:])
        items.append(MissionItem(item.command, item.frame, params, item.auto_continue))
    return tuple(items)


# --- fence and rally points ---


def _fence(section: dict[str, Any]) -> Geofence:
    _version(section, "geoFence.", (2,))
    polygons: list[FencePolygon] = []
    for index, value in enumerate(_array(section.get("polygons", []), "geoFence.polygons", MAX_ITEMS)):
        where = f"geoFence.polygons[{index}]"
        entry = _object(value, where)
        corners = _array(entry.get("polygon"), f"{where}.polygon", MAX_ITEMS)
        places = tuple(_place(corner, f"{where}.polygon[{i}]") for i, corner in enumerate(corners))
        polygons.append(_made(where, FencePolygon, _inclusion(entry, where), places))
    circles: list[FenceCircle] = []
    for index, value in enumerate(_array(section.get("circles", []), "geoFence.circles", MAX_ITEMS)):
        where = f"geoFence.circles[{index}]"
        entry = _object(value, where)
        circle = _object(entry.get("circle"), f"{where}.circle")
        lat_deg, lon_deg = _place(circle.get("center"), f"{where}.circle.center")
        radius_m = _number(circle.get("radius"), f"{where}.circle.radius")
        circles.append(_made(f"{where}.circle", FenceCircle, _inclusion(entry, where), lat_deg, lon_deg, radius_m))
    breach = section.get("breachReturn")
    where = "geoFence.breachReturn"
    at = None if breach is None else _made(where, Home, *_numbers(breach, where, 3))
    return _made("geoFence", Geofence, tuple(polygons), tuple(circles), at)


def _inclusion(entry: dict[str, Any], where: str) -> bool:
    value = entry.get("inclusion")
    if not isinstance(value, bool):
        raise PlanFileError(f"{where}.inclusion", f"true or false expected, not {_shown(value)}")
    if entry.get("version", 1) != 1:
        raise PlanFileError(f"{where}.version", f"1 expected, not {_shown(entry['version'])}")
    return value


def _rally(section: dict[str, Any]) -> tuple[RallyPoint, ...]:
    _version(section, "rallyPoints.", (1, 2))
    points = _array(section.get("points", []), "rallyPoints.points", MAX_RALLY_POINTS)
    return tuple(
        _made(f"rallyPoints.points[{i}]", RallyPoint, *_numbers(point, f"rallyPoints.points[{i}]", 3))
        for i, point in enumerate(points)
    )


# --- JSON ---


def _parsed(text: str) -> object:
    try:
        document: object = json.loads(text, object_pairs_hook=_without_doubles, parse_constant=_no_constant)
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise PlanFileError(where, f"neither JSON ({error.msg}) nor a waypoint file ('{MARK} 110')") from None
    except RecursionError:
        raise PlanFileError(_NAME, "nested too deeply") from None
    except ValueError as error:  # a number of thousands of digits
        raise PlanFileError(_NAME, str(error)) from None
    level = [document]
    for _ in range(_MAX_DEPTH):
        level = [inner for value in level if isinstance(value, dict | list) for inner in _inside(value)]
    if level:
        raise PlanFileError(_NAME, f"nested deeper than {_MAX_DEPTH} levels")
    return document


def _inside(value: dict[str, Any] | list[Any]) -> list[Any]:
    return list(value.values()) if isinstance(value, dict) else value


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise PlanFileError(next(name for name in names if names.count(name) > 1)[:60], "stands twice in one object")
    return found


def _no_constant(name: str) -> NoReturn:
    raise PlanFileError(_NAME, f"{name} is not a number of JSON")


def _object(value: object, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise PlanFileError(where, f"an object expected, not {_shown(value)}")
    return value


def _array(value: object, where: str, most: int) -> list[Any]:
    if not isinstance(value, list):
        raise PlanFileError(where, f"an array expected, not {_shown(value)}")
    if len(value) > most:
        raise PlanFileError(where, f"{len(value)} entries, at most {most} are taken")
    return value


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PlanFileError(where, f"a number expected, not {_shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise PlanFileError(where, "the number is too large")
    return number


def _numbers(value: object, where: str, count: int) -> list[float]:
    values = _array(value, where, MAX_ITEMS)
    if len(values) != count:
        raise PlanFileError(where, f"{count} numbers expected, not {len(values)}")
    return [_number(entry, f"{where}[{i}]") for i, entry in enumerate(values)]


def _whole(value: object, where: str) -> int:
    number = _number(value, where)
    if number != int(number):
        raise PlanFileError(where, f"a whole number expected, not {_shown(value)}")
    return int(number)


def _place(value: object, where: str) -> tuple[float, float]:
    lat_deg, lon_deg = _numbers(value, where, 2)
    return lat_deg, lon_deg


def _version(section: dict[str, Any], prefix: str, known: tuple[int, ...]) -> None:
    value = section.get("version")
    if isinstance(value, bool) or value not in known:
        wanted = " or ".join(map(str, known))
        raise PlanFileError(f"{prefix}version", f"{wanted} expected, not {_shown(value)}")


def _made(where: str, kind: Callable[..., T], *values: Any) -> T:
    """A part of the plan; what it objects to is told with its place in the file."""
    try:
        return kind(*values)
    except ValueError as error:
        raise PlanFileError(where, str(error)) from None


def _shown(value: object) -> str:
    return "nothing" if value is None else f"{value!r:.60}"
