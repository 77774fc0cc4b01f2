"""Flying home by the estimate."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends

from backend.api.access import the_station
from backend.schemas.homing import HomingBody, HomingRequest
from backend.station import Station

router = APIRouter(prefix="/api/v1/vehicles/{vehicle_id}/homing", tags=["homing"])

TheStation = Annotated[Station, Depends(the_station)]


@router.get("")
async def get_homing(vehicle_id: str, station: TheStation) -> HomingBody:
    """How a vehicle's flight home stands; the fields of the stream's ``homing`` message."""
    return HomingBody(**station.homings.message(station.live_vehicle(vehicle_id)))


@router.post("")
async def ask_homing(vehicle_id: str, body: HomingRequest, station: TheStation) -> HomingBody:
    """Show the way home (``preview``), fly it (``fly``), or end that (``abort``); a second ``abort`` ends standing.

    A flight that was begun stands still by the estimate when the page that began it goes away.
    """
    return HomingBody(**await station.homings.ask(station.live_vehicle(vehicle_id), body))
