"""Smoothing piece by piece while a run goes on, against smoothing all of it at the end."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.replay import hindsight
from backend.replay.hindsight import Hindsight
from estimator.filters.eskf import ProcessNoise
from estimator.history import MOST_CORRECTED_US, Corrected
from tests.backend.refining.test_refiner import SETUP, drifting


def kept(steps: int) -> list[Corrected]:
    """A fix each fifty of the states of a vehicle that drifts away to the north, ten a second."""
    found = []
    for n in range(steps):
        since = (n - 1) % 50 + 1 if n else 0  # steps since the last fix
        std_m, north_m = 0.5 + 0.05 * since, 0.04 * since
        before = drifting(n, std_m + 0.05, north_m)
        after = drifting(n, 0.5, 0.0) if since == 50 else drifting(n, std_m, north_m)
        found.append(Corrected(before, after))
    return found


def test_pieces_are_as_good_as_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hindsight, "EVERY_US", 30_000_000)
    monkeypatch.setattr(hindsight, "LAG_US", 15_000_000)
    every = kept(1_000)
    whole, pieces = Hindsight(SETUP, ProcessNoise()), Hindsight(SETUP, ProcessNoise())
    whole.finish(every)
    looked = []
    for n in range(1, len(every)):
        # the estimator keeps three quarters of a minute
        pieces.note(every[n].after.t_us, lambda n=n: looked.append(n) or every[max(n - 460, 0) : n])
    pieces.finish(every[-460:])

    assert len(looked) == 3
    assert [s.t_us for s in pieces.states] == [s.t_us for s in whole.states] == [e.after.t_us for e in every]
    assert_allclose([s.pos_ned_m for s in pieces.states], [s.pos_ned_m for s in whole.states], atol=1e-3)
    forward, smoothed = (
        np.array([s.pos_ned_m[0] for s in states]) for states in ([e.after for e in every], whole.states)
    )
    assert np.abs(smoothed[:-50]).max() < 0.8 * np.abs(forward[:-50]).max()


def test_the_estimator_keeps_as_long_as_the_pieces_need() -> None:
    assert hindsight.EVERY_US + hindsight.LAG_US < MOST_CORRECTED_US


def test_a_run_without_fixes_has_none() -> None:
    nothing = Hindsight(SETUP, ProcessNoise())
    nothing.finish([])

    assert nothing.states == []
