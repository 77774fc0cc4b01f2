"""What the ground is made of."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.world.epoch import CURRENT, REFERENCE
from simulator.world.layout import Layout, Use, WayKind
from simulator.world.patch import Patch
from simulator.world.regions import FIRST_PARCEL, Material, label_ground, look_of, pitch_lines_ne_m
from simulator.world.settle import base_layout

PATCH = Patch(399.5, -399.5, 800, 800, 1.0)


@pytest.fixture(scope="module")
def layout() -> Layout:
    return base_layout(3, 400.0)


def test_roads_and_water_are_where_the_layout_has_them(layout: Layout) -> None:
    labels = label_ground(layout, PATCH)
    inside = np.abs(layout.lake_ne_m).max() < 390
    assert inside
    centre = layout.lake_ne_m.mean(axis=0)
    row, col = PATCH.row_col(centre).round().astype(int)
    assert labels[row, col] == Material.WATER
    for way in layout.ways:
        if way.kind is WayKind.MAIN:
            nodes = way.line_ne_m[np.abs(way.line_ne_m).max(axis=1) < 395]
            at = PATCH.row_col(nodes).round().astype(int)
            here = labels[at[:, 0], at[:, 1]]
            assert np.isin(here, [Material.ASPHALT, Material.PAINT, Material.KERB]).all()


def test_every_parcel_is_drawn(layout: Layout) -> None:
    labels = set(np.unique(label_ground(layout, PATCH)).tolist())
    inner = [
        index
        for index, parcel in enumerate(layout.parcels)
        if np.abs(parcel.outline_ne_m).max() < 390 and parcel.use is Use.FIELD
    ]
    assert inner
    missing = [index for index in inner if FIRST_PARCEL + index not in labels]
    # Some lie under the lake.
    assert len(missing) <= 2


def test_crops_rotate_between_epochs(layout: Layout) -> None:
    older, now = look_of(layout, REFERENCE, 3), look_of(layout, CURRENT, 3)
    fields = [FIRST_PARCEL + i for i, parcel in enumerate(layout.parcels) if parcel.use is Use.FIELD]
    change = np.linalg.norm(older.colour_bgr[fields] - now.colour_bgr[fields], axis=1)
    assert np.median(change) > 25.0
    again = look_of(layout, CURRENT, 3)
    np.testing.assert_array_equal(now.colour_bgr, again.colour_bgr)


def test_sports_ground_has_its_measures() -> None:
    layout = base_layout(1, 600.0)
    assert layout.pitches
    outer = pitch_lines_ne_m(layout.pitches[0])[0]
    sides = np.linalg.norm(np.diff(outer, axis=0), axis=1)
    np.testing.assert_allclose(sorted(sides), [58.0, 58.0, 92.0, 92.0])
