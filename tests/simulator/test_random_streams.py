"""Named random streams."""

from __future__ import annotations

import numpy as np

from simulator.random_streams import rng_for


def test_same_name_same_stream() -> None:
    np.testing.assert_array_equal(rng_for(1, "imu").random(5), rng_for(1, "imu").random(5))


def test_names_and_seeds_are_kept_apart() -> None:
    draws = {
        float(rng_for(*key).random())  # type: ignore[arg-type]
        for key in [(1, "imu"), (2, "imu"), (1, "camera"), (1, "im", "u"), (1, "imu", "x"), (11, "mu")]
    }
    assert len(draws) == 6
