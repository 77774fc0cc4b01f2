"""Fence and rally points as the lists of items that vehicles take, and back."""

from __future__ import annotations

import math
from collections.abc import Sequence

from backend.link.dialect import command_name
from backend.link.events import Autopilot
from backend.link.mission_items import items_for_vehicle
from backend.missions.plan import Plan, RallyPoint
from guidance.geofence import FenceCircle, FencePolygon, Geofence
from guidance.mission import FRAME_GLOBAL, FRAME_GLOBAL_RELATIVE_ALT, Home, MissionItem, MissionType

RETURN_POINT, POLYGON_IN, POLYGON_OUT, CIRCLE_IN, CIRCLE_OUT, RALLY_POINT = 5000, 5001, 5002, 5003, 5004, 5100


def items_of_part(plan: Plan, kind: MissionType, autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """One part of a plan as the vehicle keeps it; ValueError says which item cannot be sent."""
    if kind is MissionType.MISSION:
        return items_for_vehicle(plan.mission, autopilot)
    if kind is MissionType.FENCE:
        return fence_items(plan.fence)
    return rally_items(plan.rally)


def fence_items(fence: Geofence) -> tuple[MissionItem, ...]:
    """A fence as items: of a polygon each vertex, with their count in parameter 1."""
    items: list[MissionItem] = []
    if fence.breach_return is not None:
        at = fence.breach_return
        items.append(_item(RETURN_POINT, FRAME_GLOBAL, 0.0, at.lat_deg, at.lon_deg, at.alt_amsl_m))
    for polygon in fence.polygons:
        command = POLYGON_IN if polygon.inclusion else POLYGON_OUT
        count = float(len(polygon.vertices_deg))
        items += [_item(command, FRAME_GLOBAL, count, *vertex_deg, 0.0) for vertex_deg in polygon.vertices_deg]
    for circle in fence.circles:
        command = CIRCLE_IN if circle.inclusion else CIRCLE_OUT
        items.append(_item(command, FRAME_GLOBAL, circle.radius_m, circle.lat_deg, circle.lon_deg, 0.0))
    return tuple(items)


def fence_of_items(items: Sequence[MissionItem]) -> Geofence:
    """The fence that a vehicle's items make; ValueError says which of them does not belong there."""
    polygons: list[FencePolygon] = []
    circles: list[FenceCircle] = []
    breach_return: Home | None = None
    at = 0
    while at < len(items):
        item = items[at]
        lat_deg, lon_deg = item.params[4:6]
        length = 1
        if item.command == RETURN_POINT:
            breach_return = Home(lat_deg, lon_deg, item.params[6])
        elif item.command in (CIRCLE_IN, CIRCLE_OUT):
            circles.append(FenceCircle(item.command == CIRCLE_IN, lat_deg, lon_deg, item.params[0]))
        elif item.command in (POLYGON_IN, POLYGON_OUT):
            count = item.params[0]
            corners = items[at : at + int(count)] if count.is_integer() and count > 0 else ()
            if len(corners) != count or any((c.command, c.params[0]) != (item.command, count) for c in corners):
                message = f"fence item {at}: begins a polygon of {count:g} vertices that do not follow"
                raise ValueError(message)
            vertices = tuple((corner.params[4], corner.params[5]) for corner in corners)
            polygons.append(FencePolygon(item.command == POLYGON_IN, vertices))
            length = len(corners)
        else:
            message = f"fence item {at}: {command_name(item.command)} is no part of a fence"
            raise ValueError(message)
        at += length
    return Geofence(tuple(polygons), tuple(circles), breach_return)


def rally_items(points: Sequence[RallyPoint]) -> tuple[MissionItem, ...]:
    """Rally points as items, their altitude above home."""
    return tuple(_item(RALLY_POINT, FRAME_GLOBAL_RELATIVE_ALT, 0.0, p.lat_deg, p.lon_deg, p.alt_rel_m) for p in points)


def rally_of_items(items: Sequence[MissionItem]) -> tuple[RallyPoint, ...]:
    """The rally points of a vehicle's items; ValueError says which of them is none."""
    points: list[RallyPoint] = []
    for seq, item in enumerate(items):
        if item.command != RALLY_POINT or item.plain_frame != FRAME_GLOBAL_RELATIVE_ALT or item.place_deg is None:
            message = f"rally item {seq}: {command_name(item.command)} in frame {item.frame} is no point above home"
            raise ValueError(message)
        points.append(RallyPoint(*item.place_deg, item.params[6]))
    return tuple(points)


def _item(command: int, frame: int, param1: float, lat_deg: float, lon_deg: float, alt_m: float) -> MissionItem:
    if math.isnan(alt_m):
        message = f"{command_name(command)}: has no altitude"
        raise ValueError(message)
    return MissionItem(command, frame, (param1, 0.0, 0.0, 0.0, lat_deg, lon_deg, alt_m))
