"""One place where the station says what happened, and mailboxes for those who listen.

A message is turned into text once, however many listen. A mailbox keeps what must not be lost in order, keeps only the
latest of what may be coalesced, and is given up when its owner reads too slowly. Runs on the event loop only.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import orjson
import structlog

from backend.clock import unix_us

# Of these only the latest of each vehicle, source or target matters to a slow reader.
COALESCED = frozenset(
    {
        "state",
        "gps",
        "telemetry",
        "link",
        "video",
        "fix",
        "replay",
        "waiting",
        "sighting",
        "landing",
        "homing",
        "aiding",
    }
)
MAILBOX_MESSAGES = 2000
MAILBOX_BYTES = 4_000_000


_log = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class Message:
    """One message as text, and the key under which a newer one replaces it (None: never)."""

    text: str
    key: str | None


class Mailbox:
    """What one listener has not yet read."""

    def __init__(self, max_messages: int = MAILBOX_MESSAGES, max_bytes: int = MAILBOX_BYTES) -> None:
        self._waiting: OrderedDict[object, Message] = OrderedDict()
        self._bytes = 0
        self._max_messages = max_messages
        self._max_bytes = max_bytes
        self._ready = asyncio.Event()
        self.given_up = asyncio.Event()
        self.coalesced = 0

    @property
    def overflowed(self) -> bool:
        """Whether the owner read too slowly; then nothing more comes."""
        return self.given_up.is_set()

    def put(self, message: Message) -> None:
        """Keep a message; after an overflow nothing is kept any more."""
        if self.overflowed:
            return
        key: object = message.key if message.key is not None else object()
        replaced = self._waiting.pop(key, None)
        if replaced is not None:
            self._bytes -= len(replaced.text)
            self.coalesced += 1
        self._waiting[key] = message
        self._bytes += len(message.text)
        if len(self._waiting) > self._max_messages or self._bytes > self._max_bytes:
            self.given_up.set()
            self._waiting.clear()
            self._bytes = 0
        self._ready.set()

    async def take(self) -> list[str]:
        """All waiting messages, oldest first; waits until there is one."""
        await self._ready.wait()
        texts = [message.text for message in self._waiting.values()]
        self._waiting.clear()
        self._bytes = 0
        self._ready.clear()
        return texts


class Hub:
    """Hands every published message to every mailbox."""

    def __init__(self) -> None:
        self._mailboxes: set[Mailbox] = set()
        self._seq = 0
        self._taps: list[Callable[[str, Mapping[str, Any]], None]] = []

    @property
    def listeners(self) -> int:
        """How many mailboxes are open."""
        return len(self._mailboxes)

    def message(self, kind: str, /, **fields: Any) -> Message:
        """A numbered message; NaN and infinity become null."""
        self._seq += 1
        body = {"type": kind, "seq": self._seq, "t_unix_us": unix_us(), **fields}
        text = orjson.dumps(body, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS).decode()
        key = None
        # An operator's fix is an answer that somebody waits for; matches come several times a second.
        if kind in COALESCED and fields.get("kind") != "operator":
            key = f"{kind}/{fields.get('vehicle_id', '')}/{fields.get('source', '')}/{fields.get('accepted', '')}"
            key += f"/{fields.get('target_id', '')}"
        return Message(text, key)

    def publish(self, kind: str, /, **fields: Any) -> None:
        """Say something to everybody who listens."""
        for tap in self._taps:
            try:
                tap(kind, fields)
            except Exception:  # what one part cannot read the others still hear
                _log.exception("a part of the station cannot read a message", kind=kind)
        if not self._mailboxes:
            self._seq += 1
            return
        message = self.message(kind, **fields)
        for mailbox in self._mailboxes:
            mailbox.put(message)

    def tap(self, hear: Callable[[str, Mapping[str, Any]], None]) -> None:
        """Have a part of the station hear kind and fields of everything that is published, before it is text."""
        self._taps.append(hear)

    def open(self) -> Mailbox:
        """A mailbox that from now on receives everything."""
        mailbox = Mailbox()
        self._mailboxes.add(mailbox)
        return mailbox

    def close(self, mailbox: Mailbox) -> None:
        """Stop filling a mailbox."""
        self._mailboxes.discard(mailbox)
