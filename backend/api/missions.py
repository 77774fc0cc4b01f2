"""Mission plans: kept for a vehicle, as files, and to and from the vehicle itself."""

from __future__ import annotations

import asyncio
import re
from http import HTTPStatus
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Header, Query, Request, Response

from backend.api.access import the_station
from backend.errors import InvalidRequestError, NoPlanError, PlanFileError, UnknownVehicleError
from backend.link.events import Autopilot, VehicleType
from backend.missions.path import path_of
from backend.missions.plan import Plan
from backend.missions.plan_file import MAX_BYTES, write_plan
from backend.missions.service import rule_of
from backend.missions.shelf import ALWAYS, Condition, etag_of
from backend.schemas.missions import DownloadRequest, PartName, PlanBody, UploadRequest, kinds_of, plan_body
from backend.schemas.plan_path import PathFeature, no_path, path_feature
from backend.schemas.vehicles import CommandAccepted
from backend.station import Station

router = APIRouter(prefix="/api/v1/vehicles/{vehicle_id}/plan", tags=["missions"])

TheStation = Annotated[Station, Depends(the_station)]
IfMatch = Annotated[str | None, Header(description="The ETag that the kept plan must still have, or *: any plan")]
IfNoneMatch = Annotated[str | None, Header(description="*: only where no plan is kept yet")]
JSON = "application/json"
_TAG = re.compile(r'"([\x21\x23-\x7e]{0,100})"')
_BODY = {
    "requestBody": {
        "required": True, "description": "A QGroundControl plan (JSON), or a waypoint file (QGC WPL 110)",
        "content": {JSON: {"schema": {"type": "object"}}, "text/plain": {"schema": {"type": "string"}}},
    }
}  # fmt: skip


@router.get("", response_model=PlanBody)
async def get_plan(
    vehicle_id: str, station: TheStation, response: Response,
    format: Annotated[Literal["plan"] | None, Query(description="plan: the QGroundControl file")] = None,
) -> PlanBody | Response:  # fmt: skip
    """The plan kept for a vehicle, or its file: what was put, with what is not understood here.

    Its ``ETag`` changes with its content.
    """
    plan = await station.missions.plan(_id(vehicle_id, station))
    etag = await asyncio.to_thread(etag_of, plan)
    if format is None:
        response.headers["ETag"] = f'"{etag}"'
        return await _shown(vehicle_id, plan, station)
    headers = {
        "ETag": f'"{etag}"', "Content-Disposition": f'attachment; filename="vehicle-{vehicle_id}.plan"',
    }  # fmt: skip
    return Response(await asyncio.to_thread(write_plan, plan), media_type=JSON, headers=headers)


@router.get("/path")
async def get_path(vehicle_id: str, station: TheStation) -> PathFeature:
    """The kept plan as it would be flown: speed, radius, height and time along it, and what should be looked at.

    A GeoJSON feature without geometry where there is nothing to fly; its ``etag`` is null where no plan is kept.
    """
    try:
        plan = await station.missions.plan(_id(vehicle_id, station))
    except NoPlanError:
        return no_path(vehicle_id)
    vehicle = station.fleet.vehicles.get(vehicle_id)
    rule = rule_of(Autopilot.OTHER if vehicle is None else vehicle.autopilot)
    kind = VehicleType.OTHER if vehicle is None else vehicle.vehicle_type
    return await asyncio.to_thread(
        lambda: path_feature(vehicle_id, etag_of(plan), plan.warnings(rule), path_of(plan, kind, rule))
    )


@router.put("", openapi_extra=_BODY)
async def put_plan(
    vehicle_id: str, request: Request, station: TheStation, response: Response,
    if_match: IfMatch = None, if_none_match: IfNoneMatch = None,
) -> PlanBody:  # fmt: skip
    """Keep a plan for a vehicle, heard or not. It is sent by ``POST …/plan/upload`` only.

    With ``If-Match`` or ``If-None-Match: *`` it is kept only in place of what the sender has seen, else 412.
    """
    key = _id(vehicle_id, station)
    condition = condition_of(if_match, if_none_match)
    content = bytearray()
    async for chunk in request.stream():
        content += chunk
        if len(content) > MAX_BYTES:
            raise PlanFileError("plan", f"a plan has at most {MAX_BYTES} bytes")
    plan = await station.missions.keep(key, bytes(content), condition)
    response.headers["ETag"] = f'"{await asyncio.to_thread(etag_of, plan)}"'
    return await _shown(vehicle_id, plan, station)


