"""From other threads to the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

Value = TypeVar("Value")


def call_from_thread(loop: asyncio.AbstractEventLoop, call: Callable[[Value], None], value: Value) -> None:
    """Have the loop call with a value; nothing once it is closed, where a thread still hands out its last."""
    try:
        loop.call_soon_threadsafe(call, value)
    except RuntimeError:
        # asked only now: a loop that was open when asked before may be closed by the time of the call
        if not loop.is_closed():
            raise
