"""Turns divided land into a layout: uses, water, buildings, trees."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.world.division import Division, divide
from simulator.world.layout import (
    Building,
    BuildingKind,
    Layout,
    Parcel,
    ParkingLot,
    Trees,
    Use,
    Way,
    WayKind,
    distance_to_line_m,
    long_axis,
    polygon_area_m2,
    rectangle,
)
from simulator.world.patch import Patch
from simulator.world.planting import plant

_VILLAGE_RADIUS_M = 165.0


@dataclass(slots=True, eq=False)
class _Ground:
    """What is taken already, as a 1 m raster: roads, water and buildings."""

    patch: Patch
    taken: NDArray[np.uint8]

    def free(self, outline_ne_m: Float) -> bool:
        rows, cols = self.patch.box(outline_ne_m)
        if rows.stop - rows.start < 2 or cols.stop - cols.start < 2:
            return False
        probe = np.zeros((rows.stop - rows.start, cols.stop - cols.start), np.uint8)
        self.patch.cut(rows, cols).fill(probe, outline_ne_m, 1)
        return not bool((probe & self.taken[rows, cols]).any())

    def take(self, outline_ne_m: Float) -> None:
        self.patch.fill(self.taken, outline_ne_m, 1)


def base_layout(seed: int, half_size_m: float) -> Layout:
    """The land as it was when the reference imagery was taken."""
    rng = rng_for(seed, "world", "division")
    village = rng.uniform(-120.0, 120.0, 2)
    division = divide(rng, half_size_m, village, _VILLAGE_RADIUS_M)
    lake = _lake(rng_for(seed, "world", "lake"), division, half_size_m, village)
    stream = _stream(rng_for(seed, "world", "stream"), lake, half_size_m, village)
    size = int(2 * half_size_m) + 1
    ground = _Ground(Patch(half_size_m, -half_size_m, size, size, 1.0), np.zeros((size, size), np.uint8))
    for way in division.ways:
        ground.patch.stroke(ground.taken, way.line_ne_m, way.width_m + 5.0, 1)
    ground.patch.stroke(ground.taken, stream, 9.0, 1)
    ground.take(lake)
    parcels = _parcels(rng_for(seed, "world", "use"), division, lake)
    buildings, parking, pitches, parcels = _build(rng_for(seed, "world", "buildings"), parcels, ground)
    drives = _drives(buildings, division.ways)
    ways = (*division.ways, *drives)
    trees = plant(rng_for(seed, "world", "trees"), parcels, tuple(division.borders), ways, buildings, lake, stream)
    blocked = _blocked(ground, ways, buildings, (*parking, *pitches), lake, stream)
    row_col = np.clip(np.round(ground.patch.row_col(trees.position_ne_m)).astype(int), 0, size - 1)
    inside = np.abs(trees.position_ne_m).max(axis=1) < half_size_m + 5.0
    keep = (blocked[row_col[:, 0], row_col[:, 1]] == 0) & inside
    # the raster ends at the border, where a tree just beyond would be judged by the nearest pixel within
    beyond = np.flatnonzero(keep & (np.abs(trees.position_ne_m).max(axis=1) > half_size_m))
    for way in ways if beyond.size else ():
        keep[beyond] &= distance_to_line_m(trees.position_ne_m[beyond], way.line_ne_m) > (way.width_m + 2.4) / 2
    return Layout(
        half_size_m=half_size_m,
        parcels=parcels,
        ways=ways,
        borders=tuple(division.borders),
        buildings=buildings,
        parking=parking,
        pitches=pitches,
        trees=trees.kept(keep),
        lake_ne_m=lake,
        stream_ne_m=stream,
    )


def _blocked(
    ground: _Ground,
    ways: tuple[Way, ...],
    buildings: tuple[Building, ...],
    paved: tuple[ParkingLot, ...],
    lake: Float,
    stream: Float,
) -> NDArray[np.uint8]:
    blocked = np.zeros_like(ground.taken)
    for way in ways:
        ground.patch.stroke(blocked, way.line_ne_m, way.width_m + 2.4, 1)
    for building in buildings:
        ground.patch.fill(blocked, building.outline_ne_m(1.5), 1)
    for lot in paved:
        ground.patch.fill(blocked, rectangle(lot.centre_ne_m, lot.length_m, lot.width_m, lot.azimuth_rad), 1)
    ground.patch.stroke(blocked, stream, 3.0, 1)
    ground.patch.fill(blocked, lake, 1)
    return blocked


def _lake(rng: np.random.Generator, division: Division, half_size_m: float, village: Float) -> Float:
    """An outline (n, 2), placed where it is farthest from the main roads and still well inside."""
    candidates = rng.uniform(-0.55 * half_size_m, 0.55 * half_size_m, (60, 2))
    main = np.vstack([way.line_ne_m for way in division.ways if way.kind is WayKind.MAIN])
    clearance = np.linalg.norm(candidates[:, None] - main[None], axis=2).min(axis=1)
    clearance = np.where(np.linalg.norm(candidates - village, axis=1) > 290.0, clearance, 0.0)
    centre = candidates[np.argmax(clearance)]
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    radius = np.full_like(angle, min(72.0, 0.7 * clearance.max() + 12.0))
    for harmonic in (2, 3, 4, 5, 7, 9, 13):
        size = rng.normal(0, 14.0 / harmonic**1.1)
        radius += size * np.cos(harmonic * angle + rng.uniform(0, 2 * np.pi))
    outline: Float = centre + radius[:, None] * np.stack([np.cos(angle), 1.25 * np.sin(angle)], axis=1)
    return outline


def _stream(rng: np.random.Generator, lake: Float, half_size_m: float, village: Float) -> Float:
    """A meandering line (n, 2) from the lake to the edge, away from the village."""
    position = lake.mean(axis=0)
    away = position - village
    heading = float(np.arctan2(away[1], away[0])) + rng.normal(0, 0.2)
    bearing, points = heading, [position]
    while np.abs(position).max() < half_size_m + 30 and len(points) < 400:
        bearing += rng.normal(0, 0.22) - 0.10 * np.sin(bearing - heading)
        position = position + 6.0 * np.array([np.cos(bearing), np.sin(bearing)])
        points.append(position)
    return np.array(points)


def _parcels(rng: np.random.Generator, division: Division, lake: Float) -> tuple[Parcel, ...]:
    seeds = rng.uniform(-560, 560, (5, 2))
    parcels = []
    for key, leaf in enumerate(division.leaves):
        azimuth, _, across_m = long_axis(leaf.outline_ne_m)
        centre = leaf.outline_ne_m.mean(axis=0)
        near_wood = np.linalg.norm(seeds - centre, axis=1).min() < 95.0
        near_lake = np.linalg.norm(lake - centre, axis=1).min() < 60.0
        if leaf.in_village:
            use = Use.LOT
        elif near_wood or (across_m < 70 and rng.random() < 0.15):
            use = Use.WOOD
        elif rng.random() < (0.7 if near_lake else 0.2):
            use = Use.MEADOW
        else:
            use = Use.FIELD
        parcels.append(Parcel(key, leaf.outline_ne_m, use, azimuth))
    return tuple(parcels)


def _build(
    rng: np.random.Generator, parcels: tuple[Parcel, ...], ground: _Ground
) -> tuple[tuple[Building, ...], tuple[ParkingLot, ...], tuple[ParkingLot, ...], tuple[Parcel, ...]]:
    buildings: list[Building] = []
    parking: list[ParkingLot] = []
    pitches: list[ParkingLot] = []
    changed = list(parcels)
    _build_hall(rng, changed, ground, buildings, parking)
    _place_pitch(rng, changed, ground, pitches)
    farms = 0
    for index in rng.permutation(len(changed)):
        parcel = changed[index]
        if parcel.use is Use.LOT:
            _build_house(rng, parcel, ground, buildings)
        elif parcel.use in (Use.FIELD, Use.MEADOW) and farms < 5 and polygon_area_m2(parcel.outline_ne_m) < 12_000:
            farms += _build_farm(rng, parcel, ground, buildings)
    return tuple(buildings), tuple(parking), tuple(pitches), tuple(changed)


def _build_hall(
    rng: np.random.Generator,
    parcels: list[Parcel],
    ground: _Ground,
    buildings: list[Building],
    parking: list[ParkingLot],
) -> None:
    for index, parcel in enumerate(parcels):
        centre = parcel.outline_ne_m.mean(axis=0)
        _, along_m, across_m = long_axis(parcel.outline_ne_m)
        if parcel.use is not Use.FIELD or across_m < 85 or along_m > 260 or np.abs(centre).max() > 420:
            continue
        azimuth = parcel.row_azimuth_rad
        axis = np.array([np.cos(azimuth), np.sin(azimuth)])
        hall = Building(centre + 24 * axis, 58.0, 36.0, azimuth, 8.0, 8.3, BuildingKind.HALL, int(rng.integers(3)))
        lot = ParkingLot(centre - 34 * axis, 46.0, 48.0, azimuth)
        outline = rectangle(lot.centre_ne_m, lot.length_m, lot.width_m, azimuth)
        if ground.free(hall.outline_ne_m()) and ground.free(outline):
            ground.take(hall.outline_ne_m())
            ground.take(outline)
            buildings.append(hall)
            parking.append(lot)
            parcels[index] = replace(parcel, use=Use.YARD)
            return


def _place_pitch(rng: np.random.Generator, parcels: list[Parcel], ground: _Ground, pitches: list[ParkingLot]) -> None:
    for index in rng.permutation(len(parcels)):
        parcel = parcels[index]
        centre = parcel.outline_ne_m.mean(axis=0)
        if parcel.use not in (Use.MEADOW, Use.FIELD) or np.abs(centre).max() > 420:
            continue
        pitch = ParkingLot(centre, 92.0, 58.0, parcel.row_azimuth_rad)
        outline = rectangle(centre, 100.0, 66.0, parcel.row_azimuth_rad)
        _, along_m, across_m = long_axis(parcel.outline_ne_m)
        if along_m > 112 and across_m > 74 and ground.free(outline):
            ground.take(outline)
            pitches.append(pitch)
            parcels[index] = replace(parcel, use=Use.MEADOW)
            return


def _build_house(rng: np.random.Generator, parcel: Parcel, ground: _Ground, buildings: list[Building]) -> None:
    if rng.random() < 0.06:
        return
    centre = parcel.outline_ne_m.mean(axis=0)
    azimuth = parcel.row_azimuth_rad + (np.pi / 2 if rng.random() < 0.4 else 0.0) + rng.normal(0, 0.03)
    for _ in range(8):
        eaves = rng.uniform(2.8, 5.6)
        house = Building(
            centre + rng.normal(0, 2.5, 2),
            rng.uniform(9.5, 14.5),
            rng.uniform(7.5, 9.8),
            azimuth,
            eaves,
            eaves + rng.uniform(2.0, 3.6),
            BuildingKind.HOUSE,
            int(rng.integers(8)),
        )
        if ground.free(house.outline_ne_m(1.0)):
            ground.take(house.outline_ne_m(1.0))
            buildings.append(house)
            break
    for _ in range(3):
        angle = rng.uniform(0, 2 * np.pi)
        offset = rng.uniform(10, 15) * np.array([np.cos(angle), np.sin(angle)])
        shed = Building(
            centre + offset,
            rng.uniform(4, 7),
            rng.uniform(3, 5),
            azimuth,
            2.3,
            2.3 + rng.uniform(0.1, 1.2),
            BuildingKind.SHED,
            int(rng.integers(8)),
        )
        if rng.random() < 0.6 and ground.free(shed.outline_ne_m(0.8)):
            ground.take(shed.outline_ne_m(0.8))
            buildings.append(shed)
            break


def _build_farm(rng: np.random.Generator, parcel: Parcel, ground: _Ground, buildings: list[Building]) -> int:
    centre = parcel.outline_ne_m.mean(axis=0)
    azimuth = parcel.row_azimuth_rad
    placed = 0
    for turn in range(4):
        angle = azimuth + turn * np.pi / 2
        long_m, wide_m = rng.uniform(18, 38), rng.uniform(10, 15)
        offset = (wide_m / 2 + rng.uniform(11, 16)) * np.array([np.cos(angle), np.sin(angle)])
        eaves = rng.uniform(3.5, 5.5)
        barn = Building(
            centre + offset,
            long_m,
            wide_m,
            angle + np.pi / 2 + rng.normal(0, 0.02),
            eaves,
            eaves + rng.uniform(2.5, 4.5),
            BuildingKind.BARN,
            int(rng.integers(6)),
        )
        if ground.free(barn.outline_ne_m(1.0)):
            ground.take(barn.outline_ne_m(1.0))
            buildings.append(barn)
            placed += 1
    return int(placed > 0)


def _drives(buildings: tuple[Building, ...], ways: list[Way]) -> tuple[Way, ...]:
    """A short drive from every house and barn to the nearest way."""
    nodes = np.vstack([way.line_ne_m for way in ways])
    drives = []
    for building in buildings:
        if building.kind is BuildingKind.SHED:
            continue
        distance = np.linalg.norm(nodes - building.centre_ne_m, axis=1)
        nearest = nodes[np.argmin(distance)]
        if distance.min() < 75.0:
            width = 5.0 if building.kind is BuildingKind.HALL else 2.8
            drives.append(Way(np.array([building.centre_ne_m, nearest]), WayKind.DRIVE, width))
    return tuple(drives)


def later_layout(layout: Layout, seed: int, changed_share: float) -> Layout:
    """The land some years on: fields split, borders and trees gone, houses pulled down and built."""
    rng = rng_for(seed, "world", "changes")
    parcels: list[Parcel] = []
    key = len(layout.parcels)
    for parcel in layout.parcels:
        if parcel.use in (Use.FIELD, Use.MEADOW) and rng.random() < changed_share:
            parcels.extend(_split_field(rng, parcel, key))
            key += 1
        else:
            parcels.append(parcel)
    gone = rng.random(len(layout.borders)) < changed_share
    gone_lines = [border.line_ne_m for border, out in zip(layout.borders, gone, strict=True) if out]
    keep = rng.random(len(layout.trees.radius_m)) > changed_share / 2
    positions = layout.trees.position_ne_m
    for line in gone_lines:
        keep &= np.linalg.norm(positions[:, None] - line[None], axis=2).min(axis=1) > 5.5
    for parcel in layout.parcels:
        if parcel.use is Use.WOOD and rng.random() < 2 * changed_share:
            centre = parcel.outline_ne_m[rng.integers(len(parcel.outline_ne_m))]
            keep &= np.linalg.norm(positions - centre, axis=1) > rng.uniform(25, 45)
    trees = layout.trees.kept(keep)
    trees = trees.scaled(rng.normal(1.06, 0.06, len(trees.radius_m)).clip(0.8, 1.3))
    buildings = [
        _renovated(rng, building, changed_share)
        for building in layout.buildings
        if rng.random() > changed_share / 2 or building.kind is BuildingKind.HALL
    ]
    return replace(
        layout,
        parcels=tuple(parcels),
        borders=tuple(border for border, out in zip(layout.borders, gone, strict=True) if not out),
        buildings=tuple(buildings),
        trees=_clear_of(trees, buildings),
    )


def _renovated(rng: np.random.Generator, building: Building, changed_share: float) -> Building:
    if building.kind is BuildingKind.HALL or rng.random() > changed_share:
        return building
    return replace(building, length_m=building.length_m * rng.uniform(1.1, 1.5), roof=int(rng.integers(8)))


def _clear_of(trees: Trees, buildings: list[Building]) -> Trees:
    keep = np.ones(len(trees.radius_m), bool)
    for building in buildings:
        outline = building.outline_ne_m(1.0).astype(np.float32)
        near = np.linalg.norm(trees.position_ne_m - building.centre_ne_m, axis=1) < building.length_m
        for index in np.flatnonzero(near):
            north, east = trees.position_ne_m[index]
            keep[index] &= cv2.pointPolygonTest(outline, (float(north), float(east)), False) < 0
    return trees.kept(keep)


def _split_field(rng: np.random.Generator, parcel: Parcel, key: int) -> tuple[Parcel, ...]:
    """Both parts of a field divided lengthwise; the second part is drawn over the first."""
    azimuth, along_m, across_m = long_axis(parcel.outline_ne_m)
    centre = parcel.outline_ne_m.mean(axis=0)
    across = np.array([-np.sin(azimuth), np.cos(azimuth)])
    side = (parcel.outline_ne_m - centre) @ across
    limit = rng.uniform(-0.2, 0.2) * across_m
    outline = parcel.outline_ne_m - np.maximum(side - limit, 0.0)[:, None] * across
    turned = parcel.row_azimuth_rad + (np.pi / 2 if rng.random() < 0.3 and along_m < 2 * across_m else 0.0)
    return parcel, Parcel(key, outline, parcel.use, turned)
