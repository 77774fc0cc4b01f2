"""The window's verdicts against NumPy's, and a correction in parts against the same at once."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.kalman import correct
from estimator.measurements.sliding_window import SlidingWindow, SlidingWindowConfig


def test_stable_differences_become_a_fix_of_their_mean() -> None:
    rng = np.random.default_rng(2)
    differences = np.array([3.0, -7.0]) + rng.normal(0.0, 0.8, size=(30, 2))
    window = SlidingWindow(SlidingWindowConfig())

    parts = [window.offer(difference) for difference in differences]

    assert parts[:-1] == [None] * 29
    part = parts[-1]
    assert part is not None
    assert_allclose(part.move_ne_m, differences.mean(axis=0) / 10.0)
    assert part.variance_m2 == pytest.approx(10.0 * differences.std(axis=0, ddof=1).max() ** 2)


def test_scattered_differences_are_no_fix_until_the_window_has_passed_them() -> None:
    """Fault: forty jumping matches, then matches that stay. Expected: a fix as soon as few of the forty are left."""
    rng = np.random.default_rng(3)
    window = SlidingWindow(SlidingWindowConfig(size=10))

    assert all(window.offer(rng.normal(0.0, 9.0, size=2)) is None for _ in range(40))
    waited = next(n for n in range(1, 30) if window.offer(np.array([1.0, 1.0])) is not None)

    assert 8 <= waited <= 10


def test_one_scattered_axis_is_enough_to_refuse() -> None:
    """Along a road the match slides, across it stays."""
    window = SlidingWindow(SlidingWindowConfig(size=10))

    assert all(window.offer(np.array([0.0, 4.0 * (-1) ** k])) is None for k in range(30))
    assert window.std_m == pytest.approx(4.0 * np.sqrt(10 / 9))


def test_equal_parts_reach_the_mean_and_leave_the_filter_as_sure_as_the_fix_at_once() -> None:
    """Outside truth: the covariance of one Kalman update with the window's variance."""
    config = SlidingWindowConfig(size=5, parts=4)
    window, target = SlidingWindow(config), np.array([6.0, -2.0])
    scatter = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5], [0.0, 0.0]])
    P, position = np.eye(2) * 9.0, np.zeros(2)
    variance = scatter.std(axis=0, ddof=1).max() ** 2
    at_once = correct(P, target, np.eye(2), np.eye(2) * variance)
    assert at_once is not None

    steps = []
    for k in range(8):
        seen = target - position + (scatter[k] if k < 5 else 0.0)
        part = window.offer(seen)
        if part is None:
            continue
        step = correct(P, part.innovation(P), np.eye(2), np.eye(2) * part.variance_m2)
        assert step is not None
        position, P = position + step.dx, step.P
        window.moved(step.dx)
        steps.append(np.hypot(*step.dx))

    assert_allclose(steps, np.full(4, np.hypot(*target) / 4.0))
    assert_allclose(position, target, atol=1e-9)
    assert_allclose(P, at_once.P, atol=1e-9)


def test_a_match_counts_once() -> None:
    """After a fix the window fills anew: the next is a whole window away."""
    window = SlidingWindow(SlidingWindowConfig(size=6, parts=1))

    found = [k for k in range(24) if window.offer(np.zeros(2)) is not None]

    assert found == [5, 11, 17, 23]


@pytest.mark.parametrize("changes", [{"size": 1}, {"parts": 0}, {"max_std_m": 0.0}, {"max_std_m": float("nan")}])
def test_windows_that_are_none_are_refused(changes: dict) -> None:
    with pytest.raises(ValueError, match="window"):
        SlidingWindowConfig(**changes)
