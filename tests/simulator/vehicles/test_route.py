"""The loop that is flown."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.errors import SimulatorError
from simulator.vehicles.route import make_route, widened
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


@pytest.mark.parametrize("seed", range(3))
def test_a_route_is_widened_for_what_cannot_turn_as_sharply(seed: int) -> None:
    """Bends of 114 m at least, still closed, inside and with its stops; one that is wide enough stays as it is."""
    route = make_route(seed, TERRAIN, 600.0, 11, (100.0, 128.0), 3)
    assert route.curvature_per_m.max() > 1.0 / 114.0
    wider = widened(route, 114.0)
    assert wider.curvature_per_m.max() <= 1.0 / 114.0
    points = wider.pos_ned_m
    assert np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).max() < 2.6
    assert np.abs(points[:, :2]).max() <= np.abs(route.pos_ned_m[:, :2]).max()
    assert len(set(wider.hover_at)) == 3
    assert max(wider.hover_at) < len(points)
    assert widened(wider, 114.0) is wider


def test_a_route_too_short_for_its_bends_is_refused() -> None:
    route = make_route(1, TERRAIN, 180.0, 6, (70.0, 80.0), 0)
    with pytest.raises(SimulatorError, match="no route in this world has bends of 300 m"):
        widened(route, 300.0)
