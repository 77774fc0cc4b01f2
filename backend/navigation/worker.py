"""One thread that owns one vehicle's Navigator.

Samples come in from the event loop and the video decoder; states and fix reports go out. Nobody else touches the
Navigator: who wants something of it asks, and the thread answers between two pieces of work.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import structlog

from backend.clock import mono_us, unix_us
from estimator.history import Corrected
from estimator.navigator import Outlook
from estimator.types import FixReport, FrameSample, GnssSample, InertialSample, NavigationState, Sample

MAX_WAITING_SAMPLES = 20_000  # a minute and a half of a fast link
MAX_WAITING_FRAMES = 8  # a third of a second: longer, and the estimate would only be late
STATE_INTERVAL_US = 50_000
IDLE_S = 0.05
REBUILD_AFTER_US = 2_000_000
# A picture that comes after the estimator has passed its time is lost to it: the horizon follows the slowest pictures.
MAX_DELAY_US = 2_000_000
DELAY_MARGIN_US = 60_000
AGES_KEPT = 50

_log = structlog.get_logger(__name__)


class NavigatorLike(Protocol):
    """What the worker needs of `estimator.navigator.Navigator`, which documents it."""

    gps_denied: bool
    corrected: Callable[[], list[Corrected]]
    while_busy: Callable[[Outlook], AbstractContextManager[None]]

    @property
    def waiting_for(self) -> str | None:
        """What alignment still lacks."""

    def offer(self, sample: Sample) -> None:
        """Take a sample."""

    def advance(self, t_us: int) -> list[FixReport]:
        """Process the samples up to a time."""

    def predict(self, t_us: int) -> NavigationState | None:
        """The state carried on to a time."""

    def state_at(self, t_us: int) -> NavigationState | None:
        """The state at a past time."""

    def exposure_us(self, t_frame_us: int) -> int:
        """When a picture with this frame time was taken."""


@dataclass(slots=True)
class WorkerCounts:
    """What the worker did; written by its thread, read by anyone."""

    samples: int = 0
    samples_dropped: int = 0
    frames: int = 0
    frames_dropped: int = 0
    failures: int = 0
    advance_ms: deque[float] = field(default_factory=lambda: deque(maxlen=200))


@dataclass(frozen=True, slots=True)
class StateUpdate:
    """The state now, and of which epoch it is: a new epoch means that the estimator began anew."""

    state: NavigationState
    epoch: int
    gps_denied: bool


@dataclass(frozen=True, slots=True)
class _StateQuestion:
    t_us: int
    answer: Future[NavigationState | None]


class NavigationWorker:
    """Runs a Navigator behind the clock: by ``delay_us``, or by more where pictures take longer to arrive.

    Its methods may be called from any thread and never wait.

    ``on_state`` and ``on_reports`` are called in the worker's thread.
    """

    def __init__(
        self, name: str, build: Callable[[], NavigatorLike], *, delay_us: int,
        on_state: Callable[[StateUpdate], None], on_reports: Callable[[list[FixReport]], None],
        now_us: Callable[[], int] = unix_us, gps_denied: bool = False, first_epoch: int = 1,
    ) -> None:  # fmt: skip
        self.counts = WorkerCounts()
        self.waiting_for: str | None = "the navigator to start"
        self.failure: str | None = None
        self.epoch = first_epoch
        self.corrected: Callable[[], list[Corrected]] = list
        self._build = build
        self._least_delay_us = delay_us
        self._frame_ages_us: deque[int] = deque(maxlen=AGES_KEPT)
        self._on_state = on_state
        self._on_reports = on_reports
        self._now_us = now_us
        self._gps_denied = gps_denied
        self._samples: deque[Sample] = deque()
        self._questions: deque[_StateQuestion] = deque()
        self._waiting_frames = 0
        self._changed = threading.Condition()
        self._video_offset_us = 0
        self._outlook: Outlook | None = None
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=f"navigation-{name}", daemon=True)

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    @property
    def gps_denied(self) -> bool:
        """Whether GPS is kept from the estimator."""
        return self._gps_denied

    def deny_gps(self, denied: bool) -> None:
        """Keep GPS from the estimator, or give it back."""
        self._gps_denied = denied

    @property
    def waiting_samples(self) -> int:
        """How many samples have not been looked at yet."""
        return len(self._samples)

    @property
    def delay_us(self) -> int:
        """How far behind the clock the estimator runs now."""
        with self._changed:
            ages = sorted(self._frame_ages_us)
        if not ages:
            return self._least_delay_us
        usual_us = ages[len(ages) * 9 // 10] + DELAY_MARGIN_US
        return min(max(usual_us, self._least_delay_us), MAX_DELAY_US)

    def exposure_us(self, t_frame_us: int) -> int:
        """When a picture with this frame time, not stamped, was taken, as far as the video's clock is known."""
        return t_frame_us + self._video_offset_us

    def offer(self, sample: Sample) -> None:
        """Hand in a sample. When the estimator falls behind, old pictures go first, then old samples; both counted."""
        with self._changed:
            if self._stopping or (self._gps_denied and isinstance(sample, GnssSample)):
                # One of these would still wait here when GPS is given back.
                return
            if isinstance(sample, FrameSample):
                self._waiting_frames += 1
                self._frame_ages_us.append(self._now_us() - sample.t_us)
                if self._waiting_frames > MAX_WAITING_FRAMES:
                    self._drop_oldest_frame()
            self._samples.append(sample)
            if len(self._samples) > MAX_WAITING_SAMPLES:
                dropped = self._samples.popleft()
                self._waiting_frames -= isinstance(dropped, FrameSample)
                self.counts.samples_dropped += 1
            self._changed.notify()

    def state_at(self, t_us: int) -> Future[NavigationState | None]:
        """The state at a time (predicted when it is ahead of the horizon); None when it is not known.

        While the thread works on a picture the caller's own thread answers, by what was known when that began and the
        samples that have come since: a click must not wait for a registration.
        """
        question = _StateQuestion(t_us, Future())
        with self._changed:
            if self._stopping:
                question.answer.cancel()
            elif self._outlook is not None:
                self._answer_by_outlook(self._outlook, [question])
            else:
                self._questions.append(question)
                self._changed.notify()
        return question.answer

    def close(self, timeout_s: float = 1.0) -> None:
        """Stop the thread; questions still open are cancelled."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout_s)
        with self._changed:
            while self._questions:
                self._questions.popleft().answer.cancel()

    @contextmanager
    def _while_busy(self, outlook: Outlook) -> Iterator[None]:
        with self._changed:
            self._outlook = outlook
            waiting, self._questions = list(self._questions), deque()
            self._answer_by_outlook(outlook, waiting)
        try:
            yield
        finally:
            with self._changed:
                self._outlook = None

    def _answer_by_outlook(self, outlook: Outlook, questions: Sequence[_StateQuestion]) -> None:
        if questions:
            newer = tuple(sample for sample in self._samples if isinstance(sample, InertialSample))
            for question in questions:
                _answer(lambda t_us: outlook(t_us, newer), question)

    def _drop_oldest_frame(self) -> None:
        for position, sample in enumerate(self._samples):
            if isinstance(sample, FrameSample):
                del self._samples[position]
                self._waiting_frames -= 1
                self.counts.frames_dropped += 1
                return

    def _take(self) -> tuple[list[Sample], list[_StateQuestion]] | None:
        """What came in, after waiting a moment for it; None at the end."""
        with self._changed:
            if not (self._samples or self._questions or self._stopping):
                self._changed.wait(IDLE_S)
            if self._stopping:
                return None
            samples, questions = list(self._samples), list(self._questions)
            self._samples.clear()
            self._questions.clear()
            self._waiting_frames = 0
            return samples, questions

    def _run(self) -> None:
        navigator: NavigatorLike | None = None
        rebuild_us = 0
        last_state_us = 0
        while (taken := self._take()) is not None:
            samples, questions = taken
            try:
                if navigator is None and mono_us() >= rebuild_us:
                    navigator = self._build()
                    navigator.while_busy = self._while_busy
                    self.corrected = navigator.corrected
                if navigator is not None:
                    self._offer(navigator, samples)
                    # Somebody waits for these, and a step with a registration takes a while.
                    while questions:
                        _answer(partial(_state_at, navigator), questions.pop(0))
                    self._advance(navigator, bool(samples))
                    if mono_us() - last_state_us >= STATE_INTERVAL_US:
                        # In step with the interval on the average, whatever the rhythm of the samples is.
                        last_state_us = max(last_state_us + STATE_INTERVAL_US, mono_us() - STATE_INTERVAL_US)
                        self._publish(navigator)
            except Exception as error:  # the estimator failed: say so, start it anew, keep the station alive
                self.counts.failures += 1
                self.failure = f"{type(error).__name__}: {error}"
                _log.exception("navigator failed", worker=self._thread.name)
                navigator, rebuild_us = None, mono_us() + REBUILD_AFTER_US
                self.epoch += 1
            for question in questions:
                _answer(lambda _: None, question)

    def _offer(self, navigator: NavigatorLike, samples: list[Sample]) -> None:
        navigator.gps_denied = self._gps_denied
        for sample in samples:
            navigator.offer(sample)
            self.counts.samples += 1
            self.counts.frames += isinstance(sample, FrameSample)
        self._video_offset_us = navigator.exposure_us(0)

    def _advance(self, navigator: NavigatorLike, has_news: bool) -> None:
        started_us = mono_us()
        reports = navigator.advance(self._now_us() - self.delay_us)
        if has_news:
            self.counts.advance_ms.append((mono_us() - started_us) / 1e3)
        if reports:
            self._on_reports(reports)

    def _publish(self, navigator: NavigatorLike) -> None:
        self.waiting_for = navigator.waiting_for
        state = navigator.predict(self._now_us())
        if state is not None:
            self.failure = None
            self._on_state(StateUpdate(state, self.epoch, self._gps_denied))


def _answer(state_at: Callable[[int], NavigationState | None], question: _StateQuestion) -> None:
    try:
        state = state_at(question.t_us)
    except Exception as error:  # the asker decides what to make of it
        question.answer.set_exception(error)
        return
    if not question.answer.cancelled():
        question.answer.set_result(state)


def _state_at(navigator: NavigatorLike, t_us: int) -> NavigationState | None:
    state = navigator.state_at(t_us)
    if state is not None:
        return state
    ahead = navigator.predict(t_us)
    # A time before the history gives a state at another time: that is no answer.
    return ahead if ahead is not None and abs(ahead.t_us - t_us) <= 1000 else None
