"""Recorded telemetry to events: the packets of a log through the same link as live ones, by the log's own times."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from backend.link.events import LinkEvent
from backend.link.link import VehicleLink

_TICK_US = 200_000
# A silence is told as it is while it is short; a longer one is a hole in the log, and its ends tell enough.
_LONGEST_SILENCE_TICKS = 50
# Relays and loggers with several sources swap packets by this much; what lies further back is of another clock.
_SWAPPED_US = 1_000_000
_LEAP_US = 10_000_000

Entry = tuple[int, bytes]


def running_forward(entries: Iterable[Entry], warn: Callable[[str], None]) -> Iterator[Entry]:
    """A log without what would turn its time back: single records with a time far ahead, and records far behind.

    ``warn`` is told at the end how many were left out, and from when on.
    """
    newest_us: int | None = None
    held: Entry | None = None
    left_out: list[int] = []
    for entry in entries:
        t_us = entry[0]
        if held is not None:
            # A leap, and the first of all, is believed when its successor is there, too.
            if abs(t_us - held[0]) <= _LEAP_US:
                newest_us = held[0]
                yield held
            else:
                left_out.append(held[0])
            held = None
        if newest_us is None or t_us - newest_us > _LEAP_US:
            held = entry
        elif newest_us - t_us > _SWAPPED_US:
            left_out.append(t_us)
        else:
            newest_us = max(newest_us, t_us)
            yield entry
    if held is not None:
        yield held
    if left_out:
        warn(
            f"time does not run forward: {len(left_out)} packets are left out, the first of them from {left_out[0]}; "
            "was the clock set while it was recorded?"
        )


class LinkReplay:
    """Feeds a passive ``VehicleLink`` from (receive time in Unix microseconds, packet bytes) pairs.

    Times may jitter or run backwards: they are taken as they stand, as a live receiver takes its clock. Nothing is
    sent, whatever the log holds. Packets of a ground station in the log are not a vehicle's.
    """

    def __init__(self, *, station_system_id: int = 255) -> None:
        self.link = VehicleLink(system_id=station_system_id, passive=True)
        self._next_tick_us: int | None = None
        self._newest_us = 0

    def feed(self, t_unix_us: int, packet: bytes) -> list[LinkEvent]:
        """The events of one entry of the log, after those that the passing of time brings."""
        events = self._pass_time(t_unix_us)
        events += self.link.receive(packet, t_unix_us)
        return events

    def events(self, entries: Iterable[tuple[int, bytes]]) -> Iterator[LinkEvent]:
        """All events of a log, in its order."""
        for t_unix_us, packet in entries:
            yield from self.feed(t_unix_us, packet)

    def _pass_time(self, t_unix_us: int) -> list[LinkEvent]:
        if self._next_tick_us is None or t_unix_us < self._newest_us - _TICK_US:
            self._next_tick_us = t_unix_us
        self._newest_us = t_unix_us
        events: list[LinkEvent] = []
        if t_unix_us - self._next_tick_us > _LONGEST_SILENCE_TICKS * _TICK_US:
            events += self.link.tick(self._next_tick_us)
            self._next_tick_us = t_unix_us - _LONGEST_SILENCE_TICKS * _TICK_US
        while self._next_tick_us <= t_unix_us:
            events += self.link.tick(self._next_tick_us)
            self._next_tick_us += _TICK_US
        return events
