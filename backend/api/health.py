"""Is it alive, is it ready, and what does it measure."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import BaseModel, ConfigDict

from backend.api.access import the_station
from backend.station import Station

router = APIRouter(tags=["health"])


class Health(BaseModel):
    """The process answers."""

    status: Literal["ok"] = "ok"
    version: str


class CotReceiver(BaseModel):
    """A receiver of targets as CoT events; ``problem`` is null while they go out, counts are since the start."""

    model_config = ConfigDict(from_attributes=True)

    destination: str
    sent: int
    failures: int
    dropped: int
    problem: str | None
    last_error: str | None


class Readiness(BaseModel):
    """Whether everything the station itself needs runs, and what it waits for from outside."""

    ready: bool
    waiting_for: list[str]
    cot: list[CotReceiver]


@router.get("/healthz")
async def healthz(station: Annotated[Station, Depends(the_station)]) -> Health:
    """The process is alive."""
    return Health(version=station.version)


@router.get("/readyz", responses={503: {"model": Readiness}})
async def readyz(station: Annotated[Station, Depends(the_station)], response: Response) -> Readiness:
    """The station accepts work; waiting for an aircraft, or for a receiver of its targets, is not a fault."""
    if not station.running:
        response.status_code = 503
    receivers = [CotReceiver.model_validate(one) for one in station.cot.states()]
    return Readiness(ready=station.running, waiting_for=station.waiting_for(), cot=receivers)


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
async def metrics(station: Annotated[Station, Depends(the_station)]) -> Response:
    """Prometheus metrics."""
    return Response(generate_latest(station.metrics.registry), media_type=CONTENT_TYPE_LATEST)
