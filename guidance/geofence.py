"""Where a vehicle may fly: polygons and circles to stay inside of, or outside of. Pure.

Edges of polygons are straight in latitude and longitude, as autopilots take them. No zone here is larger than half of
the Earth in longitude, so that one over the antimeridian is unambiguous.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.local import LocalFrame
from estimator.types import Float
from guidance.mission import Home, check_place

MAX_VERTICES = 255
MAX_ZONES = 255
_MAX_RADIUS_M = 1_000_000.0

Bool = NDArray[np.bool_]

Place = tuple[float, float]
"""Latitude and longitude, WGS-84, degrees."""


class InclusionRule(StrEnum):
    """What several inclusion zones mean together: PX4 asks for any of them, ArduPilot for all unless told otherwise."""

    ALL = "all"
    ANY = "any"


@dataclass(frozen=True, slots=True)
class FencePolygon:
    """A polygon, closed by itself. ValueError says why it is none."""

    inclusion: bool
    vertices_deg: tuple[Place, ...]

    def __post_init__(self) -> None:
        if not 3 <= len(self.vertices_deg) <= MAX_VERTICES:
            message = f"a fence polygon has 3 to {MAX_VERTICES} vertices, not {len(self.vertices_deg)}"
            raise ValueError(message)
        for lat_deg, lon_deg in self.vertices_deg:
            _check_finite(lat_deg, lon_deg)

    def holds(self, lat_deg: float, lon_deg: float) -> bool:
        """Whether a place is inside, by the even-odd rule: of a polygon that crosses itself, not every part is."""
        inside = False
        corners = self._about(lon_deg)
        for (lat_a, lon_a), (lat_b, lon_b) in zip(corners, (*corners[1:], corners[0]), strict=True):
            if (lat_a > lat_deg) != (lat_b > lat_deg):
                inside ^= (lon_b - lon_a) * (lat_deg - lat_a) / (lat_b - lat_a) + lon_a > 0.0
        return inside

    def holds_each(self, lat_deg: Float, lon_deg: Float) -> Bool:
        """``holds`` for places (...)."""
        first_lon = self.vertices_deg[0][1]
        first = _wrapped_each(first_lon - lon_deg)
        inside = np.zeros(np.shape(lat_deg), np.bool_)
        corners = [(lat, _wrapped(lon - first_lon)) for lat, lon in self.vertices_deg]
        for (lat_a, lon_a), (lat_b, lon_b) in zip(corners, (*corners[1:], corners[0]), strict=True):
            if lat_a == lat_b:
                continue
            between = (lat_a > lat_deg) != (lat_b > lat_deg)
            inside ^= between & ((lon_b - lon_a) * (lat_deg - lat_a) / (lat_b - lat_a) + lon_a + first > 0.0)
        return inside

    def crosses_itself(self) -> bool:
        """Whether two edges that are not neighbours meet: autopilots then disagree about what is inside."""
        corners = self._about(self.vertices_deg[0][1])
        edges = list(zip(corners, (*corners[1:], corners[0]), strict=True))
        last = len(edges) - 1
        return any(
            _meet(*edges[i], *edges[j])
            for i in range(len(edges)) for j in range(i + 2, len(edges)) if (i, j) != (0, last)
        )  # fmt: skip

    def _about(self, lon_deg: float) -> tuple[Place, ...]:
        """Vertices with longitudes counted from ``lon_deg``, the way round that keeps the polygon in one piece."""
        first = _wrapped(self.vertices_deg[0][1] - lon_deg)
        return tuple((lat, first + _wrapped(lon - self.vertices_deg[0][1])) for lat, lon in self.vertices_deg)


@dataclass(frozen=True, slots=True)
class FenceCircle:
    """A circle about a place; ValueError says why it is none."""

    inclusion: bool
    lat_deg: float
    lon_deg: float
    radius_m: float

    def __post_init__(self) -> None:
        _check_finite(self.lat_deg, self.lon_deg)
        if not 0.0 < self.radius_m <= _MAX_RADIUS_M:
            message = f"a fence circle's radius is above 0 and at most {_MAX_RADIUS_M:.0f} m, not {self.radius_m}"
            raise ValueError(message)

    def holds(self, lat_deg: float, lon_deg: float) -> bool:
        """Whether a place is inside, by the straight distance at the ellipsoid."""
        frame = LocalFrame(math.radians(self.lat_deg), math.radians(self.lon_deg), 0.0)
        offset_m = frame.ned_from_geodetic(math.radians(lat_deg), math.radians(lon_deg), 0.0)
        return float(np.linalg.norm(offset_m)) <= self.radius_m

    def holds_each(self, lat_deg: Float, lon_deg: Float) -> Bool:
        """``holds`` for places (...)."""
        frame = LocalFrame(math.radians(self.lat_deg), math.radians(self.lon_deg), 0.0)
        offset_m = frame.ned_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), np.zeros(np.shape(lat_deg)))
        inside: Bool = np.linalg.norm(offset_m, axis=-1) <= self.radius_m
        return inside


@dataclass(frozen=True, slots=True)
class Geofence:
    """All zones, and where a vehicle goes when it breaks out (None: as it is set up to)."""

    polygons: tuple[FencePolygon, ...] = ()
    circles: tuple[FenceCircle, ...] = ()
    breach_return: Home | None = None

    def __post_init__(self) -> None:
        if len(self.polygons) + len(self.circles) > MAX_ZONES:
            message = f"a fence has at most {MAX_ZONES} zones, not {len(self.polygons) + len(self.circles)}"
            raise ValueError(message)

    @property
    def zones(self) -> tuple[FencePolygon | FenceCircle, ...]:
        """Polygons, then circles."""
        return (*self.polygons, *self.circles)

    @property
    def empty(self) -> bool:
        """Whether it keeps nobody from anything."""
        return not (self.polygons or self.circles or self.breach_return)

    def allows(self, lat_deg: float, lon_deg: float, rule: InclusionRule = InclusionRule.ALL) -> bool:
        """Whether a vehicle may be at a place: outside of every exclusion, inside of the inclusions by ``rule``."""
        inside_of: list[bool] = []
        for zone in self.zones:
            holds = zone.holds(lat_deg, lon_deg)
            if not zone.inclusion and holds:
                return False
            if zone.inclusion:
                inside_of.append(holds)
        return all(inside_of) if rule is InclusionRule.ALL else any(inside_of) or not inside_of

    def left_by(self, lat_deg: Float, lon_deg: Float, rule: InclusionRule = InclusionRule.ALL) -> Bool:
        """Where of places (...) the vehicle is not inside of the inclusions as the rule asks; exclusions aside."""
        inside = [zone.holds_each(lat_deg, lon_deg) for zone in self.zones if zone.inclusion]
        if not inside:
            return np.zeros(np.shape(lat_deg), np.bool_)
        together = np.logical_and if rule is InclusionRule.ALL else np.logical_or
        left: Bool = ~together.reduce(inside)
        return left

    def entered_by(self, lat_deg: Float, lon_deg: Float) -> Bool:
        """Where of places (...) the vehicle is inside of an exclusion."""
        entered = np.zeros(np.shape(lat_deg), np.bool_)
        for zone in self.zones:
            if not zone.inclusion:
                entered |= zone.holds_each(lat_deg, lon_deg)
        return entered


def _check_finite(lat_deg: float, lon_deg: float) -> None:
    check_place(lat_deg, lon_deg)
    if math.isnan(lat_deg) or math.isnan(lon_deg):
        message = f"not a place: {lat_deg}, {lon_deg}"
        raise ValueError(message)


def _wrapped(degrees: float) -> float:
    return (degrees + 180.0) % 360.0 - 180.0


def _wrapped_each(degrees: Float) -> Float:
    wrapped: Float = (degrees + 180.0) % 360.0 - 180.0
    return wrapped


def _meet(a: Place, b: Place, c: Place, d: Place) -> bool:
    """Whether the segments ab and cd cross at a point inside of both."""
    return _side(a, b, c) * _side(a, b, d) < 0.0 and _side(c, d, a) * _side(c, d, b) < 0.0


def _side(a: Place, b: Place, p: Place) -> float:
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
