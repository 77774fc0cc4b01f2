"""Targets: from a click on a frame, or typed in."""

from __future__ import annotations

import asyncio
import re
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Query, Response

from backend.api.access import the_station
from backend.clock import unix_us
from backend.errors import InvalidRequestError
from backend.evidence.bundle import pack
from backend.evidence.cutout import cutout
from backend.exports.formats import FORMATS, file_name
from backend.schemas.geometry import (
    NewTarget,
    TargetCollection,
    TargetFeature,
    TargetPatch,
    TrackCollection,
    collection_of_targets,
    collection_of_tracks,
    feature_of_target,
)
from backend.station import Station
from backend.store.targets import FOLLOWED, Target, TargetChange

router = APIRouter(prefix="/api/v1/targets", tags=["targets"])

TheStation = Annotated[Station, Depends(the_station)]
IfMatch = Annotated[str | None, Header(description="The ETag that the target must still have")]

ZIP, JSON = "application/zip", "application/json"
_FILES: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind.media_type.partition(";")[0]: {} for kind in FORMATS.values()}}
}


@router.get("", response_model=TargetCollection, responses=_FILES)
async def list_targets(
    station: TheStation,
    format: Annotated[str | None, Query(description=f"a file to keep: {', '.join(FORMATS)}")] = None,
) -> TargetCollection | Response:
    """All targets as a GeoJSON FeatureCollection, or as a file to keep and hand on."""
    targets = station.targets.all()
    if format is None:
        return collection_of_targets(targets)
    kind = FORMATS.get(format)
    if kind is None:
        raise InvalidRequestError(f"format '{format}' is not known: use one of {', '.join(FORMATS)}")
    now_us = unix_us()
    name = file_name(kind.ending, now_us)
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    # Two thousand targets take a second: the event loop has heartbeats to send meanwhile.
    content = await asyncio.to_thread(kind.write, targets, now_us)
    return Response(content, media_type=kind.media_type, headers=headers)


@router.post("", status_code=HTTPStatus.CREATED)
async def create_target(body: NewTarget, station: TheStation, response: Response) -> TargetFeature:
    """Locate what a pixel of a frame shows, or keep coordinates. When this answers, the target is on the disk."""
    target = await station.create_target(body)
    response.headers["ETag"] = _etag(target)
    response.headers["Location"] = f"/api/v1/targets/{target.id}"
    return feature_of_target(target)


@router.get("/{target_id}")
async def get_target(target_id: str, station: TheStation, response: Response) -> TargetFeature:
    """One target."""
    target = station.targets.get(target_id)
    response.headers["ETag"] = _etag(target)
    return feature_of_target(target)


@router.get(
    "/{target_id}/evidence", response_class=Response,
    responses={200: {"content": {ZIP: {}, JSON: {}}, "description": "A zip, or its evidence.json alone"}},
)  # fmt: skip
async def get_evidence(
    target_id: str,
    station: TheStation,
    version: Annotated[int | None, Query(description="The target's version whose coordinate is in question")] = None,
    accept: Annotated[str, Header(description="application/json gives evidence.json alone")] = ZIP,
) -> Response:
    """What the target's coordinate was computed from, for ``pilotage verify``: a zip, or its JSON without the picture.

    A target that was typed in or moved has none. That of before a move is found by its ``version``.
    """
    bundle = await station.evidence.bundle(station.targets.get(target_id), version)
    name = f"target-{target_id}-{bundle.evidence.target.version}"
    headers = {
        "Pilotage-Evidence": "proves the coordinate" if bundle.status is None else "superseded",
        "Vary": "Accept",
    }
    if preferred(accept, (ZIP, JSON)) == JSON:
        headers["Content-Disposition"] = f'attachment; filename="{name}.json"'
        return Response(bundle.document, media_type=JSON, headers=headers)
    headers["Content-Disposition"] = f'attachment; filename="{name}.zip"'
    content = await asyncio.to_thread(pack, bundle.document, bundle.picture, bundle.status, bundle.pieces)
    return Response(content, media_type=ZIP, headers=headers)


@router.get(
    "/{target_id}/picture", response_class=Response, responses={200: {"content": {"image/jpeg": {}}}}
)  # fmt: skip
async def get_picture(
    target_id: str, station: TheStation, size_px: Annotated[int, Query(ge=16, le=512)] = 128
) -> Response:
    """What was clicked: a square of the video about the pixel, as JPEG. 404 where no picture was kept."""
    target = station.targets.get(target_id)
    bundle = await station.evidence.bundle(target, station.evidence.click_version(target))
    content = await asyncio.to_thread(cutout, bundle, size_px)
    return Response(content, media_type="image/jpeg", headers={"Cache-Control": "private, max-age=3600"})


@router.get("/{target_id}/track")
async def get_track(target_id: str, station: TheStation) -> TrackCollection:
    """Where a target that is followed was seen, since that began; empty for one that is not, or before the start."""
    target = station.targets.get(target_id)
    return collection_of_tracks(station.following.track(target_id), FOLLOWED, target.vehicle_id or "")


@router.patch("/{target_id}")
async def change_target(
    target_id: str, body: TargetPatch, station: TheStation, response: Response, if_match: IfMatch = None
) -> TargetFeature:
    """Rename or move a target, follow it from its picture on (``track``), or follow it no longer.

    The evidence of a click stays, but does not prove where the target was moved or followed to.
    """
    if (body.lat_deg is None) != (body.lon_deg is None):
        raise InvalidRequestError("a new position needs both lat_deg and lon_deg")
    position = None if body.lat_deg is None or body.lon_deg is None else (body.lat_deg, body.lon_deg)
    version = _version(if_match)
    change = TargetChange(body.name, position, body.alt_amsl_m)
    if body.track is not None:
        if position is not None:
            raise InvalidRequestError("a target is either moved or followed, not both at once")
        target = await station.following.change(target_id, body.track, version)
        version = None
    if body.track is None or change != TargetChange():
        target = await station.change_target(target_id, change, version)
    response.headers["ETag"] = _etag(target)
    return feature_of_target(target)


@router.delete("/{target_id}", status_code=HTTPStatus.NO_CONTENT)
async def delete_target(target_id: str, station: TheStation, if_match: IfMatch = None) -> None:
    """Remove a target."""
    await station.delete_target(target_id, _version(if_match))


def preferred(accept: str, offered: tuple[str, ...]) -> str:
    """The offered media type that an Accept header wants most (RFC 9110, section 12.5.1); the first of equals."""
    weights: dict[str, float] = {}
    for item in accept.split(","):
        kind, *parameters = (part.strip().lower() for part in item.split(";"))
        found = next((re.fullmatch(r"q=([01](?:\.\d{0,3})?)", p) for p in parameters if p.startswith("q=")), None)
        weights[kind] = float(found.group(1)) if found else 1.0

    def weight(kind: str) -> float:
        return weights.get(kind, weights.get(kind.split("/", maxsplit=1)[0] + "/*", weights.get("*/*", 0.0)))

    return max(offered, key=weight)


def _etag(target: Target) -> str:
    return f'"{target.version}"'


def _version(if_match: str | None) -> int | None:
    if if_match is None or if_match.strip() == "*":
        return None
    found = re.fullmatch(r'\s*"(\d{1,9})"\s*', if_match)
    if found is None:
        raise InvalidRequestError(f'If-Match {if_match!r} is not an ETag of a target, such as "3"')
    return int(found.group(1))