@router.delete("", status_code=HTTPStatus.NO_CONTENT)
async def delete_plan(vehicle_id: str, station: TheStation, if_match: IfMatch = None) -> None:
    """Keep no plan for a vehicle; what the vehicle itself holds stays. ``If-Match`` as when keeping one."""
    await station.missions.remove(_id(vehicle_id, station), condition_of(if_match))


@router.post("/upload", status_code=HTTPStatus.ACCEPTED)
async def upload_plan(vehicle_id: str, station: TheStation, body: UploadRequest | None = None) -> CommandAccepted:
    """Send the kept plan to the vehicle and read it back; ``ack`` messages on the stream say how that goes and ends."""
    parts = None if body is None or body.parts is None else kinds_of(body.parts)
    return CommandAccepted(command_id=await station.missions.upload(station.live_vehicle(vehicle_id), parts))


@router.post("/download", status_code=HTTPStatus.ACCEPTED)
async def download_plan(vehicle_id: str, station: TheStation, body: DownloadRequest | None = None) -> CommandAccepted:
    """Fetch what the vehicle holds and keep it as its plan; ``ack`` messages on the stream say how that ends."""
    replace = body is not None and body.replace
    vehicle = station.live_vehicle(vehicle_id)
    return CommandAccepted(command_id=await station.missions.download(vehicle, replace=replace))


@router.post("/compare", status_code=HTTPStatus.ACCEPTED)
async def compare_plan(vehicle_id: str, station: TheStation) -> CommandAccepted:
    """Read what the vehicle holds and compare it with the kept plan; the last ``ack`` says ``same``, and how not."""
    return CommandAccepted(command_id=await station.missions.check(station.live_vehicle(vehicle_id)))


@router.delete("/vehicle", status_code=HTTPStatus.ACCEPTED)
async def clear_vehicle(
    vehicle_id: str, station: TheStation,
    parts: Annotated[list[PartName] | None, Query(description="what to clear; the mission when not given")] = None,
) -> CommandAccepted:  # fmt: skip
    """Clear what the vehicle itself holds; ``ack`` messages on the stream say how that ends."""
    kinds = kinds_of(parts or ["mission"])
    return CommandAccepted(command_id=station.missions.clear(station.live_vehicle(vehicle_id), kinds))


def condition_of(if_match: str | None, if_none_match: str | None = None) -> Condition:
    """What two headers ask of the kept plan (RFC 9110, section 13.1); InvalidRequestError where they cannot be read."""
    if if_none_match is not None:
        if if_none_match.strip() != "*" or if_match is not None:
            raise InvalidRequestError("If-None-Match takes * only here, and no If-Match beside it")
        return Condition(absent=True)
    if if_match is None:
        return ALWAYS
    if if_match.strip() == "*":
        return Condition(present=True)
    tags = [_TAG.fullmatch(tag.strip()) for tag in if_match.split(",")]
    if any(tag is None for tag in tags):
        raise InvalidRequestError(f'If-Match {if_match[:80]!r} is no list of ETags, such as "3f0c"')
    return Condition(frozenset(tag.group(1) for tag in tags if tag is not None))


def _id(vehicle_id: str, station: Station) -> str:
    """A vehicle's id: one that was heard, or a system id that may be heard later."""
    if re.fullmatch(r"[1-9][0-9]{0,2}", vehicle_id) and int(vehicle_id) <= 255:
        return vehicle_id
    station.live_vehicle(vehicle_id)
    raise UnknownVehicleError(vehicle_id)


async def _shown(vehicle_id: str, plan: Plan, station: Station) -> PlanBody:
    vehicle = station.fleet.vehicles.get(vehicle_id)
    rule = rule_of(Autopilot.OTHER if vehicle is None else vehicle.autopilot)
    return await asyncio.to_thread(plan_body, vehicle_id, plan, rule)
