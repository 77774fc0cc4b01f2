"""Which pages are open: what steers an aircraft ends when the page of the operator who began it goes away.

A page names itself when it opens the stream and when it asks for something. A page that comes back within a moment, as
after a hiccup of the network, has not gone.
"""

from __future__ import annotations

from collections import Counter

from backend.clock import mono_us

# A page says something every three seconds.
SILENT_US = 9_000_000
GONE_US = 2_000_000


class Pages:
    """The open pages by name; times are of the monotonic clock. Lives on the event loop."""

    def __init__(self) -> None:
        self._open: Counter[str] = Counter()
        self._heard_us: dict[str, int] = {}
        self._closed_us: dict[str, int] = {}

    def opened(self, name: str) -> None:
        """A stream of a page was opened."""
        self._open[name] += 1
        self._heard_us[name] = mono_us()

    def heard(self, name: str) -> None:
        """A page has said something."""
        self._heard_us[name] = mono_us()

    def closed(self, name: str) -> None:
        """A stream of a page was closed."""
        self._open[name] -= 1
        self._closed_us[name] = mono_us()
        self._forget()

    def is_there(self, name: str, now_us: int) -> bool:
        """Whether a page is open and heard, or was a moment ago."""
        if self._open[name] > 0:
            return now_us - self._heard_us[name] < SILENT_US
        return name in self._closed_us and now_us - self._closed_us[name] < GONE_US

    def _forget(self) -> None:
        """Pages are many over the years."""
        now_us = mono_us()
        for name in [name for name, closed_us in self._closed_us.items() if now_us - closed_us > GONE_US]:
            if self._open[name] <= 0:
                self._open.pop(name, None)
                self._heard_us.pop(name, None)
            self._closed_us.pop(name)
