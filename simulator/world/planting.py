"""Where trees and bushes grow: woods, hedges, rows, gardens, banks."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from simulator.world.layout import Border, BorderKind, Building, Parcel, Trees, Use, Way, WayKind, densified

_WOOD_SPACING_M = 4.3


class _Nursery:
    """Collects trees until they are planted."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._rows: list[Float] = []

    def add(self, positions: Float, radius: tuple[float, float], shape: tuple[float, float], conifer: float) -> None:
        """Trees at positions (n, 2); height is radius times a factor drawn from ``shape``."""
        n = len(positions)
        if n == 0:
            return
        r = self.rng.uniform(*radius, n)
        self._rows.append(
            np.column_stack([positions, r, r * self.rng.uniform(*shape, n), self.rng.random(n) < conifer])
        )

    def planted(self) -> Trees:
        rows = np.vstack(self._rows) if self._rows else np.zeros((0, 5))
        return Trees(rows[:, :2], rows[:, 2], rows[:, 3], rows[:, 4] > 0.5)


def plant(
    rng: np.random.Generator,
    parcels: tuple[Parcel, ...],
    borders: tuple[Border, ...],
    ways: tuple[Way, ...],
    buildings: tuple[Building, ...],
    lake_ne_m: Float,
    stream_ne_m: Float,
) -> Trees:
    """All trees of the world; some may stand on roads or in buildings, which is for the caller to sort out."""
    nursery = _Nursery(rng)
    for parcel in parcels:
        if parcel.use is Use.WOOD:
            _wood(nursery, parcel)
        elif parcel.use is Use.LOT:
            _garden(nursery, parcel)
        elif parcel.use is Use.MEADOW and rng.random() < 0.6:
            nursery.add(_inside(rng, parcel.outline_ne_m, int(rng.integers(1, 9))), (2.0, 5.0), (2.0, 3.0), 0.1)
    for border in borders:
        _along_border(nursery, border)
    for way in ways:
        if way.kind is WayKind.MAIN:
            _avenue(nursery, way)
    for building in buildings:
        count = int(rng.integers(0, 4))
        offset = rng.normal(0, building.length_m, (count, 2))
        nursery.add(building.centre_ne_m + offset, (1.2, 3.8), (1.8, 2.8), 0.3)
    _bank(nursery, lake_ne_m, 0.5, 3.0)
    _bank(nursery, stream_ne_m, 0.6, 3.5)
    return nursery.planted()


def _wood(nursery: _Nursery, parcel: Parcel) -> None:
    rng = nursery.rng
    low, high = parcel.outline_ne_m.min(axis=0), parcel.outline_ne_m.max(axis=0)
    norths = np.arange(low[0], high[0], _WOOD_SPACING_M)
    easts = np.arange(low[1], high[1], _WOOD_SPACING_M)
    grid = np.stack(np.meshgrid(norths, easts, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = grid + rng.normal(0, 0.28 * _WOOD_SPACING_M, grid.shape)
    grid = grid[_contains(parcel.outline_ne_m, grid)]
    # Gaps come in patches, not as single missing trees.
    gaps = rng.uniform(low, high, (max(1, len(grid) // 130), 2))
    clear = np.linalg.norm(grid[:, None] - gaps[None], axis=2).min(axis=1) > rng.uniform(3, 9, len(grid))
    conifer_share = float(rng.choice([0.05, 0.5, 0.95], p=[0.5, 0.2, 0.3]))
    nursery.add(grid[clear], (1.9, 3.6), (3.4, 4.8), conifer_share)


def _garden(nursery: _Nursery, parcel: Parcel) -> None:
    rng = nursery.rng
    nursery.add(_inside(rng, parcel.outline_ne_m, int(rng.integers(1, 5))), (1.3, 3.6), (1.8, 2.8), 0.25)
    nursery.add(_inside(rng, parcel.outline_ne_m, int(rng.integers(2, 8))), (0.5, 1.2), (1.0, 1.8), 0.2)


def _along_border(nursery: _Nursery, border: Border) -> None:
    rng = nursery.rng
    if border.kind is BorderKind.HEDGE:
        line = densified(border.line_ne_m, 1.5)
        line = line[rng.random(len(line)) > 0.06]
        nursery.add(line + rng.normal(0, 0.35, line.shape), (0.9, 1.7), (1.4, 2.0), 0.0)
        some = line[rng.random(len(line)) < 0.045]
        nursery.add(some, (2.2, 4.2), (2.2, 3.0), 0.05)
    elif border.kind is BorderKind.TREE_ROW:
        line = densified(border.line_ne_m, 9.0)
        line = line[rng.random(len(line)) > 0.12]
        nursery.add(line + rng.normal(0, 0.5, line.shape), (2.4, 4.0), (2.6, 3.6), 0.0)
    elif border.kind is BorderKind.DITCH:
        line = densified(border.line_ne_m, 4.0)
        line = line[rng.random(len(line)) < 0.16]
        nursery.add(line + rng.normal(0, 1.2, line.shape), (0.8, 2.4), (1.4, 2.4), 0.0)
    elif border.kind is BorderKind.FENCE:
        line = densified(border.line_ne_m, 1.2)
        if rng.random() < 0.55:
            nursery.add(line + rng.normal(0, 0.1, line.shape), (0.6, 0.9), (1.6, 2.2), 0.3)


def _avenue(nursery: _Nursery, way: Way) -> None:
    rng = nursery.rng
    line = densified(way.line_ne_m, 12.0)
    along = np.gradient(line, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    for side in (-1.0, 1.0):
        stretch = np.sin(np.arange(len(line)) / rng.uniform(4, 9) + rng.uniform(0, 6)) > 0.35
        stretch &= rng.random(len(line)) > 0.2
        offset = side * (way.width_m / 2 + rng.uniform(3.5, 5.0))
        nursery.add((line + offset * normal)[stretch], (2.2, 4.4), (2.2, 3.2), 0.0)


def _bank(nursery: _Nursery, line: Float, share: float, spread_m: float) -> None:
    rng = nursery.rng
    dense = densified(line, 4.0)
    dense = dense[rng.random(len(dense)) < share]
    nursery.add(dense + rng.normal(0, spread_m, dense.shape), (0.9, 3.6), (1.8, 3.0), 0.0)


def _inside(rng: np.random.Generator, outline_ne_m: Float, count: int) -> Float:
    points = rng.uniform(outline_ne_m.min(axis=0), outline_ne_m.max(axis=0), (count, 2))
    return points[_contains(outline_ne_m, points)]


def _contains(outline_ne_m: Float, points_ne_m: Float) -> NDArray[np.bool_]:
    """Which points (n, 2) lie inside, to within half a metre: looked up in a filled raster."""
    low = np.floor(outline_ne_m.min(axis=0)) - 1
    size = (np.ceil(outline_ne_m.max(axis=0)) - low + 2).astype(int) * 2
    mask = np.zeros((size[0], size[1]), np.uint8)
    cv2.fillPoly(mask, [np.round((outline_ne_m - low)[:, ::-1] * 2).astype(np.int32)], 1)
    cells = np.clip(np.round((points_ne_m - low) * 2).astype(int), 0, size - 1)
    inside: NDArray[np.bool_] = mask[cells[:, 0], cells[:, 1]] > 0
    return inside
