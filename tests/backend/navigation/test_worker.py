"""The estimator's thread: order, load, questions, failures."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import AbstractContextManager, nullcontext

import numpy as np
import pytest

from backend.navigation.worker import MAX_WAITING_FRAMES, NavigationWorker, StateUpdate
from estimator.history import Corrected
from estimator.navigator import Outlook
from estimator.types import (
    BarometerSample,
    FixReport,
    FrameSample,
    GnssSample,
    InertialSample,
    Mode,
    NavigationState,
    Sample,
)

PATIENCE_S = 10.0


def state(t_us: int) -> NavigationState:
    nan3 = np.full((3, 3), np.nan)
    return NavigationState(
        t_us, Mode.GPS, "inertial", 0.8, 0.1, 500.0, 100.0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0, 0]),
        np.array([1.0, 0, 0, 0]), np.eye(3), nan3, nan3, np.zeros((6, 6)), 0.0,
    )  # fmt: skip


class Recording:
    """A navigator that notes what it is asked; ``gate`` holds it up, ``fail`` breaks it once."""

    def __init__(self) -> None:
        self.gps_denied = False
        self.offered: list[Sample] = []
        self.denied_seen: list[bool] = []
        self.gate = threading.Event()
        self.gate.set()
        self.entered = threading.Event()
        self.fail = False
        self.corrected: Callable[[], list[Corrected]] = list
        self.while_busy: Callable[[Outlook], AbstractContextManager[None]] = lambda _: nullcontext()

    @property
    def waiting_for(self) -> str | None:
        return None

    def offer(self, sample: Sample) -> None:
        self.offered.append(sample)
        self.denied_seen.append(self.gps_denied)

    def advance(self, t_us: int) -> list[FixReport]:
        self.entered.set()
        assert self.gate.wait(PATIENCE_S)
        if self.fail:
            self.fail = False
            raise FloatingPointError("covariance is not positive")
        return []

    def predict(self, t_us: int) -> NavigationState | None:
        return state(t_us)

    def state_at(self, t_us: int) -> NavigationState | None:
        return state(t_us) if t_us < 1000 else None

    def exposure_us(self, t_frame_us: int) -> int:
        return t_frame_us - 120_000


class Running:
    def __init__(self, build: Callable[[], Recording]) -> None:
        self.states: list[StateUpdate] = []
        self.said = threading.Condition()
        self.worker = NavigationWorker(
            "test", build, delay_us=0, on_state=self._state, on_reports=lambda _: None, now_us=lambda: 5000
        )
        self.worker.start()

    def _state(self, update: StateUpdate) -> None:
        with self.said:
            self.states.append(update)
            self.said.notify_all()

    def wait_for(self, condition: Callable[[], bool]) -> None:
        with self.said:
            assert self.said.wait_for(condition, PATIENCE_S)


def test_a_question_does_not_wait_for_the_step_that_comes_with_it() -> None:
    """A click and a sample wait together: the click is answered, with the sample known, before the long step begins."""
    navigator, building, built = Recording(), threading.Event(), threading.Event()

    def build() -> Recording:
        building.set()
        assert built.wait(PATIENCE_S)
        return navigator

    running = Running(build)
    running.worker.offer(BarometerSample(1, 0.0))
    assert building.wait(PATIENCE_S)
    running.worker.offer(BarometerSample(2, 0.0))
    answer = running.worker.state_at(900)
    first_step = navigator.advance

    def advance(t_us: int) -> list[FixReport]:
        if len(navigator.offered) > 1:
            navigator.gate.clear()  # the second step takes until the answer is there
        return first_step(t_us)

    navigator.advance = advance  # type: ignore[method-assign]
    built.set()
    try:
        found = answer.result(PATIENCE_S / 2)
    finally:
        navigator.gate.set()
        running.worker.close()

    assert found is not None
    assert found.t_us == 900


def test_samples_reach_the_estimator_in_order() -> None:
    navigator = Recording()
    running = Running(lambda: navigator)
    for n in range(100):
        running.worker.offer(BarometerSample(n, 1.0))
    running.wait_for(lambda: len(navigator.offered) == 100)
    running.worker.close()

    assert [sample.t_us for sample in navigator.offered] == list(range(100))


def test_an_estimator_that_falls_behind_loses_the_oldest_pictures_only() -> None:
    navigator = Recording()
    navigator.gate.clear()
    running = Running(lambda: navigator)
    running.worker.offer(BarometerSample(0, 1.0))
    assert navigator.entered.wait(PATIENCE_S)
    image = np.zeros((2, 2), np.uint8)
    for n in range(1, 21):
        running.worker.offer(FrameSample(n, n, image))
        running.worker.offer(BarometerSample(n, 1.0))
    navigator.gate.set()
    running.wait_for(lambda: len(navigator.offered) >= 21 + MAX_WAITING_FRAMES)
    running.worker.close()

    frames = [sample.t_us for sample in navigator.offered if isinstance(sample, FrameSample)]
    assert frames == list(range(21 - MAX_WAITING_FRAMES, 21))
    assert running.worker.counts.frames_dropped == 20 - MAX_WAITING_FRAMES
    assert sum(isinstance(sample, BarometerSample) for sample in navigator.offered) == 21


def test_a_question_is_answered_from_history_or_by_prediction() -> None:
    running = Running(Recording)
    past = running.worker.state_at(500).result(PATIENCE_S)
    ahead = running.worker.state_at(6000).result(PATIENCE_S)
    running.worker.close()

    assert past is not None
    assert ahead is not None
    assert (past.t_us, ahead.t_us) == (500, 6000)


def test_denial_is_seen_by_the_next_sample() -> None:
    navigator = Recording()
    running = Running(lambda: navigator)
    running.worker.deny_gps(True)
    running.worker.offer(BarometerSample(1, 1.0))
    running.wait_for(lambda: any(update.gps_denied for update in running.states) and bool(navigator.offered))
    running.worker.close()

    assert navigator.denied_seen == [True]


def test_a_failing_estimator_is_started_anew_in_a_new_epoch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("backend.navigation.worker.REBUILD_AFTER_US", 0)
    built: list[Recording] = []

    def build() -> Recording:
        built.append(Recording())
        built[-1].fail = len(built) == 1
        return built[-1]

    running = Running(build)
    running.worker.offer(BarometerSample(1, 1.0))
    running.wait_for(lambda: any(update.epoch == 2 for update in running.states))
    running.worker.close()

    assert len(built) == 2
    assert running.worker.counts.failures == 1
    assert running.worker.failure is None


def test_closing_cancels_open_questions() -> None:
    navigator = Recording()
    navigator.gate.clear()
    running = Running(lambda: navigator)
    running.worker.offer(BarometerSample(0, 1.0))
    assert navigator.entered.wait(PATIENCE_S)
    open_question = running.worker.state_at(1)
    running.worker.close(timeout_s=0.0)
    navigator.gate.set()
    late_question = running.worker.state_at(2)

    for question in (open_question, late_question):
        with pytest.raises(CancelledError):
            question.result(PATIENCE_S)


def test_the_horizon_follows_pictures_that_take_longer() -> None:
    """
    Fault: the video takes 700 ms from exposure to here.
    Expected: the estimator waits for it instead of passing every picture's time before it comes.
    """
    worker = NavigationWorker(
        "idle", Recording, delay_us=250_000, on_state=lambda _: None, on_reports=lambda _: None,
        now_us=lambda: 10_000_000,
    )  # fmt: skip
    image = np.zeros((2, 2), np.uint8)
    assert worker.delay_us == 250_000
    for n in range(50):
        worker.offer(FrameSample(10_000_000 - 80_000, n, image))
    assert worker.delay_us == 250_000
    for n in range(50):
        worker.offer(FrameSample(10_000_000 - 700_000, n, image))
    assert worker.delay_us == 760_000
    for n in range(50):
        worker.offer(FrameSample(0, n, image))
    assert worker.delay_us == 2_000_000


def test_the_offset_of_the_videos_clock_is_known_to_who_asks_for_an_exposure() -> None:
    navigator = Recording()
    running = Running(lambda: navigator)
    running.worker.offer(BarometerSample(1, 0.0))
    running.wait_for(lambda: bool(navigator.offered) and bool(running.states))
    running.worker.close()

    assert running.worker.exposure_us(1_000_000) == 880_000


def test_what_gps_said_while_it_was_denied_is_not_used_when_it_is_given_back() -> None:
    navigator = Recording()
    navigator.gate.clear()  # the estimator is busy from before the denial until after it
    running = Running(lambda: navigator)
    running.worker.offer(BarometerSample(0, 1.0))
    assert navigator.entered.wait(PATIENCE_S)
    running.worker.deny_gps(True)
    running.worker.offer(GnssSample(1, 0.8, 0.1, 500.0, np.zeros(3), 2.0, 3.0, 9))
    running.worker.deny_gps(False)
    running.worker.offer(GnssSample(2, 0.8, 0.1, 500.0, np.zeros(3), 2.0, 3.0, 9))
    navigator.gate.set()
    running.wait_for(lambda: len(navigator.offered) == 2)
    running.worker.close()

    assert [sample.t_us for sample in navigator.offered] == [0, 2]


def test_questions_are_answered_while_a_picture_is_worked_on() -> None:
    """One waits when the work begins, one comes in the middle of it, with a sample that came after the work began."""
    navigator, seen = Recording(), []

    def outlook(t_us: int, newer: Sequence[Sample]) -> NavigationState | None:
        seen.append([sample.t_us for sample in newer])
        return state(t_us)

    early: list[Future[NavigationState | None]] = []
    plain_step = navigator.advance

    def advance(t_us: int) -> list[FixReport]:
        if not early:
            early.append(running.worker.state_at(700))
            assert not early[0].done()
            with navigator.while_busy(outlook):
                return plain_step(t_us)
        return plain_step(t_us)

    navigator.advance = advance  # type: ignore[method-assign]
    navigator.gate.clear()
    running = Running(lambda: navigator)
    running.worker.offer(BarometerSample(1, 0.0))
    assert navigator.entered.wait(PATIENCE_S)
    running.worker.offer(InertialSample(800, np.zeros(3), np.zeros(3)))
    running.worker.offer(BarometerSample(801, 0.0))
    late = running.worker.state_at(850)
    # nobody has opened the gate: the step is still going on
    first, second = early[0].result(PATIENCE_S), late.result(PATIENCE_S)
    navigator.gate.set()
    running.wait_for(lambda: len(navigator.offered) == 3)
    after = running.worker.state_at(900).result(PATIENCE_S)
    running.worker.close()

    assert first is not None
    assert second is not None
    assert after is not None
    assert (first.t_us, second.t_us, after.t_us) == (700, 850, 900)
    # what had not come yet, and what is no inertial reading, is not there; afterwards the navigator answers itself
    assert seen == [[], [800]]


def test_an_outlook_that_fails_is_the_askers_trouble() -> None:
    navigator = Recording()

    def broken(t_us: int, newer: Sequence[Sample]) -> NavigationState | None:
        raise FloatingPointError("covariance is not positive")

    plain_step = navigator.advance

    def advance(t_us: int) -> list[FixReport]:
        with navigator.while_busy(broken):
            return plain_step(t_us)

    navigator.advance = advance  # type: ignore[method-assign]
    navigator.gate.clear()
    running = Running(lambda: navigator)
    running.worker.offer(BarometerSample(1, 0.0))
    assert navigator.entered.wait(PATIENCE_S)
    with pytest.raises(FloatingPointError):
        running.worker.state_at(1).result(PATIENCE_S)
    navigator.gate.set()
    running.wait_for(lambda: bool(running.states))
    running.worker.close()

    assert running.worker.counts.failures == 0
