"""One MAVLink endpoint: a transport for the bytes, a `VehicleLink` for the thinking, and the clock between them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import structlog

from backend.clock import unix_us
from backend.errors import StartError
from backend.fleet.fleet import Fleet
from backend.link.events import LinkEvent
from backend.link.framing import RawPacket
from backend.link.link import VehicleLink
from backend.metrics import Metrics
from backend.transports import Transport, TransportError, create_transport

TICK_S = 0.1

_log = structlog.get_logger(__name__)


class LinkEndpoint:
    """Lives on the event loop. ``on_packet(t_unix_us, data)`` sees every packet as received."""

    def __init__(
        self, connection: str, fleet: Fleet, metrics: Metrics, on_packet: Callable[[int, bytes], None]
    ) -> None:
        self.name = connection
        self._on_packet = on_packet
        self._packets = metrics.packets.labels(connection)
        self._noise = metrics.noise.labels(connection)
        self.link = VehicleLink(on_packet=self._record)
        self._fleet = fleet
        self._tick: asyncio.Task[None] | None = None
        try:
            self._transport: Transport = create_transport(connection)
        except TransportError as error:
            raise StartError(f"--mavlink: {error}") from None

    async def start(self) -> None:
        """Open the transport and begin to tick; StartError when the endpoint cannot be had at all."""
        try:
            await self._transport.open(self._receive)
        except (TransportError, OSError) as error:
            raise StartError(f"--mavlink '{self.name}': {error}") from None
        self._tick = asyncio.create_task(self._run())

    async def close(self) -> None:
        """Stop and close."""
        if self._tick is not None:
            self._tick.cancel()
            await asyncio.gather(self._tick, return_exceptions=True)
            self._tick = None
        await self._transport.close()

    def waiting_for(self) -> str | None:
        """What does not come yet, None when vehicles are heard."""
        if self.link.vehicles:
            return None
        return f"MAVLink: {self._transport.status}"

    def station_time_us(self, system_id: int, t_vehicle_unix_us: int) -> int | None:
        """Station time of a stamp on a vehicle's Unix clock, None while that clock is not known."""
        return self.link.station_time_of(system_id, t_vehicle_unix_us)

    def send_soon(self) -> None:
        """Send what waits now instead of at the next tick."""
        self._take(self.link.tick(unix_us()))

    def _receive(self, data: bytes) -> None:
        self._take(self.link.receive(data, unix_us()))

    def _take(self, events: list[LinkEvent]) -> None:
        for event in events:
            self._fleet.take(self.name, event)
        for packet in self.link.data_to_send():
            self._transport.write(packet)

    def _record(self, packet: RawPacket, t_unix_us: int) -> None:
        self._packets.inc()
        self._on_packet(t_unix_us, packet.data)

    async def _run(self) -> None:
        while True:
            self.send_soon()
            self._noise.set(self.link.noise_bytes)
            await asyncio.sleep(TICK_S)
