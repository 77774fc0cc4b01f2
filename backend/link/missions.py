"""MAVLink's mission protocol with one vehicle: one transfer at a time, the others wait. Sans I/O.

Times and repeats are those of the protocol's description (mavlink.io, "Mission Protocol"): 1.5 s for an answer, 250 ms
for an item that was asked for, five repeats. An uploading station does not repeat items every 250 ms: the vehicle asks
again by itself, and an item that comes twice is an error to ArduPilot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.dialect import command_name
from backend.link.events import CommandStatus, TransferAction, TransferNews
from backend.link.mission_items import item_message, item_of_message
from guidance.mission import MAX_ITEMS, MissionItem, MissionType

ITEM_INT, COUNT, ACK, REQUEST, REQUEST_INT = 73, 44, 47, 40, 51
MESSAGES = frozenset({ITEM_INT, COUNT, ACK, REQUEST, REQUEST_INT})

_ANSWER_TIMEOUT_US = 1_500_000
_ITEM_TIMEOUT_US = 250_000
_REPEATS = 5
# A vehicle on a bad radio asks for an item some times over; one that asks without end is broken.
_REQUESTS_PER_ITEM, _REQUESTS_MORE = 10, 50
_PROGRESS_STEPS = 10

_ACCEPTED, _ERROR, _INVALID_SEQUENCE, _CANCELLED = 0, 1, 13, 15
_RESULTS = {
    1: (CommandStatus.FAILED, "the vehicle reports an error: it may be busy with another transfer"),
    2: (CommandStatus.UNSUPPORTED, "the vehicle does not support the frame of an item"),
    3: (CommandStatus.UNSUPPORTED, "the vehicle does not support it"),
    4: (CommandStatus.DENIED, "the vehicle has no space for so many items"),
    5: (CommandStatus.DENIED, "the vehicle says that an item has an invalid value"),
    6: (CommandStatus.DENIED, "the vehicle says that parameter 1 is invalid"),
    7: (CommandStatus.DENIED, "the vehicle says that parameter 2 is invalid"),
    8: (CommandStatus.DENIED, "the vehicle says that parameter 3 is invalid"),
    9: (CommandStatus.DENIED, "the vehicle says that parameter 4 is invalid"),
    10: (CommandStatus.DENIED, "the vehicle says that parameter 5 (x or latitude) is invalid"),
    11: (CommandStatus.DENIED, "the vehicle says that parameter 6 (y or longitude) is invalid"),
    12: (CommandStatus.DENIED, "the vehicle says that parameter 7 (altitude) is invalid"),
    13: (CommandStatus.DENIED, "the vehicle says that items come out of order"),
    14: (CommandStatus.DENIED, "the vehicle takes none from this station"),
    15: (CommandStatus.CANCELLED, "the vehicle cancelled it"),
}


@dataclass(slots=True)
class _Transfer:
    transfer_id: int
    action: TransferAction
    kind: MissionType
    items: list[MissionItem] = field(default_factory=list)  # to send, or received so far
    total: int | None = None  # of a download: None before the vehicle said it
    served: set[int] = field(default_factory=set)
    last_served: int | None = None
    requests: int = 0
    repeats: int = 0
    out_of_order: bool = False
    progress: int = 0
    deadline_us: int = 0

    @property
    def all_served(self) -> bool:
        return len(self.served) == len(self.items)

    @property
    def timeout_us(self) -> int:
        """How long the answer to what was said last may take."""
        return _ITEM_TIMEOUT_US if self.total is not None else _ANSWER_TIMEOUT_US


class MissionChannel:
    """The transfers with one vehicle, addressed from ``station`` (system and component id).

    What is to be sent lies in ``take_messages``; answers to requests do not wait for a tick.
    """

    def __init__(self, system_id: int, component_id: int, station: tuple[int, int]) -> None:
        self._system_id, self._component_id = system_id, component_id
        self._station = station
        self._waiting: deque[_Transfer] = deque()
        self._running: _Transfer | None = None
        self._outbox: list[Any] = []

    def start(
        self, transfer_id: int, action: TransferAction, kind: MissionType, items: Sequence[MissionItem] = ()
    ) -> None:
        """Queue a transfer. ``items`` are an upload's, as the vehicle counts them; ValueError for one without."""
        if (action is TransferAction.UPLOAD) != bool(items):
            message = f"an upload needs items, and nothing else has any: {action} with {len(items)}"
            raise ValueError(message)
        self._waiting.append(_Transfer(transfer_id, action, kind, list(items)))

    def take_messages(self) -> list[Any]:
        """Messages to send now; each is given once."""
        out, self._outbox = self._outbox, []
        return out

    def receive(self, m: Any, t_us: int) -> list[TransferNews]:
        """Take one of ``MESSAGES`` from the vehicle; what is another station's, or old, gives nothing."""
        run = self._running
        for_us = m.target_system == self._station[0] and m.target_component in (0, self._station[1])
        if run is None or not for_us or m.mission_type != run.kind:
            return []
        match m.id:
            case 40 | 51:
                return self._on_request(run, m.seq, t_us)
            case 44:
                return self._on_count(run, m.count, t_us)
            case 73:
                return self._on_item(run, m, t_us)
            case _:
                return self._on_ack(run, m.type, t_us)

    def tick(self, t_us: int) -> list[TransferNews]:
        """Let time pass: begin what waits, repeat, give up."""
        run = self._running
        if run is None:
            if self._waiting:
                self._running = self._waiting.popleft()
                self._say(self._running, t_us)
            return []
        if t_us < run.deadline_us:
            return []
        if run.repeats >= _REPEATS:
            return [self._given_up(run, t_us)]
        run.repeats += 1
        self._say(run, t_us)
        return []

    def restarted(self, t_us: int) -> list[TransferNews]:
        """The vehicle has restarted: it knows nothing of the transfer, and may hold part of it."""
        if self._running is None:
            return []
        return [self._end(self._running, t_us, CommandStatus.FAILED, "the vehicle restarted in the middle of it")]

    def abandon(self, t_us: int) -> list[TransferNews]:
        """The vehicle is gone: every transfer ends."""
        open_transfers = [*([self._running] if self._running else []), *self._waiting]
        self._waiting.clear()
        return [self._end(run, t_us, CommandStatus.TIMEOUT, "the vehicle fell silent") for run in open_transfers]

    def clock_set_back(self, t_us: int) -> None:
        """The station's clock was set back to ``t_us``: repeat at the usual time from there."""
        if self._running is not None:
            self._running.deadline_us = min(self._running.deadline_us, t_us + _ANSWER_TIMEOUT_US)

    # --- what the vehicle says ---

    def _on_request(self, run: _Transfer, seq: int, t_us: int) -> list[TransferNews]:
        if run.action is not TransferAction.UPLOAD or seq >= len(run.items):
            return []
        run.requests += 1
        if run.requests > _REQUESTS_PER_ITEM * len(run.items) + _REQUESTS_MORE:
            return [self._cancel(run, t_us, f"the vehicle asks for item {seq} again and again")]
        run.served.add(seq)
        run.last_served = seq
        run.repeats = 0
        self._say(run, t_us)
        return self._progress(run, len(run.served) - 1, len(run.items), t_us)

    def _on_count(self, run: _Transfer, count: int, t_us: int) -> list[TransferNews]:
        if run.action is not TransferAction.DOWNLOAD or run.total == count:
            return []
        if run.total is not None:
            return [self._cancel(run, t_us, f"the vehicle's list changed from {run.total} to {count} items meanwhile")]
        if count > MAX_ITEMS + 1:  # ArduPilot's home is one more
            return [self._cancel(run, t_us, f"the vehicle has {count} items, more than {MAX_ITEMS}")]
        run.total = count
        if count == 0:
            return [self._received(run, t_us)]
        run.repeats = 0
        self._say(run, t_us)
        return []

    def _on_item(self, run: _Transfer, m: Any, t_us: int) -> list[TransferNews]:
        if run.action is not TransferAction.DOWNLOAD or run.total is None or m.seq != len(run.items):
            return []  # an answer that comes twice, or late
        try:
            run.items.append(item_of_message(m))
        except ValueError as error:
            return [self._cancel(run, t_us, f"item {m.seq} of the vehicle ({command_name(m.command)}): {error}")]
        if len(run.items) == run.total:
            return [self._received(run, t_us)]
        run.repeats = 0
        self._say(run, t_us)
        return self._progress(run, len(run.items), run.total, t_us)

    def _on_ack(self, run: _Transfer, result: int, t_us: int) -> list[TransferNews]:
        uploading = run.action is TransferAction.UPLOAD
        if result == _ACCEPTED:
            # Before all was asked for it is the echo of an earlier transfer; a download ends with its items.
            if run.action is TransferAction.DOWNLOAD or (uploading and not run.all_served):
                return []
            return [self._end(run, t_us, CommandStatus.ACCEPTED, "accepted by the vehicle")]
        if uploading and result == _INVALID_SEQUENCE:
            # ArduPilot says so of an item that it has already, and goes on.
            run.out_of_order = True
            return []
        if uploading and result == _ERROR and run.all_served and run.repeats:
            # It has closed the transfer: that it accepted was lost, and the repeat meets nobody.
            return [self._given_up(run, t_us)]
        status, words = _RESULTS.get(result, (CommandStatus.FAILED, f"the vehicle answers with result {result}"))
        if uploading and run.last_served is not None:
            item = run.items[run.last_served]
            words += f" (after its item {run.last_served}, {command_name(item.command)})"
        return [self._end(run, t_us, status, words)]

    # --- what is said ---

    def _say(self, run: _Transfer, t_us: int) -> None:
        """Say what the transfer waits on, for the first time or once more."""
        run.deadline_us = t_us + run.timeout_us
        to, kind = (self._system_id, self._component_id), int(run.kind)
        if run.action is TransferAction.CLEAR:
            self._outbox.append(_dialect.MAVLink_mission_clear_all_message(*to, kind))
        elif run.action is TransferAction.UPLOAD:
            if run.last_served is None:
                self._outbox.append(_dialect.MAVLink_mission_count_message(*to, len(run.items), kind))
            else:
                item = run.items[run.last_served]
                self._outbox.append(item_message(item, run.last_served, run.kind, *to))
        elif run.total is None:
            self._outbox.append(_dialect.MAVLink_mission_request_list_message(*to, kind))
        else:
            self._outbox.append(_dialect.MAVLink_mission_request_int_message(*to, len(run.items), kind))

    def _acknowledge(self, run: _Transfer, result: int) -> None:
        self._outbox.append(
            _dialect.MAVLink_mission_ack_message(self._system_id, self._component_id, result, int(run.kind))
        )

    # --- how it ends ---

    def _received(self, run: _Transfer, t_us: int) -> TransferNews:
        self._acknowledge(run, _ACCEPTED)
        return self._end(run, t_us, CommandStatus.ACCEPTED, f"{len(run.items)} items received")

    def _given_up(self, run: _Transfer, t_us: int) -> TransferNews:
        if run.action is TransferAction.UPLOAD and run.all_served:
            text = "the vehicle took every item and did not acknowledge them"
            return self._end(run, t_us, CommandStatus.TIMEOUT, text, unconfirmed=True)
        if run.out_of_order:
            return self._cancel(run, t_us, _RESULTS[_INVALID_SEQUENCE][1], CommandStatus.DENIED)
        done, total = (len(run.served), len(run.items)) if run.served else (len(run.items), run.total)
        text = "no answer from the vehicle"
        if run.served or run.total is not None:
            text = f"the vehicle fell silent after {done} of {total} items"
        return self._cancel(run, t_us, text, CommandStatus.TIMEOUT)

    def _cancel(
        self, run: _Transfer, t_us: int, text: str, status: CommandStatus = CommandStatus.FAILED
    ) -> TransferNews:
        """End a transfer that the vehicle may take for open."""
        if run.action is not TransferAction.CLEAR:
            self._acknowledge(run, _CANCELLED)
        return self._end(run, t_us, status, text)

    def _end(
        self, run: _Transfer, t_us: int, status: CommandStatus, text: str, *, unconfirmed: bool = False
    ) -> TransferNews:
        if run is self._running:
            self._running = None
        received = run.action is TransferAction.DOWNLOAD
        done, total = (len(run.items), run.total or 0) if received else (len(run.served), len(run.items))
        items = tuple(run.items) if received and status is CommandStatus.ACCEPTED else ()
        text = f"{run.kind.words}: {text}"
        return TransferNews(
            t_us, self._system_id, run.transfer_id, run.action, run.kind, status, text, done, total, items, unconfirmed
        )

    def _progress(self, run: _Transfer, done: int, total: int, t_us: int) -> list[TransferNews]:
        """News at every tenth of the way: listeners are told each one, however long the list."""
        step = done * _PROGRESS_STEPS // total
        if step <= run.progress:
            return []
        run.progress = step
        text = f"{run.kind.words}: {done} of {total} items"
        return [
            TransferNews(
                t_us, self._system_id, run.transfer_id, run.action, run.kind, CommandStatus.IN_PROGRESS, text, done,
                total,
            )
        ]  # fmt: skip
