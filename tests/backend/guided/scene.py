"""A station on real sockets, a scripted autopilot on its link, and a page; the test gives the estimator's states."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, ClassVar

from backend.demo import free_udp_ports
from backend.fleet.vehicle import LiveVehicle
from backend.navigation.worker import StateUpdate
from estimator.types import NavigationState
from geodata.pad_file import as_description
from tests.backend.landing.relative import PAD
from tests.backend.link.wire import ARDUPILOT, Sender, parsed
from tests.backend.station_runner import PATIENCE_S, RunningStation, next_of, running_station

PAGE = "page-of-the-test"
SET_POINT = "SET_POSITION_TARGET_LOCAL_NED"


class Pilot:
    """An autopilot that only lives: heartbeats, and what it hears."""

    def __init__(self, port: int, autopilot: int) -> None:
        self.autopilot = autopilot
        self.wire = Sender()
        self.heard: list[Any] = []
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._target = ("127.0.0.1", port)

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, self._target)

    def step(self) -> None:
        self.send(self.heartbeat())
        with contextlib.suppress(BlockingIOError):
            while True:
                for message in parsed([self._socket.recv(2048)]):
                    self.heard.append(message)
                    if message.get_type() == "COMMAND_LONG":
                        self.send(self.wire.ack(message.command, 0))

    def heartbeat(self) -> bytes:
        return self.wire.heartbeat(2, self.autopilot)

    def of(self, kind: str) -> list[Any]:
        return [message for message in self.heard if message.get_type() == kind]

    async def hears(self, kind: str, count: int = 1) -> list[Any]:
        async with asyncio.timeout(PATIENCE_S):
            while len(self.of(kind)) < count:
                await asyncio.sleep(0.01)
        return self.of(kind)

    async def live(self) -> None:
        while True:
            self.step()
            await asyncio.sleep(0.02)

    def close(self) -> None:
        self._socket.close()


class Scene:
    """A station, a vehicle on its link whose states the test gives, and a page."""

    def __init__(self, running: RunningStation, pilot: Pilot, stream: Any) -> None:
        self.running, self.pilot, self.stream = running, pilot, stream

    @property
    def vehicle(self) -> LiveVehicle:
        return self.running.station.live_vehicle("1")

    def give(self, state: NavigationState) -> None:
        """What the vehicle's estimator would do with a state."""
        self.vehicle._take_state(StateUpdate(state, self.vehicle._epoch + 1, True))

    async def ask(self, **body: Any) -> Any:
        return await self.running.client.post("/api/v1/vehicles/1/landing", json=body)


@contextlib.asynccontextmanager
async def scene(
    tmp_path: Path, autopilot: int = ARDUPILOT, *, pad: bool = True, kind: type[Pilot] = Pilot
) -> AsyncIterator[Scene]:
    (port,) = free_udp_ports(1)
    pilot = kind(port, autopilot)
    async with (
        running_station(tmp_path, mavlink=(f"udpin:127.0.0.1:{port}",)) as running,
        running.stream(page=PAGE) as stream,
    ):
        await next_of(stream, "hello")
        living = asyncio.create_task(pilot.live())
        await next_of(stream, "vehicle")
        if pad:
            assert (await running.client.put("/api/v1/pad", json=as_description(PAD))).status_code == 200
        try:
            yield Scene(running, pilot, stream)
        finally:
            living.cancel()
            await asyncio.gather(living, return_exceptions=True)
            pilot.close()


class Obedient(Pilot):
    """An autopilot that changes its mode when it is told to."""

    MODES: ClassVar = {"GUIDED": 4, "LOITER": 5, "LAND": 9}

    def __init__(self, port: int, autopilot: int) -> None:
        super().__init__(port, autopilot)
        self.mode = self.MODES["LOITER"]

    def step(self) -> None:
        heard = len(self.heard)
        super().step()
        for message in self.heard[heard:]:
            if message.get_type() == "COMMAND_LONG" and message.command == 176:
                self.mode = int(message.param2)
            if message.get_type() == "COMMAND_LONG" and message.command == 21:
                self.mode = self.MODES["LAND"]

    def heartbeat(self) -> bytes:
        return self.wire.heartbeat(2, self.autopilot, custom_mode=self.mode)


async def becomes(flown: Scene, mode: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while flown.pilot.mode != Obedient.MODES[mode]:  # type: ignore[attr-defined]
            await asyncio.sleep(0.01)
