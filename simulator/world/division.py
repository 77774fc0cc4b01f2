"""Cuts the land into parcels the way land is cut: roads first, then tracks, then hedges and balks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estimator.types import Float
from simulator.world.layout import Border, BorderKind, Way, WayKind, densified, long_axis, polygon_area_m2

_WAY_WIDTH_M = {WayKind.MAIN: 7.0, WayKind.STREET: 5.2, WayKind.TRACK: 3.2}
_BORDERS = (BorderKind.HEDGE, BorderKind.TREE_ROW, BorderKind.DITCH, BorderKind.BALK)
_BORDER_SHARE = (0.30, 0.12, 0.13, 0.45)
_TRACK_AREA_M2 = 90_000.0
_BLOCK_AREA_M2 = 8_000.0


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    """An undivided piece of land."""

    outline_ne_m: Float
    in_village: bool


@dataclass(slots=True, eq=False)
class Division:
    """The result: pieces of land and what runs between them."""

    leaves: list[Leaf] = field(default_factory=list)
    ways: list[Way] = field(default_factory=list)
    borders: list[Border] = field(default_factory=list)


class Bend:
    """A smooth displacement of the plane by up to 20 m or so, which makes straight cuts into curved ones."""

    def __init__(self, rng: np.random.Generator, amplitude_m: float = 9.0) -> None:
        wavelength_m = rng.uniform(350.0, 900.0, (4, 1))
        azimuth = rng.uniform(0, 2 * np.pi, (4, 1))
        self._wave = 2 * np.pi / wavelength_m * np.hstack([np.cos(azimuth), np.sin(azimuth)])
        self._phase = rng.uniform(0, 2 * np.pi, 4)
        self._amplitude = amplitude_m * rng.standard_normal((4, 2)) / np.sqrt(2)

    def __call__(self, points_ne_m: Float) -> Float:
        """The points (n, 2) displaced."""
        bent: Float = points_ne_m + np.sin(points_ne_m @ self._wave.T + self._phase) @ self._amplitude
        return bent


def divide(rng: np.random.Generator, half_size_m: float, village_ne_m: Float, village_radius_m: float) -> Division:
    """Cut a square of land; the first two cuts are main roads that cross in the village."""
    bend = Bend(rng)
    result = Division()
    half = half_size_m + 60.0
    square = np.array([[half, -half], [half, half], [-half, half], [-half, -half]])
    azimuth = rng.uniform(np.radians(60), np.radians(115))
    north, south, cut = _split(square, village_ne_m, azimuth)
    _add_way(result, bend, cut, WayKind.MAIN)
    crossing = azimuth + rng.uniform(np.radians(70), np.radians(110))
    for piece in (north, south):
        left, right, cut = _split(piece, village_ne_m + rng.normal(0, 25.0, 2), crossing + rng.normal(0, 0.15))
        _add_way(result, bend, cut, WayKind.MAIN)
        for part in (left, right):
            _divide(rng, part, bend, village_ne_m, village_radius_m, result)
    return result


def _divide(
    rng: np.random.Generator,
    outline: Float,
    bend: Bend,
    village_ne_m: Float,
    village_radius_m: float,
    result: Division,
) -> None:
    area = polygon_area_m2(outline)
    in_village = bool(np.hypot(*(outline.mean(axis=0) - village_ne_m)) < village_radius_m)
    smallest = rng.uniform(900, 1500) if in_village else np.exp(rng.uniform(np.log(7_000), np.log(42_000)))
    if area < smallest:
        closed = np.vstack([outline, outline[:1]])
        result.leaves.append(Leaf(bend(densified(closed))[:-1], in_village))
        return
    azimuth, along_m, across_m = long_axis(outline)
    centre = outline.mean(axis=0)
    offset = rng.uniform(-0.14, 0.14) * along_m * np.array([np.cos(azimuth), np.sin(azimuth)])
    skew = rng.normal(0, np.radians(3 if in_village else 7))
    first, second, cut = _split(outline, centre + offset, azimuth + np.pi / 2 + skew)
    if min(polygon_area_m2(first), polygon_area_m2(second)) < 0.15 * area or across_m < 12.0:
        closed = np.vstack([outline, outline[:1]])
        result.leaves.append(Leaf(bend(densified(closed))[:-1], in_village))
        return
    if in_village and area > _BLOCK_AREA_M2:
        _add_way(result, bend, cut, WayKind.STREET)
    elif in_village:
        result.borders.append(Border(bend(densified(cut)), BorderKind.FENCE))
    elif area > _TRACK_AREA_M2 and rng.random() < 0.75:
        _add_way(result, bend, cut, WayKind.TRACK)
    else:
        kind = _BORDERS[rng.choice(len(_BORDERS), p=_BORDER_SHARE)]
        result.borders.append(Border(bend(densified(cut)), kind))
    for part in (first, second):
        _divide(rng, part, bend, village_ne_m, village_radius_m, result)


def _add_way(result: Division, bend: Bend, cut: Float, kind: WayKind) -> None:
    result.ways.append(Way(bend(densified(cut)), kind, _WAY_WIDTH_M[kind]))


def _split(outline: Float, through_ne_m: Float, azimuth_rad: float) -> tuple[Float, Float, Float]:
    """Both halves of a convex polygon cut along a line, and the cut (2, 2)."""
    normal = np.array([-np.sin(azimuth_rad), np.cos(azimuth_rad)])
    side = (outline - through_ne_m) @ normal
    halves: tuple[list[Float], list[Float]] = ([], [])
    cut: list[Float] = []
    for index, point in enumerate(outline):
        following = (index + 1) % len(outline)
        halves[0 if side[index] <= 0 else 1].append(point)
        if (side[index] <= 0) != (side[following] <= 0):
            t = side[index] / (side[index] - side[following])
            crossing = point + t * (outline[following] - point)
            halves[0].append(crossing)
            halves[1].append(crossing)
            cut.append(crossing)
    return np.array(halves[0]), np.array(halves[1]), np.array(cut)
