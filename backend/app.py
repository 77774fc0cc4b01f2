"""Puts the service together. Nothing happens at import: `create_app` is the one place of wiring."""

from __future__ import annotations

from fastapi import FastAPI

from backend.api import (
    aiding,
    flights,
    health,
    homing,
    landing,
    locating,
    maps,
    missions,
    parameters,
    recording,
    stream,
    targets,
    vehicles,
    video,
)
from backend.api.console import add_console, default_console_dir
from backend.api.guard import OriginGuard
from backend.api.problems import PROBLEM_RESPONSES, add_problem_handlers
from backend.settings import Settings
from backend.station import Station


def create_app(settings: Settings) -> FastAPI:
    """The application of one station, ``app.state.station``; who makes it starts and stops the station."""
    station = Station(settings)

    app = FastAPI(
        title="Pilotage", version=station.version, responses=PROBLEM_RESPONSES,
        # Their pages load scripts from elsewhere; a station in the field has no elsewhere.
        docs_url=None, redoc_url=None,
    )  # fmt: skip
    app.state.station = station
    add_problem_handlers(app)
    flying = (vehicles, parameters, aiding, landing, homing, missions)
    for module in (health, *flying, locating, targets, maps, flights, recording, stream, video):
        app.include_router(module.router)
    station.has_console = add_console(app, settings.console_dir or default_console_dir())
    app.add_middleware(OriginGuard, host=settings.host)
    return app
