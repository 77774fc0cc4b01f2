"""Vehicles: what they are, where they are and were, what they are told."""

from __future__ import annotations

import asyncio
from typing import Annotated

import orjson
from fastapi import APIRouter, Depends, Query, Response

from backend.api.access import the_station
from backend.errors import NoStateYetError
from backend.fleet.vehicle import TrackSource, VehicleView
from backend.link.aiding import AidingForm
from backend.schemas.geometry import TrackCollection, TrackFeature, collection_of_tracks
from backend.schemas.history import HistoryBody
from backend.schemas.vehicles import (
    CommandAccepted,
    CommandBody,
    NavigationAnswer,
    NavigationBody,
    StateBody,
    VehicleBody,
)
from backend.station import Station

router = APIRouter(prefix="/api/v1/vehicles", tags=["vehicles"])

TheStation = Annotated[Station, Depends(the_station)]


@router.get("")
async def list_vehicles(station: TheStation) -> list[VehicleBody]:
    """All vehicles heard so far, and running replays."""
    return [VehicleBody(**vehicle.summary()) for vehicle in station.vehicles()]


@router.get("/{vehicle_id}")
async def get_vehicle(vehicle_id: str, station: TheStation) -> VehicleBody:
    """One vehicle."""
    return VehicleBody(**station.vehicle(vehicle_id).summary())


@router.get("/{vehicle_id}/state")
async def get_state(vehicle_id: str, station: TheStation) -> StateBody:
    """Where a vehicle is, with its uncertainty; the fields of the stream's ``state`` message."""
    state = station.vehicle(vehicle_id).state_message()
    if state is None:
        raise NoStateYetError(vehicle_id)
    return StateBody(**state)


@router.get("/{vehicle_id}/tracks")
async def get_tracks(
    vehicle_id: str, station: TheStation, source: TrackSource | None = None,
    since_us: Annotated[int, Query(ge=0)] = 0,
) -> TrackCollection:  # fmt: skip
    """Where a vehicle was in the last hour, after ``since_us``; all sources when none is named."""
    vehicle = station.vehicle(vehicle_id)
    sources = (source,) if source else ("gps", "vision")
    return TrackCollection(features=[piece for name in sources for piece in _pieces(vehicle, name, since_us)])


@router.get("/{vehicle_id}/history", response_model=HistoryBody)
async def get_history(
    vehicle_id: str, station: TheStation,
    since_us: Annotated[int, Query(ge=0)] = 0,
    step_us: Annotated[int, Query(ge=0, le=60_000_000)] = 0,
) -> Response:  # fmt: skip
    """What the stream said of a vehicle in the last hour, after ``since_us``: states and GPS five times a second at
    most, or once in ``step_us``; every attempt at a fix; alarms and landings. Of a replay: the whole flight.
    """
    body = await station.history(vehicle_id, since_us, step_us)
    # Hundreds of thousands of numbers that the station has just made: to validate them again takes the loop's time.
    return Response(await asyncio.to_thread(orjson.dumps, body), media_type="application/json")


@router.post("/{vehicle_id}/navigation")
async def set_navigation(vehicle_id: str, body: NavigationBody, station: TheStation) -> NavigationAnswer:
    """Keep GPS from the estimator or give it back; tell the autopilot where it is, or end that."""
    vehicle = station.live_vehicle(vehicle_id)
    if body.aiding == "off":
        station.aidings.end(vehicle)
    if body.gps_denied is not None:
        if not body.gps_denied:
            station.aidings.check_gps_may_return(vehicle)
        station.deny_gps(vehicle_id, body.gps_denied)
    if body.aiding is not None and body.aiding != "off":
        station.aidings.begin(vehicle, AidingForm(body.aiding), body.page)
    told = station.aidings.message(vehicle)
    return NavigationAnswer(gps_denied=vehicle.gps_denied, aiding=told["form"] or "off")


@router.post("/{vehicle_id}/commands", status_code=202)
async def send_command(vehicle_id: str, body: CommandBody, station: TheStation) -> CommandAccepted:
    """Send a command; how it ended follows as an ``ack`` message on the stream."""
    return CommandAccepted(command_id=station.command(vehicle_id, body))


def _pieces(vehicle: VehicleView, source: str, since_us: int) -> list[TrackFeature]:
    # There is one estimate; what it is made of, the mode says.
    ring = vehicle.tracks["vision" if source == "fused" else source]
    return collection_of_tracks(ring.pieces(since_us), source, vehicle.id).features
