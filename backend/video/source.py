"""Where video comes from: the frame that every source fills in."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

import structlog

from backend.video.frames import VideoUnit
from estimator.types import Image

Clock = Callable[[], int]

_JOIN_S = 0.9
_FIRST_RETRY_S = 0.25
_LONGEST_RETRY_S = 2.0

_log = structlog.get_logger(__name__)


class SourceOutput(Protocol):
    """Who takes what a source delivers. Called from the source's thread; must not block."""

    def unit(self, unit: VideoUnit) -> None:
        """A coded picture."""

    def picture(self, image: Image, pts_us: int | None, t_wire_us: int) -> None:
        """A picture that the source had to decode, BGR; ``pts_us`` and ``t_wire_us`` as in `VideoUnit`."""

    def interrupted(self) -> None:
        """What follows does not continue what was before: a reconnect, a silence, a jump."""


class Gone(Exception):  # noqa: N818  an expected event, not an error of the program
    """A source cannot be opened or has ended; the text says what is waited for. It is tried again."""


class VideoSource(ABC):
    """Runs in a thread of its own and tries again for ever; nothing it meets reaches the caller as an exception.

    ``status`` says in words what it does or waits for.
    """

    def __init__(self, output: SourceOutput, clock: Clock) -> None:
        self.output = output
        self.clock = clock
        self.status = "not started"
        self.stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=type(self).__name__, daemon=True)

    def start(self) -> None:
        """Begin; returns at once."""
        self._thread.start()

    def close(self) -> None:
        """End, in less than a second. Afterwards nothing is delivered any more."""
        self.stopping.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(_JOIN_S)

    def deliver(self, unit: VideoUnit) -> None:
        """Hand on a unit unless the source has been closed."""
        if not self.stopping.is_set():
            self.output.unit(unit)

    @abstractmethod
    def session(self) -> None:
        """Open, deliver until the end or until ``stopping`` is set; raises `Gone` or OSError when it cannot go on."""

    def _run(self) -> None:
        wait_s = _FIRST_RETRY_S
        while not self.stopping.is_set():
            begun_us = self.clock()
            try:
                self.session()
            except (Gone, OSError) as error:
                self.status = str(error)
            except Exception as error:  # a thread that ends here would leave the station blind, and nobody told
                self.status = f"the video source failed ({type(error).__name__}: {error}); trying again"
                _log.exception("video source failed", source=type(self).__name__)
            if self.stopping.is_set():
                return
            self.output.interrupted()
            lasted_s = (self.clock() - begun_us) / 1e6
            wait_s = _FIRST_RETRY_S if lasted_s > 10 else min(2 * wait_s, _LONGEST_RETRY_S)
            self.stopping.wait(wait_s)
