"""``pilotage map-offset``: the reference image's displacement from targets that were surveyed."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from backend.errors import StationError
from estimator.geometry.local import LocalFrame
from estimator.targets.map_offset import map_offset

# CE90 of a circular normal distribution in its standard deviations
CE90_SIGMAS = 2.146
LEAST_STD_M = 0.01


@dataclass(frozen=True, slots=True)
class Place:
    """A named place, WGS 84, with its CE90; NaN where the table has none."""

    lat_deg: float
    lon_deg: float
    ce90_m: float


def read_places(path: Path) -> dict[str, Place]:
    """The places of a table with the columns ``target,lat_deg,lon_deg`` and perhaps ``ce90_m``.

    Raises
    ------
    StationError
        The file cannot be read, lacks a column, or holds what is no coordinate.
    """
    found: dict[str, Place] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for number, row in enumerate(csv.DictReader(file), 2):
                found[_text(row, "target")] = _place(row, f"{path}, line {number}")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise StationError(f"{path}: cannot be read: {error}") from None
    except KeyError as error:
        raise StationError(f"{path}: has no column {error}; target, lat_deg and lon_deg are needed") from None
    return found


def _text(row: dict[str, str | None], column: str) -> str:
    return row[column] or ""


def _place(row: dict[str, str | None], where: str) -> Place:
    try:
        lat, lon = float(_text(row, "lat_deg")), float(_text(row, "lon_deg"))
        ce90 = float(row.get("ce90_m") or "nan")
    except ValueError as error:
        raise StationError(f"{where}: {error}") from None
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0) or ce90 < 0.0:
        raise StationError(f"{where}: ({lat:g}, {lon:g}) is no coordinate, or the CE90 is negative")
    return Place(lat, lon, ce90)


def calibrate(
    surveyed: Annotated[Path, typer.Argument(help="Surveyed points: target,lat_deg,lon_deg and perhaps ce90_m.")],
    found: Annotated[Path, typer.Argument(help="The same targets as located on the map: a targets.csv of a replay.")],
    std_m: Annotated[
        float, typer.Option(min=0.01, help="Of a surveyed point on each axis, where the table has no ce90_m.")
    ] = 1.0,
) -> None:
    """Say how far the reference image is displaced, by targets whose coordinates were surveyed.

    What is printed is added to map.offset_ne_m of flight.json. Example: pilotage map-offset survey.csv out/targets.csv
    """
    try:
        there, here = read_places(surveyed), read_places(found)
        names = sorted(there.keys() & here.keys())
        differences, variances = [], []
        for name in names:
            local = LocalFrame(math.radians(here[name].lat_deg), math.radians(here[name].lon_deg), 0.0)
            differences.append(
                local.ne_from_geodetic(math.radians(there[name].lat_deg), math.radians(there[name].lon_deg))
            )
            variances.append(_std_m(there[name], std_m) ** 2 + _std_m(here[name], std_m) ** 2)
        try:
            offset = map_offset(np.array(differences).reshape(-1, 2), np.array(variances)[:, None, None] * np.eye(2))
        except ValueError as error:
            raise StationError(f"{len(names)} targets are in both files: {error}") from None
    except StationError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None
    north, east = offset.offset_ne_m
    std = np.sqrt(np.diag(offset.cov_ne_m2))
    typer.echo(f"offset_ne_m to add: [{north:.2f}, {east:.2f}], sigma {std[0]:.2f} and {std[1]:.2f} m")
    typer.echo(f"{len(names)} points, misfit {offset.misfit:.2f}" + (": more than stated" if offset.misfit > 2 else ""))
    for name, weight, d in zip(names, offset.weights, differences, strict=True):
        if weight < 0.3:
            left = d - offset.offset_ne_m
            typer.echo(f"does not fit: {name}, {left[0]:.2f} m north and {left[1]:.2f} m east of the rest")


def _std_m(place: Place, otherwise_m: float) -> float:
    return max(place.ce90_m / CE90_SIGMAS, LEAST_STD_M) if math.isfinite(place.ce90_m) else otherwise_m
