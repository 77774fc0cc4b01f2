"""What every transport is, and the loop of those that have to try again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

OnData = Callable[[bytes], None]
FIRST_RETRY_S = 0.5
LONGEST_RETRY_S = 8.0


class TransportError(Exception):
    """A connection string that cannot be understood, or a local port or address that cannot be had."""

    def __init__(self, connection: str, reason: str) -> None:
        self.connection = connection
        self.reason = reason
        super().__init__(f"'{connection}': {reason}")


class Transport(Protocol):
    """A way for bytes; lives on one event loop."""

    @property
    def status(self) -> str:
        """What it is doing or waiting for, in words for the operator."""
        ...

    async def open(self, on_data: OnData) -> None:
        """Start; ``on_data`` gets bytes on the event loop.

        A listener raises TransportError when its address is taken or not of this machine. Whatever may come up later
        (a peer, a device) is waited for with a growing pause between the attempts.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send one packet; dropped when nobody is connected or the way is blocked."""
        ...

    async def close(self) -> None:
        """Stop and free everything; may be called at any time, also twice."""
        ...


def deliver(on_data: OnData, data: bytes) -> None:
    """Hand over bytes; a fault of the receiver is reported to the event loop and does not close the connection."""
    try:
        on_data(data)
    except Exception as error:
        asyncio.get_running_loop().call_exception_handler(
            {"message": f"a receiver of {len(data)} bytes failed", "exception": error}
        )


class Reconnecting:
    """Base of transports that live in sessions: a session that ends or fails is followed by a pause and another."""

    def __init__(self, name: str, *, first_retry_s: float = FIRST_RETRY_S) -> None:
        self._name = name
        self._status = f"{name}: not open"
        self._first_retry_s = first_retry_s
        self._task: asyncio.Task[None] | None = None
        self._on_data: OnData | None = None
        self._has_received = False

    @property
    def status(self) -> str:
        """What it is doing or waiting for."""
        return self._status

    async def open(self, on_data: OnData) -> None:
        """Start the sessions."""
        self._on_data = on_data
        self._task = asyncio.create_task(self._run(), name=self._name)

    async def close(self) -> None:
        """End the session and try no more."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        self._status = f"{self._name}: closed"

    async def session(self) -> None:
        """Connect, serve, and return or raise OSError when it is over; to be written by each transport."""
        raise NotImplementedError

    def _received(self, data: bytes) -> None:
        if not self._has_received:
            self._has_received = True
            self._status = f"{self._name}: receiving"
        if self._on_data is not None:
            deliver(self._on_data, data)

    async def _run(self) -> None:
        retry_s = self._first_retry_s
        while True:
            self._has_received = False
            try:
                await self.session()
                reason = "the other side closed the connection"
            except (OSError, ValueError) as error:
                reason = str(error) or type(error).__name__
            if self._has_received:
                retry_s = self._first_retry_s
            self._status = f"{self._name}: {reason}; trying again"
            await asyncio.sleep(retry_s)
            retry_s = min(2.0 * retry_s, LONGEST_RETRY_S)
