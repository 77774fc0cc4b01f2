"""The landing pad, and landing on it."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Body, Depends, Response

from backend.api.access import the_station
from backend.landing.messages import pad_body
from backend.schemas.landing import LandingBody, LandingRequest, PadBody
from backend.station import Station

router = APIRouter(prefix="/api/v1", tags=["landing"])

TheStation = Annotated[Station, Depends(the_station)]


@router.get("/pad")
async def get_pad(station: TheStation) -> PadBody:
    """The landing pad that is looked for."""
    return pad_body(station.landings.pad)


@router.put("/pad")
async def put_pad(description: Annotated[dict[str, Any], Body()], station: TheStation) -> PadBody:
    """Look for the pad of this description, the JSON file that ``pilotage pad`` writes. Estimators begin anew."""
    station.landings.change_pad(description)
    return pad_body(station.landings.pad)


@router.delete("/pad", status_code=HTTPStatus.NO_CONTENT)
async def delete_pad(station: TheStation) -> None:
    """Look for no pad."""
    station.landings.change_pad(None)


@router.get("/vehicles/{vehicle_id}/landing")
async def get_landing(vehicle_id: str, station: TheStation) -> LandingBody:
    """Where a vehicle is relative to the pad; the fields of the stream's ``landing`` message."""
    return LandingBody(**station.landings.message(station.live_vehicle(vehicle_id)))


@router.post("/vehicles/{vehicle_id}/landing")
async def ask_landing(vehicle_id: str, body: LandingRequest, station: TheStation) -> LandingBody:
    """Begin or end what helps a vehicle land. What is begun ends with the page that began it."""
    vehicle = station.live_vehicle(vehicle_id)
    station.landings.ask(vehicle, body)
    return LandingBody(**station.landings.message(vehicle))


@router.get(
    "/vehicles/{vehicle_id}/landing/view",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}, 204: {"description": "No picture has shown the pad lately"}},
)  # fmt: skip
async def get_view(vehicle_id: str, station: TheStation) -> Response:
    """The newest picture that showed the pad, as from straight above: pad's x up, y to the right, centre in the middle.

    ``X-Side-M`` is the side of the square in metres, ``X-Frame-Id`` the picture.
    """
    view = await station.landings.view(station.live_vehicle(vehicle_id))
    if view is None:
        return Response(status_code=HTTPStatus.NO_CONTENT)
    headers = {"Cache-Control": "no-store", "X-Side-M": f"{view.side_m:.6g}", "X-Frame-Id": str(view.frame_id)}
    return Response(view.jpeg, media_type="image/jpeg", headers=headers)
