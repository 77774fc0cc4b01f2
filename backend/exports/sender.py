"""Tells receivers of Cursor on Target events of every target, when it changes and before it is stale."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from backend.errors import StartError
from backend.exports.cot import STALE_AFTER_US
from backend.exports.destination import Destination
from backend.exports.peer import CotPeer, Notice, PeerState
from backend.metrics import Metrics
from backend.store.targets import Target

# Two datagrams in a row may be lost before a target is stale.
REPEAT_S = STALE_AFTER_US / 1e6 / 3 - 10.0


class CotSender:
    """All receivers; does nothing when there is none. Lives on the event loop, and never makes it wait."""

    def __init__(
        self, destinations: Sequence[str], current: Callable[[], list[Target]], metrics: Metrics, *,
        repeat_s: float = REPEAT_S,
    ) -> None:  # fmt: skip
        """``current()`` gives all targets. Raises ValueError for a text that is no destination."""
        self._current = current
        self._repeat_s = repeat_s
        self._repeating: asyncio.Task[None] | None = None
        self._peers: list[CotPeer] = []
        self._destinations = [Destination.parse(text) for text in dict.fromkeys(destinations)]
        for destination in self._destinations:
            self._peers.append(CotPeer(destination, current, metrics))

    def start(self) -> None:
        """Begin; what is kept already is sent first. Raises StartError for an interface that this machine has not."""
        for destination in self._destinations:
            try:
                destination.check_interface()
            except OSError as error:
                raise StartError(f"--cot {destination.text}: {error}") from None
        for peer in self._peers:
            peer.start()
        if self._peers:
            self._repeating = asyncio.create_task(self._repeat())

    async def close(self) -> None:
        """End. Receivers keep what they know until it is stale."""
        task, self._repeating = self._repeating, None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        for peer in self._peers:
            await peer.close()

    def changed(self, target: Target) -> None:
        """Tell of a new or changed target."""
        for peer in self._peers:
            peer.put(Notice(target))

    def deleted(self, target: Target) -> None:
        """Tell once that a target is no more."""
        for peer in self._peers:
            peer.put(Notice(target, deleted=True))

    def states(self) -> list[PeerState]:
        """How it goes with each receiver."""
        return [peer.state for peer in self._peers]

    def waiting_for(self) -> list[str]:
        """Receivers that cannot be reached, in the operator's words."""
        return [f"CoT to {one.destination}: {one.problem}" for one in self.states() if one.problem is not None]

    async def _repeat(self) -> None:
        while True:
            await asyncio.sleep(self._repeat_s)
            for target in self._current():
                self.changed(target)
