"""Flights: list, delete, replay in the browser."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends
from fastapi.responses import HTMLResponse

from backend.api.access import the_station
from backend.errors import ConflictError
from backend.flights import FlightEntry
from backend.schemas.vehicles import FlightBody, ReplayBody, ReplayChange, ReplayRequest
from backend.station import Station

router = APIRouter(prefix="/api/v1", tags=["flights"])

REPORT_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"

TheStation = Annotated[Station, Depends(the_station)]


@router.get("/flights")
async def list_flights(station: TheStation) -> list[FlightBody]:
    """All flights, the newest first; a folder that cannot be used is listed with its problem."""
    entries = await asyncio.to_thread(station.flights.all)
    return [_body(entry, station) for entry in entries]


@router.get("/flights/{flight_id}")
async def get_flight(flight_id: str, station: TheStation) -> FlightBody:
    """One flight."""
    return _body(await asyncio.to_thread(station.flights.get, flight_id), station)


@router.get("/flights/{flight_id}/report", response_class=HTMLResponse)
async def get_report(flight_id: str, station: TheStation) -> HTMLResponse:
    """One page that holds everything: map, errors, targets with pictures, plots. It asks nothing of any network."""
    page = await station.replays.report(flight_id, station.targets.all())
    # It has no scripts, and none that came in by a name would run.
    return HTMLResponse(page, headers={"Content-Security-Policy": REPORT_POLICY})


@router.delete("/flights/{flight_id}", status_code=HTTPStatus.NO_CONTENT)
async def delete_flight(flight_id: str, station: TheStation) -> None:
    """Remove a recorded flight from the disk."""
    if station.recorder.flight_id == flight_id:
        raise ConflictError(f"flight '{flight_id}' is being recorded: stop the recording first")
    if station.replays.of_flight(flight_id) is not None:
        raise ConflictError(f"flight '{flight_id}' is being replayed: end the replay first")
    await asyncio.to_thread(station.flights.delete, flight_id)


@router.post("/flights/{flight_id}/replay", status_code=HTTPStatus.CREATED)
async def start_replay(flight_id: str, body: ReplayRequest, station: TheStation) -> ReplayBody:
    """Replay a flight as vehicle ``replay-<flight id>``; one that runs already begins anew."""
    return await station.start_replay(flight_id, body.speed, body.start_s)


@router.get("/replays")
async def list_replays(station: TheStation) -> list[ReplayBody]:
    """Running replays."""
    return station.replays.bodies()


@router.patch("/replays/{vehicle_id}")
async def change_replay(vehicle_id: str, body: ReplayChange, station: TheStation) -> ReplayBody:
    """Pause, go on, change speed, seek."""
    return station.replays.change(vehicle_id, body)


@router.delete("/replays/{vehicle_id}", status_code=HTTPStatus.NO_CONTENT)
async def end_replay(vehicle_id: str, station: TheStation) -> None:
    """End a replay."""
    await station.replays.end(vehicle_id)


def _body(entry: FlightEntry, station: Station) -> FlightBody:
    return FlightBody(
        id=entry.id, name=entry.name, start_unix_us=entry.start_unix_us, duration_s=entry.duration_s,
        bytes=entry.bytes, has_video=entry.has_video, has_truth=entry.has_truth, read_only=entry.read_only,
        recording=station.recorder.flight_id == entry.id, warnings=list(entry.warnings), problem=entry.problem,
    )  # fmt: skip
