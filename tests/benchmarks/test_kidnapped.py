"""What counts as found and as a false lock, and what a trial is told."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.kidnapped import Trial, _turned
from estimator.types import AttitudeSample, BarometerSample, HomeSample, Sample

FOUND = Trial(
    world=400, map=400, start_s=0.0, found_s=50.0, error_m=3.0, sigmas=0.5, later_m=1.0, heading_deg=0.2, cpu_share=0.2
)  # fmt: skip


@pytest.mark.parametrize(
    ("trial", "right", "false_lock"),
    [
        (FOUND, True, False),
        (replace(FOUND, error_m=400.0), False, True),
        (replace(FOUND, map=399), False, True),
        (replace(FOUND, found_s=None, error_m=None), False, False),
    ],
)
def test_what_counts(trial: Trial, right: bool, false_lock: bool) -> None:
    assert (trial.right, trial.false_lock) == (right, false_lock)


def test_a_trial_is_told_no_place_and_no_heading() -> None:
    level = np.array([1.0, 0.0, 0.0, 0.0])
    samples: list[Sample] = [
        BarometerSample(1, 100.0), HomeSample(5, 0.8, 0.2, 100.0), AttitudeSample(6, level, np.zeros(3)),
    ]  # fmt: skip

    told = list(_turned(samples, math.pi / 2, first_us=5))

    assert len(told) == 1
    assert isinstance(told[0], AttitudeSample)
    np.testing.assert_allclose(told[0].q_ned_from_body, [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)], atol=1e-12)
