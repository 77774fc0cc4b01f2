"""Mission protocol on the side of the vehicle: takes, keeps and gives back one mission. No I/O.

``vehicles.mission_flight`` flies it.

Counts as ArduPilot does: item 0 is home. Fence and rally points are not supported, and it says so.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MAX_ITEMS = 700
KINDS = frozenset({
    "MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_REQUEST",
    "MISSION_CLEAR_ALL", "MISSION_ACK",
})  # fmt: skip

_MISSION = mavlink.MAV_MISSION_TYPE_MISSION
_REPEAT_US, _GIVE_UP_US = 1_000_000, 8_000_000


class MissionStore:
    """Keeps what was sent whole, and until then what was kept before. ``send`` takes messages to be sent."""

    def __init__(self, send: Callable[[Any], None]) -> None:
        self._send = send
        self.items: list[Any] = []
        self._arriving: list[Any] = []
        self._expected = 0
        self._from: tuple[int, int] | None = None
        self._asked_us = 0
        self._heard_us = 0

    def receive(self, message: Any, t_us: int) -> None:
        """Act on one message of ``KINDS`` that is for this vehicle."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.mission_type != _MISSION:
            if message.get_type() != "MISSION_ACK":
                self._acknowledge(sender, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)
            return
        match message.get_type():
            case "MISSION_COUNT":
                self._begin(message.count, sender, t_us)
            case "MISSION_ITEM_INT":
                self._take(message, sender, t_us)
            case "MISSION_REQUEST_LIST":
                self._send(mavlink.MAVLink_mission_count_message(*sender, len(self.items), _MISSION))
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                self._give(message.seq, sender)
            case "MISSION_CLEAR_ALL":
                self.items = []
                self._acknowledge(sender, mavlink.MAV_MISSION_ACCEPTED)

    def step(self, t_us: int) -> None:
        """Ask once more for an item that does not come, and give up."""
        if self._from is None or t_us - self._asked_us < _REPEAT_US:
            return
        if t_us - self._heard_us >= _GIVE_UP_US:
            self._acknowledge(self._from, mavlink.MAV_MISSION_OPERATION_CANCELLED)
            self._from = None
            return
        self._ask(t_us)

    def _begin(self, count: int, sender: tuple[int, int], t_us: int) -> None:
        if self._from not in (None, sender):
            self._acknowledge(sender, mavlink.MAV_MISSION_DENIED)
            return
        if count > MAX_ITEMS:
            self._acknowledge(sender, mavlink.MAV_MISSION_NO_SPACE)
            return
        self._arriving, self._expected, self._from, self._heard_us = [], count, sender, t_us
        if count:
            self._ask(t_us)
        else:
            self._finish(sender)

    def _take(self, message: Any, sender: tuple[int, int], t_us: int) -> None:
        if sender != self._from:
            self._acknowledge(sender, mavlink.MAV_MISSION_ERROR)
            return
        if message.seq != len(self._arriving):
            self._acknowledge(sender, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        self._arriving.append(message)
        self._heard_us = t_us
        if len(self._arriving) < self._expected:
            self._ask(t_us)
        else:
            self._finish(sender)

    def _finish(self, sender: tuple[int, int]) -> None:
        self.items, self._from = self._arriving, None
        self._acknowledge(sender, mavlink.MAV_MISSION_ACCEPTED)

    def _ask(self, t_us: int) -> None:
        self._asked_us = t_us
        if self._from is not None:
            # The older request, as ArduPilot sends it.
            self._send(mavlink.MAVLink_mission_request_message(*self._from, len(self._arriving), _MISSION))

    def _give(self, seq: int, sender: tuple[int, int]) -> None:
        if seq >= len(self.items):
            self._acknowledge(sender, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        m = self.items[seq]
        self._send(
            mavlink.MAVLink_mission_item_int_message(
                *sender, seq, m.frame, m.command, 0, m.autocontinue, m.param1, m.param2, m.param3, m.param4, m.x, m.y,
                m.z, _MISSION,
            )
        )  # fmt: skip

    def _acknowledge(self, to: tuple[int, int], result: int, kind: int = _MISSION) -> None:
        self._send(mavlink.MAVLink_mission_ack_message(*to, result, kind))
