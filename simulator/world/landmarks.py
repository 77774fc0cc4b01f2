"""Named things on the ground that a person would click: cars, corners of the sports ground, crossings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.world.layout import Layout, WayKind
from simulator.world.patch import Patch
from simulator.world.raised import CAR_HEIGHT_M, Car
from simulator.world.regions import pitch_lines_ne_m
from simulator.world.terrain import Terrain

_WANTED_CARS = 30
_UNIT_M = 0.1


@dataclass(frozen=True, slots=True)
class Landmark:
    """A point on the bare ground, metres north and east of the world's centre and above its datum."""

    name: str
    north_m: float
    east_m: float
    height_m: float


def find_landmarks(
    layout: Layout, cars: tuple[Car, ...], terrain: Terrain, raised: NDArray[np.uint8], patch: Patch
) -> tuple[Landmark, ...]:
    """Things that no tree hides, far apart from each other."""
    candidates: list[tuple[str, float, float]] = []
    for pitch in layout.pitches:
        corners = pitch_lines_ne_m(pitch)[0][:4]
        candidates += [(f"pitch-corner-{i + 1}", float(n), float(e)) for i, (n, e) in enumerate(corners)]
    for index, crossing in enumerate(_crossings(layout)):
        candidates.append((f"crossing-{index + 1}", *crossing))
    chosen: list[tuple[str, float, float]] = [c for c in candidates if _clear(c, raised, patch, 0.3)]
    limit = 0.85 * layout.half_size_m
    for car in cars:
        place = (float(car.centre_ne_m[0]), float(car.centre_ne_m[1]))
        if sum(name.startswith("car") for name, *_ in chosen) >= _WANTED_CARS:
            break
        apart = all(np.hypot(place[0] - n, place[1] - e) > 45.0 for _, n, e in chosen)
        name = f"car-{sum(name.startswith('car') for name, *_ in chosen) + 1}"
        if apart and max(map(abs, place)) < limit and _clear((name, *place), raised, patch, CAR_HEIGHT_M + 0.3):
            chosen.append((name, *place))
    return tuple(Landmark(name, n, e, float(terrain.at(n, e))) for name, n, e in chosen)


def _clear(place: tuple[str, float, float], raised: NDArray[np.uint8], patch: Patch, limit_m: float) -> bool:
    row, col = patch.row_col(np.array(place[1:])).round().astype(int)
    reach = int(3.5 / patch.gsd_m)
    if not (reach <= row < patch.rows - reach and reach <= col < patch.cols - reach):
        return False
    around = raised[row - reach : row + reach + 1, col - reach : col + reach + 1]
    return float(around.max()) * _UNIT_M <= limit_m


def _crossings(layout: Layout) -> list[tuple[float, float]]:
    """Where streets end on other roads."""
    main = [way for way in layout.ways if way.kind in (WayKind.MAIN, WayKind.STREET)]
    found: list[tuple[float, float]] = []
    for way in main:
        for end in (way.line_ne_m[0], way.line_ne_m[-1]):
            meets = any(
                other is not way and np.linalg.norm(other.line_ne_m - end, axis=1).min() < 4.0 for other in main
            )
            apart = all(np.hypot(end[0] - n, end[1] - e) > 60.0 for n, e in found)
            if meets and apart and len(found) < 4:
                found.append((float(end[0]), float(end[1])))
    return found
