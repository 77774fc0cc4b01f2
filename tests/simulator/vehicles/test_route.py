"""The loop that is flown."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.vehicles.route import make_route
from simulator.world.patch import Patch
from simulator.world.terrain import Terrain

RNG = np.random.default_rng(5)
TERRAIN = Terrain(Patch(800.0, -800.0, 41, 41, 40.0), RNG.normal(0, 6, (41, 41)).astype(np.float32))


@pytest.mark.parametrize("seed", range(6))
def test_route_is_closed_smooth_and_inside(seed: int) -> None:
    route = make_route(seed, TERRAIN, 600.0, 11, (100.0, 128.0), 3)
    points = route.pos_ned_m
    step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    assert step.max() < 2.6
    assert len(points) * 2.0 > 1500.0
    assert np.abs(points[:, :2]).max() < 600.0 - 0.95 * 128.0
    turn = np.sum(route.tangent_ne * np.roll(route.tangent_ne, 1, axis=0), axis=1)
    assert turn.min() > np.cos(np.radians(20))
    assert len(set(route.hover_at)) == 3


def test_route_without_stops() -> None:
    assert make_route(1, TERRAIN, 600.0, 8, (100.0, 110.0), 0).hover_at == ()
