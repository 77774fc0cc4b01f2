"""What stands on the ground: heights of buildings, trees and cars, and which of them covers a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from simulator.world.epoch import Colour
from simulator.world.layout import Building, BuildingKind, Trees, rectangle
from simulator.world.patch import Float32, Patch

_STAMP_PX = 48
_STAMPS = 12
CAR_LENGTH_M, CAR_WIDTH_M, CAR_HEIGHT_M = 4.5, 1.8, 1.45

# (red, green, blue); houses and barns draw by index.
ROOFS: tuple[Colour, ...] = (
    (164, 98, 76),
    (150, 84, 66),
    (172, 112, 84),
    (98, 92, 94),
    (122, 112, 108),
    (128, 88, 72),
    (150, 150, 152),
    (84, 84, 92),
)
HALL_ROOFS: tuple[Colour, ...] = ((204, 204, 202), (188, 194, 198), (196, 190, 178))


@dataclass(frozen=True, slots=True, eq=False)
class Car:
    """A parked or driving car as it stands at one time."""

    centre_ne_m: Float
    azimuth_rad: float
    colour: Colour

    def outline_ne_m(self) -> Float:
        """The four corners (4, 2)."""
        return rectangle(self.centre_ne_m, CAR_LENGTH_M, CAR_WIDTH_M, self.azimuth_rad)


def raise_buildings(
    buildings: tuple[Building, ...], patch: Patch, height_m: Float32, colour_bgr: Float32, brightness: float
) -> None:
    """Put roofs into the height and colour rasters, in place."""
    for building in buildings:
        outline = building.outline_ne_m()
        if not patch.touches(outline):
            continue
        rows, cols = patch.box(outline, 0.5)
        part = patch.cut(rows, cols)
        north = part.norths_m() - np.float32(building.centre_ne_m[0])
        east = part.easts_m() - np.float32(building.centre_ne_m[1])
        c, s = np.float32(np.cos(building.azimuth_rad)), np.float32(np.sin(building.azimuth_rad))
        along, across = north * c + east * s, east * c - north * s
        inside = (np.abs(along) <= building.length_m / 2) & (np.abs(across) <= building.width_m / 2)
        slope = np.abs(across) / np.float32(building.width_m / 2)
        roof_m = building.ridge_m - (building.ridge_m - building.eaves_m) * slope
        hall = building.kind is BuildingKind.HALL
        rgb = HALL_ROOFS[building.roof % len(HALL_ROOFS)] if hall else ROOFS[building.roof % len(ROOFS)]
        bgr = np.array(rgb[::-1], np.float32) * np.float32(brightness)
        tiles = 1 + 0.05 * np.sin(2 * np.pi * across / 0.9).astype(np.float32)
        texture = np.where(slope < 0.06, np.float32(1.18), tiles)
        extra_m = np.zeros_like(roof_m)
        if hall:
            # Sky-lights in rows and a few air handlers.
            skylight = (np.abs(across % 9.0 - 4.5) < 0.8) & (np.abs(along % 7.0 - 3.5) < 2.2)
            texture = np.where(skylight, np.float32(0.72), np.float32(1.0))
            handler = (np.abs(across - 6.0) < 1.6) & (np.abs(along % 19.0 - 9.0) < 1.3)
            texture = np.where(handler, np.float32(0.86), texture)
            extra_m = np.where(handler, np.float32(1.6), extra_m)
        else:
            chimney = (np.abs(along - 0.27 * building.length_m) < 0.45) & (np.abs(across - 0.6) < 0.45)
            texture = np.where(chimney, np.float32(0.62), texture)
            extra_m = np.where(chimney, np.float32(1.0), extra_m)
        height_m[rows, cols][inside] = (roof_m + extra_m)[inside]
        colour_bgr[rows, cols][inside] = (texture[..., None] * bgr)[inside]


def raise_cars(cars: tuple[Car, ...], patch: Patch, height_m: Float32, colour_bgr: Float32) -> None:
    """Put cars into the height and colour rasters, in place."""
    for car in cars:
        outline = car.outline_ne_m()
        if not patch.touches(outline):
            continue
        rows, cols = patch.box(outline, 0.5)
        part = patch.cut(rows, cols)
        north = part.norths_m() - np.float32(car.centre_ne_m[0])
        east = part.easts_m() - np.float32(car.centre_ne_m[1])
        c, s = np.float32(np.cos(car.azimuth_rad)), np.float32(np.sin(car.azimuth_rad))
        along, across = north * c + east * s, np.abs(east * c - north * s)
        body = (np.abs(along) <= CAR_LENGTH_M / 2) & (across <= CAR_WIDTH_M / 2)
        glass = body & (across < 0.75) & ((np.abs(along - 0.75) < 0.35) | (np.abs(along + 1.55) < 0.25))
        cabin = body & (along < 1.0) & (along > -1.8)
        bgr = np.array(car.colour[::-1], np.float32)
        colour_bgr[rows, cols][body] = bgr
        colour_bgr[rows, cols][glass] = bgr * 0.25 + 22
        height_m[rows, cols][body] = 0.9
        height_m[rows, cols][cabin] = CAR_HEIGHT_M


class Crowns:
    """A few tree shapes, stretched to size for every tree."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._broadleaf = [_dome(rng, 0.16, 0.20) for _ in range(_STAMPS)]
        self._conifer = [_cone(rng) for _ in range(_STAMPS)]

    def raise_trees(self, trees: Trees, patch: Patch, height_m: Float32, owner: NDArray[np.uint16]) -> None:
        """Put crowns into the height raster and their number plus one into ``owner``, in place."""
        row_col = patch.row_col(trees.position_ne_m)
        reach = trees.radius_m / patch.gsd_m + 2
        near = np.flatnonzero(
            (row_col[:, 0] > -reach)
            & (row_col[:, 0] < patch.rows + reach)
            & (row_col[:, 1] > -reach)
            & (row_col[:, 1] < patch.cols + reach)
        )
        for index in near:
            size = max(3, round(2 * trees.radius_m[index] / patch.gsd_m))
            row, col = (round(x - size / 2) for x in row_col[index])
            r0, c0 = max(row, 0), max(col, 0)
            r1, c1 = min(row + size, patch.rows), min(col + size, patch.cols)
            if r0 >= r1 or c0 >= c1:
                continue
            shapes = self._conifer if trees.conifer[index] else self._broadleaf
            shape = cv2.resize(shapes[index % _STAMPS], (size, size), interpolation=cv2.INTER_AREA)
            crown = shape[r0 - row : r1 - row, c0 - col : c1 - col] * np.float32(trees.height_m[index])
            below = height_m[r0:r1, c0:c1]
            above = crown > np.maximum(below, np.float32(0.3))
            np.copyto(below, crown, where=above)
            owner[r0:r1, c0:c1][above] = index + 1


