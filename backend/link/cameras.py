"""The cameras of one vehicle: what they say they can, and commands to them.

MAVLink's camera protocol: a camera is a component of its own with a heartbeat of type MAV_TYPE_CAMERA, or an autopilot
that answers for one; CAMERA_INFORMATION has its capabilities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.commands import CommandChannel, CommandStep
from backend.link.events import CommandResult, LinkEvent
from backend.link.framing import RawPacket

HEARTBEAT, COMMAND_ACK, CAMERA_INFORMATION = 0, 77, 259
_REQUEST_MESSAGE = 512


class Cameras:
    """Commands to the cameras of a system id, beside those to its autopilot ``autopilot_id``."""

    def __init__(self, system_id: int, autopilot_id: int) -> None:
        self._system_id = system_id
        self._autopilot_id = autopilot_id
        self._channels: dict[int, CommandChannel] = {}
        self._flags: dict[int, int] = {}

    def receive(self, packet: RawPacket, t_us: int) -> list[LinkEvent]:
        """Take any packet of the vehicle; the acknowledgements of users' commands are given back."""
        component_id = packet.component_id
        if not packet.known or packet.msg_id not in (HEARTBEAT, COMMAND_ACK, CAMERA_INFORMATION):
            return []
        if packet.msg_id == CAMERA_INFORMATION:
            self._flags[component_id] = int(packet.decode().flags)
        elif component_id == self._autopilot_id:
            return []  # its own channel has these
        elif packet.msg_id == COMMAND_ACK and component_id in self._channels:
            return _told(self._channels[component_id].acknowledge(packet.decode(), t_us))
        elif packet.msg_id == HEARTBEAT:
            self._meet(component_id, packet)
        return []

    def _meet(self, component_id: int, packet: RawPacket) -> None:
        if component_id in self._channels or packet.decode().type != _dialect.MAV_TYPE_CAMERA:
            return
        channel = CommandChannel(self._system_id, component_id)
        # Nobody waits for this one's result: its id is of no account.
        channel.start(0, [CommandStep(_REQUEST_MESSAGE, (float(CAMERA_INFORMATION),))], quiet=True)
        self._channels[component_id] = channel

    def tracker(self) -> int | None:
        """The component id of the first camera that tracks points itself; None when none says so."""
        able = [i for i, flags in self._flags.items() if flags & _dialect.CAMERA_CAP_FLAGS_HAS_TRACKING_POINT]
        return min(able, default=None)

    def command(self, component_id: int, command_id: int, steps: Sequence[CommandStep]) -> None:
        """Queue a command of the user to a camera that is a component of its own."""
        self._channels.setdefault(component_id, CommandChannel(self._system_id, component_id)).start(command_id, steps)

    def tick(self, t_us: int) -> tuple[list[Any], list[LinkEvent]]:
        """Messages to send, and the commands given up."""
        return self._each(lambda channel: channel.tick(t_us))

    def abandon(self, t_us: int) -> list[LinkEvent]:
        """The vehicle is gone."""
        return self._each(lambda channel: ([], channel.abandon(t_us)))[1]

    def clock_set_back(self, t_us: int) -> None:
        """The station's clock was set back to ``t_us``."""
        for channel in self._channels.values():
            channel.clock_set_back(t_us)

    def _each(
        self, work: Callable[[CommandChannel], tuple[list[Any], list[tuple[CommandResult, bool]]]]
    ) -> tuple[list[Any], list[LinkEvent]]:
        messages: list[Any] = []
        events: list[LinkEvent] = []
        for channel in self._channels.values():
            sent, results = work(channel)
            messages += sent
            events += _told(results)
        return messages, events


def _told(results: Iterable[tuple[CommandResult, bool]]) -> list[LinkEvent]:
    return [result for result, quiet in results if not quiet]
