"""Recording: on, off, how far."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Depends

from backend.api.access import the_station
from backend.schemas.vehicles import RecordingBody, RecordingRequest
from backend.station import Station

router = APIRouter(prefix="/api/v1/recording", tags=["recording"])

TheStation = Annotated[Station, Depends(the_station)]


@router.get("")
async def get_recording(station: TheStation) -> RecordingBody:
    """What the recorder does."""
    return RecordingBody(**asdict(station.recorder.status))


@router.post("")
async def set_recording(body: RecordingRequest, station: TheStation) -> RecordingBody:
    """Start or stop recording. When a stop answers, the flight is complete on the disk."""
    if body.active:
        await station.start_recording(body.name)
    else:
        await station.stop_recording()
    return RecordingBody(**asdict(station.recorder.status))
