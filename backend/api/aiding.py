"""Telling an autopilot's own filter where the vehicle is: whether it can be, and how it stands."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends

from backend.api.access import the_station
from backend.link.aiding import AidingForm
from backend.schemas.aiding import AidingCheckBody, FormName
from backend.station import Station

router = APIRouter(prefix="/api/v1/vehicles/{vehicle_id}/aiding", tags=["aiding"])

TheStation = Annotated[Station, Depends(the_station)]


@router.get("")
async def get_aiding(vehicle_id: str, station: TheStation, form: FormName | None = None) -> AidingCheckBody:
    """Whether the autopilot's parameters allow a form, and how it stands; it is turned on and off by ``navigation``.

    The parameters are asked of the vehicle each time, which takes seconds where it does not know one.
    """
    vehicle = station.live_vehicle(vehicle_id)
    return AidingCheckBody(**await station.aidings.check(vehicle, None if form is None else AidingForm(form)))
