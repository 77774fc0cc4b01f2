"""Mission items on the wire, and in which order and numbering each autopilot keeps them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.dialect import INT32_MAX, command_name
from backend.link.events import Autopilot
from guidance.mission import DO_JUMP, FRAME_GLOBAL, NAV_WAYPOINT, Home, Mission, MissionItem, MissionType


def item_message(item: MissionItem, seq: int, kind: MissionType, system_id: int, component_id: int) -> Any:
    """MISSION_ITEM_INT of an item for a vehicle's component."""
    x, y = counts_of(item)
    return _dialect.MAVLink_mission_item_int_message(
        system_id, component_id, seq, item.plain_frame, item.command, 0, int(item.auto_continue), *item.params[:4],
        x, y, item.params[6], int(kind),
    )  # fmt: skip


def counts_of(item: MissionItem) -> tuple[int, int]:
    """Parameters 5 and 6 as MISSION_ITEM_INT has them.

    Raises ValueError where they have a fraction that would be lost: the command is not known to take a place there.
    """
    counts: list[int] = []
    for number, value in zip((5, 6), item.params[4:6], strict=True):
        if math.isnan(value):
            counts.append(INT32_MAX)
            continue
        if item.counts_per_unit == 1.0 and value != round(value):
            message = f"{command_name(item.command)}: parameter {number} is {value}, MAVLink has whole numbers there"
            raise ValueError(message)
        counts.append(round(value * item.counts_per_unit))
    return counts[0], counts[1]


def item_of_message(m: Any) -> MissionItem:
    """The item that a MISSION_ITEM_INT carries; ValueError says what makes it none."""
    params = (m.param1, m.param2, m.param3, m.param4)
    scale = MissionItem(m.command, m.frame, (*params, 0.0, 0.0, m.z)).counts_per_unit
    x, y = (math.nan if count == INT32_MAX else count / scale for count in (m.x, m.y))
    return MissionItem(m.command, m.frame, (*params, x, y, m.z), bool(m.autocontinue))


def number_of(seq: int, autopilot: Autopilot) -> int | None:
    """An item's number from 1 for the number that an autopilot gives it; None for the home of ArduPilot."""
    number = seq if autopilot is Autopilot.ARDUPILOT else seq + 1
    return number or None


def items_for_vehicle(mission: Mission, autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """A mission's items as an autopilot keeps them; ValueError as ``counts_of``, with the item's number.

    ArduPilot has home as its item 0, which it sets itself; others begin with the first item.
    """
    for number, item in enumerate(mission.items, 1):
        try:
            counts_of(item)
        except ValueError as error:
            message = f"item {number}: {error}"
            raise ValueError(message) from None
    if autopilot is Autopilot.ARDUPILOT:
        return (_home_item(mission.home), *mission.items) if mission.items else ()
    return tuple(_renumbered(item, -1) for item in mission.items)


def items_of_vehicle(items: Sequence[MissionItem], autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """The mission's items of what an autopilot keeps."""
    if autopilot is Autopilot.ARDUPILOT:
        return tuple(items[1:])
    return tuple(_renumbered(item, 1) for item in items)


def home_of_vehicle(items: Sequence[MissionItem], autopilot: Autopilot) -> Home | None:
    """Home as an ArduPilot has it in item 0; None where it has none yet."""
    if autopilot is not Autopilot.ARDUPILOT or not items:
        return None
    place, alt_m = items[0].place_deg, items[0].alt_m
    return None if place is None or alt_m is None else Home(*place, alt_m)


def _home_item(home: Home | None) -> MissionItem:
    place = (0.0, 0.0, 0.0) if home is None else (home.lat_deg, home.lon_deg, home.alt_amsl_m)
    return MissionItem(NAV_WAYPOINT, FRAME_GLOBAL, (0.0, 0.0, 0.0, 0.0, *place))


def _renumbered(item: MissionItem, by: int) -> MissionItem:
    """DO_JUMP names its target in the autopilot's own numbering."""
    return replace(item, params=(item.params[0] + by, *item.params[1:])) if item.command == DO_JUMP else item
