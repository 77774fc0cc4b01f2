"""Maps: import, list, show as tiles."""

from __future__ import annotations

import asyncio
import math
import re
import tempfile
from dataclasses import asdict
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Form, Response, UploadFile

from backend.api.access import the_station
from backend.errors import InvalidRequestError
from backend.schemas.vehicles import MapBody, MatchabilityBody, MatchabilityRequest
from backend.station import Station
from geodata.errors import RasterError
from geodata.matchability import MatchabilitySummary

router = APIRouter(prefix="/api/v1/maps", tags=["maps"])

TheStation = Annotated[Station, Depends(the_station)]
CHUNK_BYTES = 1 << 20
MAX_NAME_BYTES = 120  # file systems take 255 for a whole name


@router.get("")
async def list_maps(station: TheStation) -> list[MapBody]:
    """All maps of the library, those imported by the command line meanwhile included."""
    await station.maps.refresh()
    return station.maps.bodies()


@router.post("", status_code=HTTPStatus.CREATED)
async def import_map(
    station: TheStation, file: UploadFile, name: Annotated[str | None, Form(max_length=200)] = None,
    kind: Annotated[Literal["imagery", "elevation"] | None, Form()] = None,
) -> MapBody:  # fmt: skip
    """Upload a georeferenced raster (GeoTIFF of any CRS); it becomes a map layer and the matcher's reference."""
    given = name_of_upload(file.filename)
    station.maps_inbox.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=station.maps_inbox) as folder:
        path = Path(folder) / given
        with path.open("wb") as out:
            while chunk := await file.read(CHUNK_BYTES):
                await asyncio.to_thread(out.write, chunk)
        try:
            return await station.import_map(path, name or Path(given).stem, kind)
        except RasterError as error:
            # The client knows its file by its own name; where it lay here meanwhile is nobody's concern.
            problem = error.problem.replace(str(path), given).replace(folder, "")
            raise type(error)(Path(given), problem, error.remedy) from None


def name_of_upload(filename: str | None) -> str:
    """A file name that leads nowhere else, from whatever a client calls its file (a path of its own system too)."""
    name = re.sub(r"[\x00-\x1f\x7f]", "", re.split(r"[/\\]", filename or "")[-1]).strip()
    stem, suffix = Path(name).stem, Path(name).suffix[:10]
    stem = stem.encode()[: MAX_NAME_BYTES - len(suffix.encode())].decode(errors="ignore")
    return stem + suffix if stem.strip(". ") else "map.tif"


@router.get("/{map_id}")
async def get_map(map_id: str, station: TheStation) -> MapBody:
    """One map."""
    return station.maps.body(map_id)


@router.delete("/{map_id}", status_code=HTTPStatus.NO_CONTENT)
async def delete_map(map_id: str, station: TheStation) -> None:
    """Remove a map from the library; an estimator that uses it keeps its copy in memory."""
    await station.delete_map(map_id)


@router.get(
    "/{map_id}/tiles/{z}/{x}/{y}.png",
    response_class=Response, responses={200: {"content": {"image/png": {}}}},
)  # fmt: skip
async def get_tile(map_id: str, z: int, x: int, y: int, station: TheStation) -> Response:
    """A Web-Mercator tile of 256 pixels, transparent where the map does not reach."""
    try:
        content = await station.maps.tile(map_id, z, x, y)
    except ValueError as error:
        raise InvalidRequestError(str(error)) from None
    return Response(content, media_type="image/png", headers={"Cache-Control": "max-age=3600"})


@router.post("/{map_id}/matchability", status_code=HTTPStatus.CREATED)
async def predict_matchability(
    map_id: str, station: TheStation, wanted: MatchabilityRequest | None = None
) -> MatchabilityBody:
    """Predict how well each place of a map can be matched; takes seconds for each square kilometre."""
    wanted = wanted or MatchabilityRequest()
    summary = await station.maps.predict_matchability(map_id, wanted.footprint_m, wanted.radius_m)
    return _body_of_summary(map_id, summary)


@router.get("/{map_id}/matchability")
async def get_matchability(map_id: str, station: TheStation) -> MatchabilityBody:
    """What was predicted for a map."""
    return _body_of_summary(map_id, await station.maps.matchability(map_id))


@router.get(
    "/{map_id}/matchability/{z}/{x}/{y}.png",
    response_class=Response, responses={200: {"content": {"image/png": {}}}},
)  # fmt: skip
async def get_matchability_tile(map_id: str, z: int, x: int, y: int, station: TheStation) -> Response:
    """A tile of the layer: green to red by sigma, violet where patterns repeat, grey where texture lacks."""
    try:
        content = await station.maps.matchability_tile(map_id, z, x, y)
    except ValueError as error:
        raise InvalidRequestError(str(error)) from None
    return Response(content, media_type="image/png", headers={"Cache-Control": "no-cache"})


def _body_of_summary(map_id: str, summary: MatchabilitySummary) -> MatchabilityBody:
    values = asdict(summary)
    # JSON has no NaN
    median = values["median_sigma_m"]
    return MatchabilityBody(map_id=map_id, **{**values, "median_sigma_m": median if math.isfinite(median) else None})
