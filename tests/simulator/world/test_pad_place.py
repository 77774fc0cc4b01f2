"""A pad lies flat on open ground."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from estimator.landing.pad import circle_pad
from simulator.world.pad_place import place_pad
from simulator.world.world import RAISED_UNIT_M, World

PAD = circle_pad("pad", 1.5, 0.3)


def test_it_lies_on_the_ground_with_nothing_about(world: World) -> None:
    place = place_pad(world, PAD, 3)

    # Points of the sheet are on the ground: within what a metre of rolling ground bends.
    for x, y in ((0.0, 0.0), (0.9, 0.0), (0.0, 0.9), (-0.9, -0.9)):
        north, east, down = place.pos_ned_m + place.ned_from_pad @ np.array([x, y, 0.0])
        assert abs(down + float(world.terrain.at(north, east))) < 0.02
    assert_allclose(place.ned_from_pad.T @ place.ned_from_pad, np.eye(3), atol=1e-12)
    assert np.linalg.det(place.ned_from_pad) > 0.99
    assert place.ned_from_pad[2, 2] > np.cos(np.radians(3.5))
    row, col = np.round(world.raised_patch.row_col(place.pos_ned_m[:2])).astype(int)
    reach = int(5.0 / world.raised_patch.gsd_m)
    around = world.raised[row - reach : row + reach + 1, col - reach : col + reach + 1]
    assert around.max() * RAISED_UNIT_M == 0.0


def test_same_seed_same_place(world: World) -> None:
    one, other, third = (place_pad(world, PAD, seed) for seed in (3, 3, 4))
    assert_allclose(one.pos_ned_m, other.pos_ned_m)
    assert not np.allclose(one.ned_from_pad, third.ned_from_pad)
