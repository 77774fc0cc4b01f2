"""What every source has in common: it runs beside, tries again for ever, and is silent once closed."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from backend.clock import mono_us
from backend.video.errors import RecordedVideoError
from backend.video.frames import VideoUnit
from backend.video.source import Gone, VideoSource
from tests.backend.video.gathered import WAIT_S, Gathered


class Waits(threading.Event):
    """Notes how long each pause would have been, and does not make it."""

    def __init__(self) -> None:
        super().__init__()
        self.pauses_s: list[float | None] = []

    def wait(self, timeout: float | None = None) -> bool:
        self.pauses_s.append(timeout)
        return self.is_set()


class Scripted(VideoSource):
    """Each session is the next of a list; when they are at an end it waits to be closed."""

    def __init__(
        self, sessions: list[Callable[[Scripted], None]], output: Gathered, clock: Callable[[], int] = mono_us
    ) -> None:
        super().__init__(output, clock)
        self.stopping = Waits()
        self.ended = threading.Event()
        self._sessions = list(sessions)

    def session(self) -> None:
        if self._sessions:
            self._sessions.pop(0)(self)
            return
        self.ended.set()
        threading.Event.wait(self.stopping, WAIT_S)


def unit(number: int) -> VideoUnit:
    return VideoUnit("h264", bytes([number]), None, number)


def failing(error: Exception) -> Callable[[Scripted], None]:
    def session(source: Scripted) -> None:
        raise error

    return session


def run_to_end(source: Scripted) -> None:
    source.start()
    assert source.ended.wait(WAIT_S)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (Gone("waiting for the camera"), "waiting for the camera"),
        (OSError(98, "Address already in use"), "Address already in use"),
        # what a damaged file or a library raises that nobody has thought of
        (RecordedVideoError("x.mp4", "cut off"), "cut off"),  # type: ignore[arg-type]
        (ZeroDivisionError("time base of 0"), "ZeroDivisionError: time base of 0"),
    ],
)
def test_whatever_ends_a_session_is_told_and_tried_again(error: Exception, words: str) -> None:
    output = Gathered()
    source = Scripted([failing(error), lambda s: s.deliver(unit(1))], output)
    said: list[str] = []
    output.interrupted = lambda: (said.append(source.status), Gathered.interrupted(output))[1]  # type: ignore[method-assign]
    run_to_end(source)
    source.close()

    assert words in said[0]
    # the delivery of the second session comes after the interruption by the end of the first
    assert output.all == [None, unit(1), None]


def test_pauses_grow_up_to_two_seconds_and_start_small_after_a_good_session() -> None:
    now_us = [0]

    def long(source: Scripted) -> None:
        now_us[0] += 11_000_000

    sessions = [failing(Gone("no"))] * 5 + [long, failing(Gone("no"))]
    source = Scripted(sessions, Gathered(), lambda: now_us[0])
    run_to_end(source)
    source.close()

    assert source.stopping.pauses_s[:7] == [0.5, 1.0, 2.0, 2.0, 2.0, 0.25, 0.5]  # type: ignore[attr-defined]


def test_nothing_is_delivered_once_it_is_closed() -> None:
    output, inside, closed = Gathered(), threading.Event(), threading.Event()

    def session(source: Scripted) -> None:
        source.deliver(unit(1))
        inside.set()
        assert closed.wait(WAIT_S)
        source.deliver(unit(2))

    source = Scripted([session], output)
    source.start()
    assert inside.wait(WAIT_S)
    source.stopping.set()
    closed.set()
    source.close()
    source.close()

    assert output.all == [unit(1)]


def test_it_may_be_closed_before_it_starts_and_from_its_own_thread() -> None:
    Scripted([], Gathered()).close()
    output = Gathered()
    source = Scripted([lambda s: s.close()], output)
    source.start()
    source._thread.join(WAIT_S)

    assert not source._thread.is_alive()
    assert output.all == []
