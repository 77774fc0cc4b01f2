"""Whether a vehicle holds what it was sent. Autopilots keep items in forms of their own, so not every bit comes back.

ArduPilot keeps altitudes in centimetres (of rally points in metres), drops parameters that a command does not use, and
gives commands without a place the frame GLOBAL (seen in a recorded transfer of 4.7).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from backend.link.dialect import command_name
from backend.link.mission_items import counts_of
from backend.missions.parts import RALLY_POINT
from guidance.mission import MissionItem

_ALT_M, _RALLY_ALT_M = 0.011, 1.0
_FLOAT32_STEP = 1.2e-7
_NAMED = 3


@dataclass(frozen=True, slots=True)
class Comparison:
    """``wrong``: the vehicle would fly something else. ``dropped``: parameters that came back as 0, unused by it."""

    wrong: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """Whether the vehicle holds what it was sent."""
        return not self.wrong


def compare(sent: Sequence[MissionItem], held: Sequence[MissionItem]) -> Comparison:
    """Compare lists of items, both without the home of ArduPilot; items are told by their number from 1."""
    if len(sent) != len(held):
        return Comparison((f"{len(held)} items instead of {len(sent)}",))
    wrong: list[str] = []
    dropped: list[str] = []
    for number, (ours, its) in enumerate(zip(sent, held, strict=True), 1):
        name = f"item {number}"
        if ours.command != its.command:
            wrong.append(f"{name} is {command_name(its.command)} instead of {command_name(ours.command)}")
            continue
        if ours.has_place and ours.plain_frame != its.plain_frame:
            wrong.append(f"{name} has frame {its.frame} instead of {ours.frame}")
            continue
        for parameter, (value, back) in enumerate(zip(ours.params, its.params, strict=True), 1):
            if _agree(ours, its, parameter):
                continue
            text = f"parameter {parameter} of {name} is {back:.9g} instead of {value:.9g}"
            lost = back == 0.0 and not (ours.has_place and parameter > 4)
            (dropped if lost else wrong).append(text)
    return Comparison(tuple(wrong), tuple(dropped))


def told(differences: Sequence[str]) -> str:
    """Differences in one line, the first few by name."""
    more = len(differences) - _NAMED
    return "; ".join(differences[:_NAMED]) + (f"; and {more} more" if more > 0 else "")


def _agree(ours: MissionItem, its: MissionItem, parameter: int) -> bool:
    value, back = ours.params[parameter - 1], its.params[parameter - 1]
    if math.isnan(value):
        return True  # the vehicle's own choice
    if math.isnan(back):
        return False
    if parameter in (5, 6):
        at = parameter - 5
        return abs(counts_of(ours)[at] - counts_of(its)[at]) <= 1
    tolerance = abs(value) * _FLOAT32_STEP
    if parameter == 7 and ours.has_place:
        tolerance += _RALLY_ALT_M if ours.command == RALLY_POINT else _ALT_M
    return abs(value - back) <= tolerance
