"""Runs a real station on a free loopback port inside the test's event loop."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import orjson
import uvicorn
import websockets

from backend.app import create_app
from backend.server import address_of, listening_socket
from backend.settings import load_settings
from backend.station import Station

PATIENCE_S = 60.0


@dataclass(frozen=True, slots=True)
class RunningStation:
    station: Station
    address: str
    client: httpx.AsyncClient

    @property
    def sockets(self) -> str:
        return self.address.replace("http://", "ws://")

    def stream(self, page: str = "", **options: Any) -> Any:
        # With a bounded queue an unread client does not see the answer to its own farewell, and waits 10 s for it.
        query = f"?page={page}" if page else ""
        return websockets.connect(
            f"{self.sockets}/api/v1/stream{query}", **{"max_size": None, "max_queue": None, **options}
        )

    def video(self, source: str) -> Any:
        """A viewer; ``source`` may have a query."""
        return websockets.connect(f"{self.sockets}/api/v1/video/{source}", max_size=None, max_queue=None)


class _Server(uvicorn.Server):
    @contextlib.contextmanager
    def capture_signals(self) -> Any:
        yield


@contextlib.asynccontextmanager
async def running_station(data_dir: Path, **options: Any) -> AsyncIterator[RunningStation]:
    """A station with neither links nor video unless told so."""
    options = {"mavlink": (), "video": "none", "port": 0, "console_dir": data_dir / "no-console", **options}
    settings = load_settings(data_dir=data_dir, **options)
    app = create_app(settings)
    station: Station = app.state.station
    with listening_socket("127.0.0.1", 0) as listener:
        await station.start()
        server = _Server(uvicorn.Config(app, lifespan="off", log_level="error", ws_per_message_deflate=False))
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        address = address_of(listener)
        try:
            async with httpx.AsyncClient(base_url=address, timeout=PATIENCE_S) as client:
                yield RunningStation(station, address, client)
        finally:
            server.should_exit = server.force_exit = True
            await serving
            await station.stop()


async def next_of(socket: Any, *kinds: str) -> dict[str, Any]:
    """The next message of one of some types."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            message: dict[str, Any] = orjson.loads(await socket.recv())
            if message["type"] in kinds:
                return message