def _polar() -> tuple[Float32, Float32]:
    axis = (np.arange(_STAMP_PX, dtype=np.float32) + 0.5) / (_STAMP_PX / 2) - 1
    y, x = np.meshgrid(axis, axis, indexing="ij")
    return np.hypot(x, y), np.arctan2(y, x)


def _lumps(rng: np.random.Generator, cells: int) -> Float32:
    small = rng.standard_normal((cells, cells)).astype(np.float32)
    lumps = cv2.resize(small, (_STAMP_PX, _STAMP_PX), interpolation=cv2.INTER_CUBIC)
    return np.asarray(lumps, np.float32)


def _dome(rng: np.random.Generator, raggedness: float, lumpiness: float) -> Float32:
    radius, angle = _polar()
    edge = np.full_like(radius, 1 - raggedness)
    for harmonic in (2, 3, 5, 8):
        edge += raggedness * 0.4 * rng.normal() * np.cos(harmonic * angle + rng.uniform(0, 6.28))
    edge = np.clip(edge, 0.5, 1.0)
    dome = np.sqrt(np.clip(1 - (radius / edge) ** 2, 0, 1)) ** 0.8
    dome = dome * (0.55 + 0.45 * dome) * (1 + lumpiness * _lumps(rng, 8) * 0.6)
    return np.where(radius < edge, np.clip(dome, 0.05, 1.15), 0).astype(np.float32)


def _cone(rng: np.random.Generator) -> Float32:
    radius, angle = _polar()
    edge = 0.84 + 0.10 * np.cos(rng.integers(5, 9) * angle + rng.uniform(0, 6.28))
    cone = np.clip(1 - radius / edge, 0, 1) ** 0.85 * (1 + 0.10 * _lumps(rng, 10))
    return np.where(radius < edge, np.clip(cone, 0.03, 1.1), 0).astype(np.float32)
