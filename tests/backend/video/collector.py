"""Runs a channel in a test and waits, without sleeping, for what it delivers."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from backend.video.channel import VideoChannel
from backend.video.frames import DecodedFrame, EncodedFrame

WAIT_S = 20.0


class Collector:
    """Collects what a channel hands out."""

    def __init__(self, url: str, **options: Any) -> None:
        self.encoded: list[EncodedFrame] = []
        self.decoded: list[DecodedFrame] = []
        self.jpegs: list[EncodedFrame] = []
        self._changed = threading.Condition()
        self.channel = VideoChannel(
            url,
            on_encoded=lambda f: self._note(self.encoded, f),
            on_decoded=lambda f: self._note(self.decoded, f),
            on_jpeg=lambda f: self._note(self.jpegs, f),
            **options,
        )

    def __enter__(self) -> Self:
        self.channel.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.channel.close()

    def wait_for(self, done: Callable[[], bool], what: str) -> None:
        """Until ``done`` holds; looked at whenever something is delivered, and now and then."""
        with self._changed:
            for _ in range(int(WAIT_S / 0.05)):
                if done():
                    return
                self._changed.wait(0.05)
        raise AssertionError(f"not in {WAIT_S} s: {what}; health {self.channel.health()}")

    def wait_for_text(self, text: str) -> None:
        self.wait_for(lambda: text in self.channel.health().text, f"health says {text!r}")

    def _note(self, where: list[Any], item: Any) -> None:
        with self._changed:
            where.append(item)
            self._changed.notify_all()


def free_udp_port() -> int:
    """A port of this machine that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])
