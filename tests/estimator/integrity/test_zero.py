"""A zero that moves farther than instruments in order do, and those that only wander."""

import numpy as np

from estimator.integrity.zero import WanderingZero, ZeroConfig

CONFIG = ZeroConfig()
EVERY_US = 100_000


def _stands(zeros: np.ndarray, stds: np.ndarray | float = 0.5) -> tuple[WanderingZero, np.ndarray]:
    watch, told = WanderingZero(CONFIG), []
    for k, (zero, std) in enumerate(zip(zeros, np.broadcast_to(stds, zeros.shape), strict=True)):
        watch.note(k * EVERY_US, float(zero), float(std))
        told.append(watch.stands(k * EVERY_US))
    return watch, np.array(told)


def test_the_weather_is_no_drift() -> None:
    """An hour of Gauss-Markov wandering, 1.2 m over 400 s, with 0.3 m of noise on every estimate of it."""
    rng, zeros = np.random.default_rng(3), np.zeros(36000)
    keep = np.exp(-0.1 / 400.0)
    for k in range(1, len(zeros)):
        zeros[k] = keep * zeros[k - 1] + 1.2 * np.sqrt(1.0 - keep**2) * rng.normal()
    assert not _stands(zeros + 0.3 * rng.normal(size=len(zeros)))[1].any()


def test_a_drift_either_way_is_told_while_it_lasts() -> None:
    """A third of a metre a second for a minute, then steady: 3 m are reached after nine seconds."""
    for sign in (1.0, -1.0):
        zeros = sign * np.clip(np.arange(1500) * 0.1 - 30.0, 0.0, 60.0) / 3.0
        _, told = _stands(zeros)
        assert not told[:390].any()
        assert told[400:900].all()
        # the last fast look back reaches 20 s, and it stands 10 s more
        assert not told[1210:].any()


def test_a_zero_that_was_not_known_may_move() -> None:
    zeros, stds = np.linspace(0.0, 8.0, 300), np.full(300, 2.5)
    assert not _stands(zeros, stds)[1].any()
    stds[:50] = 0.5
    assert _stands(zeros, stds)[1].any()


def test_a_time_that_runs_backwards_begins_anew() -> None:
    watch, _ = _stands(np.zeros(100))
    watch.note(0, 9.0, 0.5)
    assert not watch.stands(0)
    watch.note(10**6, 13.0, 0.5)
    assert watch.stands(10**6)
