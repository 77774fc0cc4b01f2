"""Where cars stand at one time; another epoch has other cars."""

from __future__ import annotations

import numpy as np

from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.world.epoch import Colour
from simulator.world.layout import BuildingKind, Layout, WayKind, densified
from simulator.world.raised import Car
from simulator.world.regions import parking_stalls_ne_m

_COLOURS: tuple[Colour, ...] = (
    (222, 222, 220),
    (232, 230, 226),
    (60, 60, 64),
    (38, 38, 42),
    (128, 130, 134),
    (170, 172, 176),
    (150, 38, 36),
    (44, 66, 116),
    (70, 92, 76),
)


def place_cars(layout: Layout, seed: int, epoch: str) -> tuple[Car, ...]:
    """Cars in stalls, along roads and beside houses."""
    rng = rng_for(seed, "world", epoch, "cars")
    cars: list[Car] = []
    for lot in layout.parking:
        filled = rng.uniform(0.3, 0.8)
        for stall in parking_stalls_ne_m(lot):
            if rng.random() < filled:
                turned = lot.azimuth_rad + (np.pi if rng.random() < 0.5 else 0.0) + rng.normal(0, 0.02)
                cars.append(_car(rng, stall + rng.normal(0, 0.12, 2), turned))
    for way in layout.ways:
        if way.kind in (WayKind.MAIN, WayKind.STREET):
            spacing = 85.0 if way.kind is WayKind.MAIN else 55.0
            cars.extend(_along(rng, way.line_ne_m, spacing, way.width_m / 4))
    for building in layout.buildings:
        if building.kind is BuildingKind.HOUSE and rng.random() < 0.5:
            azimuth = building.azimuth_rad + (np.pi / 2 if rng.random() < 0.5 else 0.0)
            side = 1.0 if rng.random() < 0.5 else -1.0
            across = np.array([-np.sin(building.azimuth_rad), np.cos(building.azimuth_rad)])
            cars.append(_car(rng, building.centre_ne_m + side * (building.width_m / 2 + 3.0) * across, azimuth))
    return tuple(cars)


def _along(rng: np.random.Generator, line_ne_m: Float, spacing_m: float, offset_m: float) -> list[Car]:
    dense = densified(line_ne_m, 5.0)
    cars = []
    for index in np.flatnonzero(rng.random(len(dense) - 1) < 5.0 / spacing_m):
        along = dense[index + 1] - dense[index]
        azimuth = float(np.arctan2(along[1], along[0]))
        # Traffic keeps to the right.
        side = 1.0 if rng.random() < 0.5 else -1.0
        right = side * offset_m * np.array([-np.sin(azimuth), np.cos(azimuth)])
        cars.append(_car(rng, dense[index] + right, azimuth + (0.0 if side > 0 else np.pi)))
    return cars


def _car(rng: np.random.Generator, centre_ne_m: Float, azimuth_rad: float) -> Car:
    return Car(centre_ne_m, float(azimuth_rad), _COLOURS[rng.integers(len(_COLOURS))])
