"""Innovations that keep to one side, and white ones that do not."""

import numpy as np

from estimator.integrity.steady import SteadyConfig, SteadyInnovations

CONFIG = SteadyConfig()
EVERY_US = 180_000


def _run(innovations: np.ndarray) -> np.ndarray:
    watch = SteadyInnovations(CONFIG)
    return np.array([watch.note(k * EVERY_US, float(z), 0.5) for k, z in enumerate(innovations)])


def test_white_innovations_pass() -> None:
    """Ten minutes of innovations half as large as stated, as a barometer's are: never beyond the limit."""
    assert not _run(np.random.default_rng(1).normal(0.0, 0.25, 3333)).any()


def test_a_drift_is_seen_with_its_sign_and_ends_after_it() -> None:
    rng = np.random.default_rng(2)
    drifting, well = rng.normal(-0.3, 0.25, 200), rng.normal(0.0, 0.25, 200)
    means = _run(np.concatenate((drifting, well)))
    assert (means[80:200] < -0.3 * 0.5).mean() > 0.9
    assert not means[260:].any()


def test_one_reading_far_off_is_no_drift() -> None:
    assert not _run(np.array([0.0, 0.0, 3.0, 0.0, 0.0])).any()


def test_what_does_not_persist_is_not_told() -> None:
    """Beyond the limit for two seconds at the most, then a restart, again and again."""
    watch = SteadyInnovations(CONFIG)
    told = []
    for k in range(400):
        if k % 14 == 0:
            watch.restart()
        told.append(watch.note(k * EVERY_US, 1.0, 0.5))
    assert not any(told)
