"""What stands where: the vector description of the ground, in metres north and east of the world's centre."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from estimator.types import Float


class Use(StrEnum):
    """What a parcel is used for."""

    FIELD = "field"
    MEADOW = "meadow"
    WOOD = "wood"
    LOT = "lot"
    YARD = "yard"


class WayKind(StrEnum):
    """Roads and tracks, widest first."""

    MAIN = "main"
    STREET = "street"
    TRACK = "track"
    DRIVE = "drive"


class BorderKind(StrEnum):
    """What separates two parcels where no way does."""

    HEDGE = "hedge"
    TREE_ROW = "tree_row"
    DITCH = "ditch"
    BALK = "balk"
    FENCE = "fence"


class BuildingKind(StrEnum):
    """Decides shape and size of the roof."""

    HOUSE = "house"
    SHED = "shed"
    BARN = "barn"
    HALL = "hall"


@dataclass(frozen=True, slots=True, eq=False)
class Parcel:
    """A piece of land of one use; ``key`` is its own for good and names its random stream."""

    key: int
    outline_ne_m: Float
    use: Use
    row_azimuth_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A road or track along a line (n, 2)."""

    line_ne_m: Float
    kind: WayKind
    width_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Border:
    """The line (n, 2) between two parcels."""

    line_ne_m: Float
    kind: BorderKind


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """A rectangular building with its ridge along the length."""

    centre_ne_m: Float
    length_m: float
    width_m: float
    azimuth_rad: float
    eaves_m: float
    ridge_m: float
    kind: BuildingKind
    roof: int

    def outline_ne_m(self, margin_m: float = 0.0) -> Float:
        """The four corners (4, 2)."""
        return rectangle(self.centre_ne_m, self.length_m + 2 * margin_m, self.width_m + 2 * margin_m, self.azimuth_rad)


@dataclass(frozen=True, slots=True, eq=False)
class Trees:
    """All trees and bushes: positions (n, 2), crown radii, heights, and whether each is a conifer."""

    position_ne_m: Float
    radius_m: Float
    height_m: Float
    conifer: NDArray[np.bool_]

    def kept(self, keep: NDArray[np.bool_]) -> Trees:
        """Those where ``keep`` is true."""
        return Trees(self.position_ne_m[keep], self.radius_m[keep], self.height_m[keep], self.conifer[keep])

    def scaled(self, factor: Float) -> Trees:
        """Crowns and heights times a factor (n,)."""
        return replace(self, radius_m=self.radius_m * factor, height_m=self.height_m * factor)


@dataclass(frozen=True, slots=True, eq=False)
class ParkingLot:
    """A paved rectangle with rows of marked stalls."""

    centre_ne_m: Float
    length_m: float
    width_m: float
    azimuth_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Everything that has a place on the ground at one time, cars excepted."""

    half_size_m: float
    parcels: tuple[Parcel, ...]
    ways: tuple[Way, ...]
    borders: tuple[Border, ...]
    buildings: tuple[Building, ...]
    parking: tuple[ParkingLot, ...]
    pitches: tuple[ParkingLot, ...]
    trees: Trees
    lake_ne_m: Float
    stream_ne_m: Float


def rectangle(centre_ne_m: Float, length_m: float, width_m: float, azimuth_rad: float) -> Float:
    """Corners (4, 2) of a rectangle whose length points along the azimuth."""
    along = np.array([np.cos(azimuth_rad), np.sin(azimuth_rad)]) * length_m / 2
    across = np.array([-np.sin(azimuth_rad), np.cos(azimuth_rad)]) * width_m / 2
    corners: Float = np.asarray(centre_ne_m) + np.array(
        [along + across, along - across, -along - across, -along + across]
    )
    return corners


def densified(line_ne_m: Float, step_m: float = 8.0) -> Float:
    """The same polyline with vertices at most ``step_m`` apart."""
    pieces = []
    for start, stop in pairwise(line_ne_m):
        count = max(1, int(np.ceil(np.hypot(*(stop - start)) / step_m)))
        pieces.append(start + (stop - start) * (np.arange(count) / count)[:, None])
    return np.vstack([*pieces, line_ne_m[-1:]])


def distance_to_line_m(points_ne_m: Float, line_ne_m: Float) -> Float:
    """Distance (n,) of points (n, 2) from a polyline."""
    best = np.full(len(points_ne_m), np.inf)
    for start, stop in pairwise(line_ne_m):
        span = stop - start
        length2 = max(float(span @ span), 1e-9)
        t = np.clip((points_ne_m - start) @ span / length2, 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points_ne_m - start - t[:, None] * span, axis=1))
    return best


def long_axis(outline_ne_m: Float) -> tuple[float, float, float]:
    """Azimuth of a polygon's longest extent, the extent along and the extent across it."""
    centred = outline_ne_m - outline_ne_m.mean(axis=0)
    best = (0.0, 0.0, np.inf)
    for start, stop in zip(outline_ne_m, np.roll(outline_ne_m, -1, axis=0), strict=True):
        edge = stop - start
        if edge @ edge < 1.0:
            continue
        azimuth = float(np.arctan2(edge[1], edge[0]))
        c, s = np.cos(azimuth), np.sin(azimuth)
        along = centred @ np.array([c, s])
        across = centred @ np.array([-s, c])
        extents = float(np.ptp(along)), float(np.ptp(across))
        if extents[0] < extents[1]:
            extents, azimuth = extents[::-1], azimuth + np.pi / 2
        if extents[0] * extents[1] < best[1] * best[2] or not np.isfinite(best[2]):
            best = (azimuth, *extents)
    return best


def polygon_area_m2(outline_ne_m: Float) -> float:
    """Area of a simple polygon."""
    n, e = outline_ne_m[:, 0], outline_ne_m[:, 1]
    return float(abs(np.dot(n, np.roll(e, -1)) - np.dot(e, np.roll(n, -1))) / 2)
