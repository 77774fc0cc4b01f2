"""The loop through the attitude: as unstable with height as published, and cured by its place in the Jacobian."""

from __future__ import annotations

import numpy as np

from benchmarks.studies.altitude import hover

SEEDS = range(6)


def test_low_down_the_loop_does_no_harm() -> None:
    for coupled in (False, True):
        found = [hover(seed, 60.0, coupled, 60.0) for seed in SEEDS]

        assert all(figures["diverged"] == 0.0 for figures in found)
        assert np.mean([figures["rms_m"] for figures in found]) < 2.5


def test_high_up_it_diverges_unless_the_attitude_is_in_the_jacobian() -> None:
    """The thesis sees it from 700 m on (section 5.8.5), with a filter that is surer of its gyroscopes."""
    alone = [hover(seed, 700.0, False, 90.0)["diverged"] for seed in SEEDS]
    coupled = [hover(seed, 700.0, True, 90.0) for seed in SEEDS]

    assert np.mean(alone) > 0.8
    assert all(figures["diverged"] == 0.0 for figures in coupled)
    # the aim of a hundredth of the height is for the mean
    assert np.mean([figures["share"] for figures in coupled]) < 0.015
    # six means of a consistent filter's normalised square
    assert 0.3 < np.mean([figures["nees_per_dof"] for figures in coupled]) < 2.5


def test_the_same_seed_flies_the_same() -> None:
    assert hover(3, 100.0, True, 10.0) == hover(3, 100.0, True, 10.0)
    assert hover(3, 100.0, True, 10.0) != hover(4, 100.0, True, 10.0)
