"""Cars of an epoch."""

from __future__ import annotations

import numpy as np

from simulator.world.cars import place_cars
from simulator.world.layout import WayKind, distance_to_line_m
from simulator.world.settle import base_layout

LAYOUT = base_layout(1, 600.0)


def test_other_epoch_other_cars() -> None:
    spring, autumn = place_cars(LAYOUT, 1, "spring"), place_cars(LAYOUT, 1, "autumn")
    assert min(len(spring), len(autumn)) > 40
    again = place_cars(LAYOUT, 1, "spring")
    np.testing.assert_array_equal([c.centre_ne_m for c in spring], [c.centre_ne_m for c in again])
    places = {tuple(np.round(car.centre_ne_m)) for car in spring}
    shared = sum(tuple(np.round(car.centre_ne_m)) in places for car in autumn)
    # Stalls are fixed, so some places are taken in both.
    assert shared < 0.5 * len(autumn)


def test_traffic_keeps_to_its_lane() -> None:
    main = [way for way in LAYOUT.ways if way.kind is WayKind.MAIN]
    for car in place_cars(LAYOUT, 1, "spring"):
        distance = min(float(distance_to_line_m(car.centre_ne_m[None], way.line_ne_m)[0]) for way in main)
        if distance < 3.0:
            assert 1.0 < distance < 2.5
