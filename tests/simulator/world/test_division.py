"""Cutting the land."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.random_streams import rng_for
from simulator.world.division import divide
from simulator.world.layout import WayKind, polygon_area_m2


def test_pieces_fill_the_land_without_overlap() -> None:
    division = divide(rng_for(4, "division"), 400.0, np.zeros(2), 120.0)
    total = sum(polygon_area_m2(leaf.outline_ne_m) for leaf in division.leaves)
    # The bend displaces the outer edge by some metres, inner edges not relative to each other.
    assert total == pytest.approx((2 * 460.0) ** 2, rel=0.03)


def test_main_roads_cross_in_the_village() -> None:
    village = np.array([50.0, -30.0])
    division = divide(rng_for(5, "division"), 400.0, village, 120.0)
    main = [way for way in division.ways if way.kind is WayKind.MAIN]
    assert len(main) == 3
    for way in main:
        assert np.linalg.norm(way.line_ne_m - village, axis=1).min() < 120.0
    assert any(leaf.in_village for leaf in division.leaves)
