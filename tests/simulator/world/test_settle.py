"""What is built and planted where, and what changes over the years."""

from __future__ import annotations

from itertools import combinations

import cv2
import numpy as np
import pytest

from simulator.world.layout import Layout, Use, WayKind, distance_to_line_m
from simulator.world.settle import base_layout, later_layout


@pytest.fixture(scope="module")
def layout() -> Layout:
    return base_layout(3, 400.0)


def test_same_seed_gives_the_same_land(layout: Layout) -> None:
    again = base_layout(3, 400.0)
    np.testing.assert_array_equal(layout.trees.position_ne_m, again.trees.position_ne_m)
    assert [b.length_m for b in layout.buildings] == [b.length_m for b in again.buildings]


def test_land_is_varied(layout: Layout) -> None:
    assert {Use.FIELD, Use.MEADOW, Use.WOOD, Use.LOT} <= {parcel.use for parcel in layout.parcels}
    assert len(layout.buildings) > 30
    assert len(layout.trees.radius_m) > 1500


def test_no_building_stands_on_a_road_or_in_another(layout: Layout) -> None:
    for building in layout.buildings:
        for way in layout.ways:
            if way.kind in (WayKind.MAIN, WayKind.STREET):
                corners = np.vstack([building.outline_ne_m(), building.centre_ne_m])
                assert distance_to_line_m(corners, way.line_ne_m).min() > way.width_m / 2
    for first, second in combinations(layout.buildings, 2):
        if np.linalg.norm(first.centre_ne_m - second.centre_ne_m) < 60.0:
            outlines = (b.outline_ne_m().astype(np.float32) for b in (first, second))
            assert cv2.intersectConvexConvex(*outlines)[0] < 0.5


def test_no_tree_stands_on_tarmac_or_in_the_lake(layout: Layout) -> None:
    trees = layout.trees.position_ne_m
    for way in layout.ways:
        if way.kind is WayKind.MAIN:
            assert distance_to_line_m(trees, way.line_ne_m).min() > way.width_m / 2 - 0.8
    outline = layout.lake_ne_m.astype(np.float32)
    deep = [cv2.pointPolygonTest(outline, (float(n), float(e)), True) for n, e in trees]
    assert max(deep) < 1.5


def test_some_things_change_and_most_stay(layout: Layout) -> None:
    later = later_layout(layout, 3, 0.08)
    kept = {tuple(p) for p in later.trees.position_ne_m.tolist()}
    stay = np.mean([tuple(p) in kept for p in layout.trees.position_ne_m.tolist()])
    assert 0.6 < stay < 0.99
    assert 0 < len(later.parcels) - len(layout.parcels) < 0.2 * len(layout.parcels)
    assert len(later.buildings) < len(layout.buildings)
    assert later.ways == layout.ways
