"""One thread that looks for the followed targets of one vehicle in its pictures.

It stands behind the estimator and the video: live pictures come into a short queue from which the oldest are dropped,
it works at most half of the time, and asks for states as a click does. Of a replay no picture is left out: they are
read from the recording as far as they are shown.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import structlog

from backend.clock import mono_us
from backend.fleet.cameras import ColourPicture
from backend.following.follower import Follower, Look
from backend.following.sources import FollowSource

STEP_US = 180_000  # five a second of 25 or 30: what the tracker was measured at
MOST_WAITING = 8
IDLE_S = 0.05
FLIGHT_ENDED = "the video of the flight ends"

_log = structlog.get_logger(__name__)


@dataclass(slots=True)
class FollowCounts:
    """What the thread did; written by it, read by anyone. ``look_ms`` is the processor time of each last look."""

    pictures: int = 0
    dropped: int = 0
    look_ms: deque[float] = field(default_factory=lambda: deque(maxlen=500))


@dataclass(slots=True, eq=False)
class _Followed:
    follower: Follower
    catching_up: Iterator[ColourPicture] | None
    pending: ColourPicture | None = None


class FollowWorker:
    """Runs followers. ``on_look`` and ``on_end`` (target id, reason) are called in its thread."""

    def __init__(
        self, source: FollowSource, on_look: Callable[[Look], None], on_end: Callable[[tuple[str, str]], None]
    ) -> None:
        self.counts = FollowCounts()
        self._source = source
        self._on_look, self._on_end = on_look, on_end
        self._followed: dict[str, _Followed] = {}
        self._waiting: deque[ColourPicture] = deque()
        self._newest_us = 0
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=f"following-{source.vehicle.id}", daemon=True)

    @property
    def vehicle_id(self) -> str:
        """Whose targets it looks for."""
        return self._source.vehicle.id

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self, timeout_s: float = 2.0) -> None:
        """End; the look that runs is finished."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout_s)

    def add(self, follower: Follower, catching_up: Iterator[ColourPicture]) -> None:
        """Follow one more, first through the pictures that have come since its click."""
        with self._changed:
            self._followed[follower.target_id] = _Followed(follower, catching_up)
            self._changed.notify()

    def remove(self, target_id: str) -> None:
        """Follow one less."""
        with self._changed:
            self._followed.pop(target_id, None)
            if not self._followed:
                self._waiting.clear()

    def wants(self, t_us: int) -> bool:
        """Whether a picture of this time is far enough from the last one; a clock set back begins anew."""
        return bool(self._followed) and not 0 <= t_us - self._newest_us < STEP_US

    def offer(self, picture: ColourPicture) -> None:
        """Take a picture; the oldest that waits is dropped for it."""
        with self._changed:
            self._newest_us = picture.frame.t_us
            self._waiting.append(picture)
            if len(self._waiting) > MOST_WAITING:
                self._waiting.popleft()
                self.counts.dropped += 1
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                if self._closing:
                    return
                picture = self._waiting.popleft() if self._waiting and self._is_due(self._waiting[0]) else None
                followed = list(self._followed.values())
                if picture is None and not any(self._has_next(one) for one in followed):
                    self._changed.wait(IDLE_S if followed else None)
                    continue
            began_us = mono_us()
            for one in followed:
                if one.catching_up is not None:
                    self._catch_up(one, one.catching_up)
                    continue
                if one.pending is not None and self._is_due(one.pending):
                    pending, one.pending = one.pending, None
                    self._look(one, pending)
                if picture is not None:
                    self._look(one, picture)
            with self._changed:
                # no more than half of one processor, whatever a search costs
                self._changed.wait_for(lambda: self._closing, (mono_us() - began_us) / 1e6)

    def _is_due(self, picture: ColourPicture) -> bool:
        return self._source.is_due(picture.frame)

    def _has_next(self, one: _Followed) -> bool:
        return one.catching_up is not None if one.pending is None else self._is_due(one.pending)

    def _catch_up(self, one: _Followed, pictures: Iterator[ColourPicture]) -> None:
        """Look at the next picture after the click; with the first that is not due the live ones are next."""
        picture = next(pictures, None) if one.pending is None else one.pending
        one.pending = None
        if picture is not None and self._is_due(picture):
            self._look(one, picture)
        elif self._source.is_live:
            one.catching_up, one.pending = None, picture
        elif picture is None:
            self._end(one.follower, FLIGHT_ENDED)
        else:
            one.pending = picture

    def _look(self, one: _Followed, picture: ColourPicture) -> None:
        follower = one.follower
        try:
            if self._source.setup is not follower.setup:
                self._end(follower, "the estimator was set up anew")
                return
            t_us = self._source.exposure_us(picture.frame)
            state = self._source.state_at(t_us)
            began_s = time.thread_time()
            look = follower.look(picture, t_us, state)
            self.counts.look_ms.append((time.thread_time() - began_s) * 1e3)
            self.counts.pictures += 1
        except Exception as error:  # one target must not end the others, nor the thread
            _log.exception("following failed", target=follower.target_id)
            self._end(follower, f"following failed: {error}")
            return
        if look is not None:
            self._on_look(look)

    def _end(self, follower: Follower, reason: str) -> None:
        self.remove(follower.target_id)
        self._on_end((follower.target_id, reason))
