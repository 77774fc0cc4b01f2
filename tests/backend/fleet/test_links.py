"""An endpoint: what cannot be had is told at the start, what does not come is waited for, what comes is recorded."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

import pytest

from backend.demo import free_udp_ports
from backend.errors import StartError
from backend.fleet.links import LinkEndpoint
from backend.link.events import LinkEvent
from backend.metrics import Metrics
from tests.backend.link.wire import Sender
from tests.backend.station_process import free_port

PATIENCE_S = 20.0


class Taking:
    """Takes what an endpoint says, in the fleet's place."""

    def __init__(self) -> None:
        self.events: list[LinkEvent] = []
        self.packets: list[bytes] = []
        self.metrics = Metrics()

    def take(self, _: str, event: LinkEvent) -> None:
        self.events.append(event)

    def endpoint(self, text: str) -> LinkEndpoint:
        return LinkEndpoint(text, self, self.metrics, lambda _, data: self.packets.append(data))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text", ["smoke:signals", "udpin:127.0.0.1", "serial:/dev/null:fast", "", "tcp:127.0.0.1:99999"]
)
def test_an_address_that_makes_no_sense_is_refused_before_anything_starts(text: str) -> None:
    with pytest.raises(StartError, match="--mavlink"):
        Taking().endpoint(text)


async def test_a_taken_port_is_told_with_its_address() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        text = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(StartError, match=text):
            await Taking().endpoint(text).start()


async def test_every_packet_is_recorded_once_and_noise_is_not() -> None:
    (port,) = free_udp_ports(1)
    taking, wire = Taking(), Sender()
    endpoint = taking.endpoint(f"udpin:127.0.0.1:{port}")
    await endpoint.start()
    before = endpoint.waiting_for()
    sent = [wire.heartbeat(), *(wire.attitude(n * 20) for n in range(20))]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for data in sent:
            out.sendto(b"noise" + data, ("127.0.0.1", port))
        async with asyncio.timeout(PATIENCE_S):
            while len(taking.packets) < len(sent):
                await asyncio.sleep(0)
    after = endpoint.waiting_for()
    await endpoint.close()
    await endpoint.close()

    assert taking.packets == sent
    assert str(port) in (before or "")
    assert after is None
    assert taking.metrics.registry.get_sample_value(
        "pilotage_link_packets_total", {"endpoint": endpoint.name}
    ) == len(sent)  # fmt: skip


async def test_a_vehicle_that_is_not_there_yet_is_waited_for(tmp_path: Path) -> None:
    """Nobody listens on the TCP port, and the serial device is not plugged in: neither is an error."""
    endpoints = [
        Taking().endpoint(f"tcp:127.0.0.1:{free_port()}"), Taking().endpoint(f"serial:{tmp_path}/ttyUSB0:57600"),
    ]  # fmt: skip
    for endpoint in endpoints:
        await endpoint.start()
    words = [endpoint.waiting_for() or "" for endpoint in endpoints]
    for endpoint in endpoints:
        await endpoint.close()

    assert "127.0.0.1" in words[0]
    assert "ttyUSB0" in words[1]
