"""Relief."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import RegularGridInterpolator

from simulator.world.patch import Patch
from simulator.world.settle import base_layout
from simulator.world.terrain import Terrain, make_terrain


def test_heights_agree_with_scipy() -> None:
    rng = np.random.default_rng(0)
    patch = Patch(40.0, -40.0, 21, 21, 4.0)
    heights = rng.normal(0, 5, (21, 21)).astype(np.float32)
    norths = 40.0 - 4.0 * np.arange(21)
    expected = RegularGridInterpolator((norths[::-1], -40.0 + 4.0 * np.arange(21)), heights[::-1])
    points = rng.uniform(-39, 39, (50, 2))
    terrain = Terrain(patch, heights)
    assert_allclose(terrain.at(points[:, 0], points[:, 1]), expected(points), atol=1e-5)


def test_fine_patch_agrees_with_points() -> None:
    rng = np.random.default_rng(1)
    terrain = Terrain(Patch(40.0, -40.0, 21, 21, 4.0), rng.normal(0, 5, (21, 21)).astype(np.float32))
    fine = Patch(11.3, -9.7, 30, 40, 0.5)
    heights = terrain.at(fine.norths_m(), fine.easts_m())
    # OpenCV interpolates with weights in steps of 1/32 of a post's distance.
    assert_allclose(terrain.on(fine), heights, atol=0.6)


def test_relief_is_as_asked_and_the_lake_is_level() -> None:
    layout = base_layout(2, 400.0)
    terrain = make_terrain(2, layout, 26.0)
    inside = np.linspace(-380, 380, 90)
    heights = terrain.at(inside[:, None], inside[None, :])
    assert 10.0 < np.ptp(heights) < 45.0
    centre = layout.lake_ne_m.mean(axis=0)
    shore = centre + 0.8 * (layout.lake_ne_m - centre)
    assert np.ptp(terrain.at(shore[:, 0], shore[:, 1])) == pytest.approx(0.0, abs=0.01)
