"""Is it alive, is it ready, and what does it measure."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import BaseModel

from backend.api.access import the_station
from backend.station import Station

router = APIRouter(tags=["health"])


class Health(BaseModel):
    """The process answers."""

    status: Literal["ok"] = "ok"
    version: str


class Readiness(BaseModel):
    """Whether everything the station itself needs runs, and what it waits for from outside."""

    ready: bool
    waiting_for: list[str]


@router.get("/healthz")
async def healthz(station: Annotated[Station, Depends(the_station)]) -> Health:
    """The process is alive."""
    return Health(version=station.version)


@router.get("/readyz", responses={503: {"model": Readiness}})
async def readyz(station: Annotated[Station, Depends(the_station)], response: Response) -> Readiness:
    """The station accepts work; waiting for an aircraft is not a fault."""
    if not station.running:
        response.status_code = 503
    return Readiness(ready=station.running, waiting_for=station.waiting_for())


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
async def metrics(station: Annotated[Station, Depends(the_station)]) -> Response:
    """Prometheus metrics."""
    return Response(generate_latest(station.metrics.registry), media_type=CONTENT_TYPE_LATEST)
