"""Correlated noise."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.random_streams import rng_for
from simulator.vehicles.gauss_markov import GaussMarkov


def test_keeps_its_variance_and_correlation() -> None:
    noise = GaussMarkov(rng_for(1, "walk"), 2.0, 5.0, 4000)
    before = noise.value
    for _ in range(10):
        noise.step(0.5)
    # 4000 samples: the standard deviation is known to 1.1 %, the correlation to 0.016.
    assert noise.value.std() == pytest.approx(2.0, rel=0.05)
    assert np.corrcoef(before, noise.value)[0, 1] == pytest.approx(np.exp(-1.0), abs=0.06)
