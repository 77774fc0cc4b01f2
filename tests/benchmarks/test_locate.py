"""The bookkeeping of the benchmark: what it counts as right, wrong and refused, and what it tells of the truth."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from backend.photos.hints import Hints
from backend.photos.session import PhotoAnswer
from benchmarks.locate import Half, Outcome, Shot, Trialset, hints_for, offset_ne_m, seneca, summary
from estimator.geometry.local import LocalFrame
from tests.shared_data import shared_data


def _outcome(error_m: float, accepted: bool) -> Outcome:
    return Outcome(PhotoAnswer("a.jpg", accepted, "", 2000.0), error_m, 1.0)


def test_refused_answers_are_neither_right_nor_wrong() -> None:
    trials = Trialset("x", Path(), None, None, (), 100.0, 10.0)
    outcomes = [_outcome(3.0, True), _outcome(40.0, True), _outcome(2.0, False), _outcome(math.inf, False)]

    found = summary(trials, outcomes)

    assert (found["accepted_within"], found["accepted_wrong"], found["best_guess_within"]) == (0.25, 0.25, 0.5)


def test_the_prior_is_the_truth_plus_the_offset_and_nothing_else() -> None:
    shot = Shot(Path("a.jpg"), 41.0, -83.0, Hints(agl_m=63.0))

    hints = hints_for(shot, np.array([120.0, -50.0]), 100.0, disc=False)

    frame = LocalFrame(math.radians(41.0), math.radians(-83.0), 0.0)
    away = frame.ne_from_geodetic(math.radians(hints.lat_deg or 0.0), math.radians(hints.lon_deg or 0.0))
    assert away == pytest.approx([120.0, -50.0], abs=1e-3)
    assert (hints.sigma_m, hints.radius_m, hints.agl_m, hints.heading_deg) == (100.0, None, 63.0, None)


def test_offsets_have_the_stated_size_and_repeat_with_the_seed() -> None:
    normal = np.array([offset_ne_m(rng, 60.0, False) for rng in [np.random.default_rng(1)] for _ in range(4000)])
    disc = np.array([offset_ne_m(rng, 60.0, True) for rng in [np.random.default_rng(1)] for _ in range(4000)])

    # three standard errors of a deviation from 4000 draws
    assert normal.std(axis=0) == pytest.approx([60.0, 60.0], rel=0.035)
    radii = np.linalg.norm(disc, axis=1)
    assert radii.max() <= 60.0
    # half of a disc's area lies within 0.707 of its radius
    assert np.median(radii) == pytest.approx(60.0 * math.sqrt(0.5), rel=0.03)
    again = offset_ne_m(np.random.default_rng(1), 60.0, False)
    assert again == pytest.approx(normal[0])


def test_the_halves_share_no_picture() -> None:
    data = shared_data("photos").parent
    tune, test = (seneca(data, half).shots for half in (Half.TUNE, Half.TEST))

    assert len(tune) + len(test) == len(seneca(data, Half.ALL).shots) == 24
    assert not {s.path for s in tune} & {s.path for s in test}
