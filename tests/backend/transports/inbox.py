"""Receives in the tests: collects bytes and lets a test await them instead of sleeping."""

import asyncio

PATIENCE_S = 10.0


class Inbox:
    def __init__(self) -> None:
        self.chunks: list[bytes] = []
        self._more = asyncio.Event()

    def __call__(self, data: bytes) -> None:
        self.chunks.append(data)
        self._more.set()

    @property
    def data(self) -> bytes:
        return b"".join(self.chunks)

    async def until(self, end: bytes) -> None:
        """Wait until what has come ends with these bytes."""
        async with asyncio.timeout(PATIENCE_S):
            while not self.data.endswith(end):
                self._more.clear()
                await self._more.wait()


async def turns(condition: object, count: int = 100_000) -> None:
    """Give the event loop its turn until the condition, a callable, holds."""
    assert callable(condition)
    async with asyncio.timeout(PATIENCE_S):
        for _ in range(count):
            if condition():
                return
            await asyncio.sleep(0)
    message = "the condition never held"
    raise AssertionError(message)
