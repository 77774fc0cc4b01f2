"""The stream: everything that happens, as JSON messages over one WebSocket."""

from __future__ import annotations

import asyncio
import contextlib

import orjson
import structlog
from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from backend.api.access import station_of_socket
from backend.hub import Mailbox
from backend.station import Station

router = APIRouter()
_log = structlog.get_logger(__name__)

INTERNAL_ERROR = 1011
TRY_AGAIN_LATER = 1013
MAX_CLIENT_TEXT = 4096
CLOSE_TIMEOUT_S = 1.0


@router.websocket("/api/v1/stream")
async def stream(socket: WebSocket, page: str = "") -> None:
    """Send hello, then every message; a client that reads too slowly is closed with 1013 and may come back.

    A ``page`` that names itself may begin what ends when it goes away.
    """
    station = station_of_socket(socket)
    await socket.accept()
    mailbox = station.hub.open()
    station.metrics.clients.inc()
    station.guided.pages.opened(page)
    try:
        # Opened first: what happens while hello is prepared follows it and is not missed.
        hello = await station.hello()
        await socket.send_text(station.hub.message("hello", **hello).text)
        await _both_ways(socket, mailbox, station, page)
    except WebSocketDisconnect:
        pass
    except Exception:  # one client's stream fails: say where, and let that client come back
        _log.exception("stream failed")
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            await socket.close(INTERNAL_ERROR, "the station failed to serve this stream")
    finally:
        station.hub.close(mailbox)
        station.guided.pages.closed(page)
        station.metrics.clients.dec()


async def _both_ways(socket: WebSocket, mailbox: Mailbox, station: Station, page: str) -> None:
    async with contextlib.AsyncExitStack() as stack:
        # A client that stopped reading blocks the sender inside the socket: the overflow has to end that from outside.
        tasks = [
            asyncio.create_task(_send(socket, mailbox)),
            asyncio.create_task(_receive(socket, mailbox, station, page)),
            asyncio.create_task(_overflow(mailbox)),
        ]
        stack.push_async_callback(_end, tasks)
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    if mailbox.overflowed:
        station.metrics.clients_dropped.inc()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
            await asyncio.wait_for(socket.close(TRY_AGAIN_LATER, "read too slowly"), CLOSE_TIMEOUT_S)


async def _send(socket: WebSocket, mailbox: Mailbox) -> None:
    while True:
        for text in await mailbox.take():
            await socket.send_text(text)


async def _overflow(mailbox: Mailbox) -> None:
    await mailbox.given_up.wait()


async def _receive(socket: WebSocket, mailbox: Mailbox, station: Station, page: str) -> None:
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        station.guided.pages.heard(page)
        text = message.get("text") or ""
        if len(text) > MAX_CLIENT_TEXT:
            continue
        try:
            said = orjson.loads(text)
        except orjson.JSONDecodeError:
            continue
        if isinstance(said, dict) and said.get("type") == "ping":
            mailbox.put(station.hub.message("pong"))


async def _end(tasks: list[asyncio.Task[None]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
