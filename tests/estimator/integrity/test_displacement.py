"""A displacement stands where most pictures of different ground agree on it, and only there."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.integrity.displacement import DisplacementConfig, DisplacementWatch, Standing

OFFSET = np.array([14.0, -9.0])


def watched(
    displacements: np.ndarray, step_m: float = 5.0, interval_s: float = 0.4, config: DisplacementConfig | None = None
) -> Standing | None:
    watch = DisplacementWatch(config)
    found = None
    for k, displacement in enumerate(displacements):
        found = watch.add(round(1e6 * interval_s * k), np.array([step_m * k, 0.0]), displacement)
    return found


def around(offset: np.ndarray, outliers: float, seed: int = 1, count: int = 40) -> np.ndarray:
    rng = np.random.default_rng(seed)
    found = offset + rng.normal(0.0, 0.7, (count, 2))
    wild = rng.random(count) < outliers
    found[wild] = rng.uniform(-40.0, 40.0, (int(wild.sum()), 2))
    return found


def test_a_shifted_map_is_found_to_less_than_a_metre_though_a_fifth_of_matches_are_wild() -> None:
    standing = watched(around(OFFSET, 0.2))

    assert standing is not None
    assert_allclose(standing.displacement_ne_m, OFFSET, atol=1.0)
    assert standing.size_m == pytest.approx(np.hypot(*OFFSET), abs=1.0)
    # both axes' scatter of 0.7 m, to what thirty draws tell
    assert standing.std_m == pytest.approx(1.0, abs=0.5)


def test_a_map_of_elsewhere_has_no_displacement() -> None:
    """Matches anywhere in the window, over seeds."""
    assert all(watched(around(OFFSET, 1.0, seed)) is None for seed in range(50))


def test_over_one_place_nothing_stands() -> None:
    assert watched(around(OFFSET, 0.0), step_m=0.5) is None


def test_old_matches_do_not_count() -> None:
    assert watched(around(OFFSET, 0.0), interval_s=2.0) is None


def test_refusals_without_a_match_are_left_out() -> None:
    found = around(OFFSET, 0.0)
    found[::2] = np.nan

    standing = watched(found, step_m=8.0)

    assert standing is not None
    assert_allclose(standing.displacement_ne_m, OFFSET, atol=1.0)


def test_it_begins_anew() -> None:
    watch = DisplacementWatch()
    for k, displacement in enumerate(around(OFFSET, 0.0)):
        watch.add(round(4e5 * k), np.array([5.0 * k, 0.0]), displacement)
    watch.forget()

    assert watch.add(round(4e5 * 41), np.array([205.0, 0.0]), OFFSET) is None
