"""Waypoint files (``QGC WPL 110``): text, one item a line, as MAVProxy, Mission Planner and older stations write it.

Columns: number, current, frame, command, parameters 1 to 4, latitude or x, longitude or y, altitude or z, autocontinue.
Number 0 is home where it is a waypoint above mean sea level, as in every ArduPilot file.
"""

from __future__ import annotations

import re

from backend.errors import PlanFileError
from guidance.mission import DO_JUMP, FRAME_GLOBAL, MAX_ITEMS, NAV_WAYPOINT, Home, Mission, MissionError, MissionItem

MARK = "QGC WPL"
_VERSION = "110"
_COLUMNS = 12
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?nan", re.ASCII | re.IGNORECASE)


def read_waypoints(text: str) -> Mission:
    """The mission of a waypoint file; PlanFileError says which line is wrong."""
    lines = [(number, line.strip()) for number, line in enumerate(text.split("\n"), 1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("#")]
    head, first = lines[0] if lines else (1, "")
    if first.split() != [*MARK.split(), _VERSION]:
        raise PlanFileError(f"line {head}", f"'{MARK} {_VERSION}' expected, not {first!r:.60}")
    if len(lines) > MAX_ITEMS + 2:
        raise PlanFileError(f"line {lines[MAX_ITEMS + 2][0]}", f"a mission has at most {MAX_ITEMS} items")
    items = [(number, _item(line, number, index)) for index, (number, line) in enumerate(lines[1:])]
    home: Home | None = None
    if items and _is_home(items[0][1]):
        number, item = items.pop(0)
        try:
            home = Home(*item.params[4:])
        except ValueError as error:
            raise PlanFileError(f"line {number}", str(error)) from None
    else:
        # The numbers of such a file begin with its first item.
        items = [(number, _jump_later(item)) for number, item in items]
    try:
        return Mission(tuple(item for _, item in items), home)
    except MissionError as error:
        raise PlanFileError(f"line {items[min(error.number, len(items)) - 1][0]}", error.reason) from None


def _item(line: str, number: int, index: int) -> MissionItem:
    columns = line.split()
    if len(columns) != _COLUMNS:
        raise PlanFileError(f"line {number}", f"{_COLUMNS} columns expected, not {len(columns)}")
    values = [_value(text, number, column) for column, text in enumerate(columns, 1)]
    seq, current, frame, command, goes_on = (_whole(values[i], number, i + 1) for i in (0, 1, 2, 3, 11))
    if seq != index:
        raise PlanFileError(f"line {number}, column 1", f"item {index} expected, not {seq}")
    if current not in (0, 1) or goes_on not in (0, 1):
        raise PlanFileError(f"line {number}", "'current' (column 2) and 'autocontinue' (column 12) are 0 or 1")
    p1, p2, p3, p4, p5, p6, p7 = values[4:11]
    try:
        return MissionItem(command, frame, (p1, p2, p3, p4, p5, p6, p7), bool(goes_on))
    except ValueError as error:
        raise PlanFileError(f"line {number}", str(error)) from None


def _value(text: str, number: int, column: int) -> float:
    if _NUMBER.fullmatch(text) is None:
        raise PlanFileError(f"line {number}, column {column}", f"a number expected, not {text!r:.60}")
    return float(text)


def _whole(value: float, number: int, column: int) -> int:
    if not value.is_integer():
        raise PlanFileError(f"line {number}, column {column}", f"a whole number expected, not {value:g}")
    return int(value)


def _is_home(item: MissionItem) -> bool:
    return item.command == NAV_WAYPOINT and item.frame == FRAME_GLOBAL


def _jump_later(item: MissionItem) -> MissionItem:
    if item.command != DO_JUMP:
        return item
    return MissionItem(item.command, item.frame, (item.params[0] + 1, *item.params[1:]), item.auto_continue)
