"""How endpoints reach the station they belong to."""

from __future__ import annotations

from fastapi import Request, WebSocket

from backend.station import Station


def the_station(request: Request) -> Station:
    """The station of the application that serves this request."""
    station: Station = request.app.state.station
    return station


def station_of_socket(socket: WebSocket) -> Station:
    """The station of the application that serves this socket."""
    station: Station = socket.app.state.station
    return station
