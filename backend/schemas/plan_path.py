"""The body that shows a plan's path."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import BaseModel

from backend.missions.path import PlanPath, ProblemKind
from estimator.types import Float

_MOST_VERTICES = 3000


class PathProblemBody(BaseModel):
    """What is wrong with a leg (``from_item`` to ``to_item``, null: home), and where that begins."""

    kind: ProblemKind
    text: str
    from_item: int | None
    to_item: int | None
    lat_deg: float | None
    lon_deg: float | None


class ArrivalBody(BaseModel):
    """How far and when a point is reached; ``item`` is null at home."""

    item: int | None
    length_m: float
    time_s: float


class PathLine(BaseModel):
    """A GeoJSON line, longitude first."""

    type: Literal["LineString"] = "LineString"
    coordinates: list[tuple[float, float]]


class PathProperties(BaseModel):
    """``etag`` is the plan's, null where none is kept; ``warnings`` are those of the plan itself.

    The lists have a number for each vertex of the line; a radius is null where nothing is turned.
    """

    vehicle_id: str
    etag: str | None
    length_m: float
    duration_s: float
    speed_m_s: list[float]
    turn_radius_m: list[float | None]
    alt_rel_m: list[float]
    time_s: list[float]
    arrivals: list[ArrivalBody]
    problems: list[PathProblemBody]
    warnings: list[str]


class PathFeature(BaseModel):
    """A GeoJSON feature; without two places to fly between it has no geometry."""

    type: Literal["Feature"] = "Feature"
    geometry: PathLine | None
    properties: PathProperties


def no_path(vehicle_id: str) -> PathFeature:
    """Of a vehicle for which no plan is kept."""
    return _feature(vehicle_id, None, [], PlanPath(None, np.zeros(0), np.zeros(0), (), ()))


def path_feature(vehicle_id: str, etag: str, warnings: list[str], planned: PlanPath) -> PathFeature:
    """A path as the API shows it, thinned to a few thousand vertices; every point of the plan stays."""
    return _feature(vehicle_id, etag, warnings, planned)


def _feature(vehicle_id: str, etag: str | None, warnings: list[str], planned: PlanPath) -> PathFeature:
    problems = [
        PathProblemBody(
            kind=p.kind, text=p.text, from_item=p.from_item, to_item=p.to_item,
            lat_deg=None if p.place_deg is None else p.place_deg[0],
            lon_deg=None if p.place_deg is None else p.place_deg[1],
        )
        for p in planned.problems
    ]  # fmt: skip
    path = planned.path
    if path is None:
        properties = PathProperties(
            vehicle_id=vehicle_id, etag=etag, length_m=0.0, duration_s=0.0, speed_m_s=[], turn_radius_m=[],
            alt_rel_m=[], time_s=[], arrivals=[], problems=problems, warnings=warnings,
        )  # fmt: skip
        return PathFeature(geometry=None, properties=properties)
    evenly = np.linspace(0, len(path.length_m) - 1, min(len(path.length_m), _MOST_VERTICES)).round().astype(int)
    kept = np.union1d(evenly, path.arrivals)
    radius_m = [None if radius > 1e5 else round(radius, 2) for radius in path.turn_radius_m[kept].tolist()]
    properties = PathProperties(
        vehicle_id=vehicle_id, etag=etag, length_m=float(path.length_m[-1]), duration_s=float(path.time_s[-1]),
        speed_m_s=_rounded(path.speed_m_s[kept]), turn_radius_m=radius_m,
        alt_rel_m=_rounded(-path.pos_ned_m[kept, 2]), time_s=_rounded(path.time_s[kept]), problems=problems,
        arrivals=[
            ArrivalBody(item=item, length_m=float(path.length_m[at]), time_s=float(path.time_s[at]))
            for item, at in zip(planned.items, path.arrivals, strict=True)
        ],
        warnings=warnings,
    )  # fmt: skip
    places = zip(planned.lon_deg[kept].tolist(), planned.lat_deg[kept].tolist(), strict=True)
    line = PathLine(coordinates=[(round(lon, 8), round(lat, 8)) for lon, lat in places])
    return PathFeature(geometry=line, properties=properties)


def _rounded(values: Float) -> list[float]:
    rounded: list[float] = np.round(values, 2).tolist()
    return rounded
