"""Things that stand on the ground."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.random_streams import rng_for
from simulator.world.layout import Building, BuildingKind, Trees
from simulator.world.patch import Patch
from simulator.world.raised import CAR_HEIGHT_M, Car, Crowns, raise_buildings, raise_cars

PATCH = Patch(20.0, -20.0, 161, 161, 0.25)


def canvas() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((161, 161), np.float32), np.zeros((161, 161, 3), np.float32)


def test_gable_roof_has_its_ridge_along_the_length() -> None:
    house = Building(np.array([2.0, 3.0]), 12.0, 8.0, np.radians(90), 3.0, 6.0, BuildingKind.HOUSE, 0)
    height, colour = canvas()
    raise_buildings((house,), PATCH, height, colour, 1.0)
    row, col = PATCH.row_col(np.array([2.0, 3.0])).astype(int)
    assert height[row, col] == pytest.approx(6.0)
    # Half way down the slope, 2 m north of the ridge; the length runs east.
    assert height[row - 8, col - 12] == pytest.approx(4.5, abs=0.15)
    assert height[row - 20, col] == 0.0
    assert (height > 0).sum() * 0.25**2 == pytest.approx(96.0, rel=0.1)
    assert np.all(colour[height == 0] == 0)


def test_car_covers_its_size() -> None:
    height, colour = canvas()
    raise_cars((Car(np.array([-5.0, 4.0]), 0.6, (200, 40, 40)),), PATCH, height, colour)
    assert (height > 0).sum() * 0.25**2 == pytest.approx(4.5 * 1.8, rel=0.15)
    assert height.max() == pytest.approx(CAR_HEIGHT_M)


def test_crowns_have_their_radius_height_and_owner() -> None:
    trees = Trees(
        np.array([[0.0, 0.0], [10.0, -12.0], [500.0, 0.0]]),
        np.array([4.0, 3.0, 3.0]),
        np.array([10.0, 12.0, 9.0]),
        np.array([False, True, False]),
    )
    height, _ = canvas()
    owner = np.zeros(height.shape, np.uint16)
    Crowns(rng_for(1, "crowns")).raise_trees(trees, PATCH, height, owner)
    assert set(np.unique(owner)) == {0, 1, 2}
    for index, radius_m in ((1, 4.0), (2, 3.0)):
        area_m2 = (owner == index).sum() * 0.25**2
        assert 0.35 * np.pi * radius_m**2 < area_m2 <= 1.05 * np.pi * radius_m**2
    assert height[owner == 1].max() == pytest.approx(10.0, rel=0.25)
    assert height[owner == 2].max() == pytest.approx(12.0, rel=0.25)
    assert np.all((height > 0) == (owner > 0))
