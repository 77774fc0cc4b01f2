"""Noise that belongs to the place, not to the patch."""

from __future__ import annotations

import numpy as np

from simulator.random_streams import rng_for
from simulator.world.noise import FractalNoise
from simulator.world.patch import Patch


def test_neighbouring_patches_fit_together() -> None:
    """A patch painted alone equals the same ground cut from a larger one."""
    noise = FractalNoise(rng_for(1, "noise"))
    large = Patch(100.0, -60.0, 400, 480, 0.25)
    whole = noise.sample(large, 30.0, 6)
    part = noise.sample(large.cut(slice(120, 320), slice(100, 300)), 30.0, 6)
    # Interpolation through a thinned grid may differ a little where the grids are offset.
    assert np.abs(whole[120:320, 100:300] - part).max() < 0.08


def test_variance_is_about_one() -> None:
    sample = FractalNoise(rng_for(2, "noise")).sample(Patch(0.0, 0.0, 800, 800, 0.5), 20.0, 5)
    assert 0.6 < sample.std() < 1.5
    assert abs(sample.mean()) < 0.2


def test_streams_are_independent() -> None:
    patch = Patch(0.0, 0.0, 600, 600, 0.25)
    first = FractalNoise(rng_for(3, "spring")).sample(patch, 10.0, 5)
    second = FractalNoise(rng_for(3, "autumn")).sample(patch, 10.0, 5)
    # 225 independent coarse cells: the correlation of unrelated noise stays below 4 sigma.
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 4 / 15
