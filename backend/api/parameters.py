"""Parameters of a vehicle's autopilot, by name."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query

from backend.api.access import the_station
from backend.link.events import ParameterNews
from backend.link.parameters import MAX_NAME
from backend.schemas.parameters import ParameterBody, ParameterChange
from backend.station import Station

router = APIRouter(prefix="/api/v1/vehicles/{vehicle_id}/parameters", tags=["parameters"])

TheStation = Annotated[Station, Depends(the_station)]
Name = Annotated[str, Path(min_length=1, max_length=MAX_NAME, pattern="^[A-Za-z0-9_]+$")]


@router.get("")
async def get_parameters(
    vehicle_id: str, station: TheStation, name: Annotated[list[str], Query(min_length=1, max_length=64)]
) -> list[ParameterBody]:
    """What the vehicle says of each ``name``; it takes seconds where it has none of that name."""
    news = await station.aidings.parameters.read(station.live_vehicle(vehicle_id), name)
    return [_body(one) for one in news]


@router.put("/{name}")
async def put_parameter(
    vehicle_id: str, name: Name, change: ParameterChange, station: TheStation
) -> ParameterBody:  # fmt: skip
    """Change a parameter; it is changed when this returns, as the vehicle has said what it holds then."""
    vehicle = station.live_vehicle(vehicle_id)
    return _body(await station.aidings.parameters.write(vehicle, name, change.value, armed=change.armed))


def _body(news: ParameterNews) -> ParameterBody:
    return ParameterBody(asked=news.asked, name=news.name, value=news.value, status=news.status.value, text=news.text)
