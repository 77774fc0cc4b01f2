import asyncio
import random
import socket
from collections.abc import AsyncIterator

import pytest

from backend.link.link import VehicleLink
from backend.transports.base import TransportError
from backend.transports.udp import UdpInTransport, UdpOutTransport
from tests.backend.link.wire import Sender
from tests.backend.transports.inbox import Inbox, turns

HOST = "127.0.0.1"


@pytest.fixture
async def listener() -> AsyncIterator[tuple[UdpInTransport, Inbox]]:
    inbox, transport = Inbox(), UdpInTransport(HOST, 0)
    await transport.open(inbox)
    yield transport, inbox
    await transport.close()


async def _opened(port: int) -> tuple[UdpOutTransport, Inbox]:
    inbox, transport = Inbox(), UdpOutTransport(HOST, port)
    await transport.open(inbox)
    await turns(lambda: "sending" in transport.status)
    return transport, inbox


async def test_bytes_both_ways(listener: tuple[UdpInTransport, Inbox]) -> None:
    station, heard = listener
    assert station.status.endswith("waiting for a first packet")
    vehicle, answers = await _opened(station.local_port)

    vehicle.write(b"telemetry")
    await heard.until(b"telemetry")
    station.write(b"command")
    await answers.until(b"command")

    assert "receiving from 127.0.0.1" in station.status
    assert vehicle.status.endswith("receiving")
    await vehicle.close()
    assert vehicle.status.endswith("closed")


async def test_every_vehicle_on_the_port_is_answered(listener: tuple[UdpInTransport, Inbox]) -> None:
    station, heard = listener
    first, first_answers = await _opened(station.local_port)
    second, second_answers = await _opened(station.local_port)
    first.write(b"a")
    await heard.until(b"a")
    second.write(b"b")
    await heard.until(b"b")

    station.write(b"both")
    await first_answers.until(b"both")
    await second_answers.until(b"both")
    await first.close()
    await second.close()


async def test_a_taken_port_is_a_clear_error(listener: tuple[UdpInTransport, Inbox]) -> None:
    station, _ = listener
    with pytest.raises(TransportError, match=rf"cannot listen on UDP port {station.local_port} .*in use"):
        await UdpInTransport(HOST, station.local_port).open(Inbox())


async def test_a_closed_port_is_free_at_once() -> None:
    first = UdpInTransport(HOST, 0)
    await first.open(Inbox())
    await first.close()
    await first.close()
    second = UdpInTransport(HOST, first.local_port)
    await second.open(Inbox())

    assert second.local_port == first.local_port
    await second.close()


async def test_sending_before_anybody_listens_and_then_being_heard() -> None:
    """The refusal that comes back (ICMP) must not end the sending."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    vehicle, _ = await _opened(port)
    for _ in range(5):
        vehicle.write(b"nobody")
        await asyncio.sleep(0)
    station, heard = UdpInTransport(HOST, port), Inbox()
    await station.open(heard)
    # The socket reports the refusals of the packets above on the first tries.
    for _ in range(10):
        vehicle.write(b"somebody")
    await heard.until(b"somebody")
    await station.close()
    await vehicle.close()


async def test_writing_without_a_peer_or_after_closing_does_nothing() -> None:
    transport = UdpInTransport(HOST, 0)
    transport.write(b"x")
    await transport.open(Inbox())
    transport.write(b"x")
    await transport.close()
    transport.write(b"x")
    assert transport.status.endswith("closed")


async def test_a_fault_of_the_receiver_does_not_close_the_port() -> None:
    faults: list[str] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: faults.append(context["message"]))
    inbox = Inbox()

    def receive(data: bytes) -> None:
        if data == b"poison":
            raise RuntimeError(data)
        inbox(data)

    station = UdpInTransport(HOST, 0)
    await station.open(receive)
    vehicle, _ = await _opened(station.local_port)
    vehicle.write(b"poison")
    vehicle.write(b"good")
    await inbox.until(b"good")

    assert faults == ["a receiver of 6 bytes failed"]
    await vehicle.close()
    await station.close()


async def test_random_bytes_and_cut_packets_leave_the_link_working(listener: tuple[UdpInTransport, Inbox]) -> None:
    station, heard = listener
    vehicle, _ = await _opened(station.local_port)
    rng, sender = random.Random(1), Sender()
    for i in range(50):
        vehicle.write(rng.randbytes(rng.randrange(1, 200)))
        vehicle.write(sender.attitude(i)[: rng.randrange(1, 30)])
        await asyncio.sleep(0)
    vehicle.write(sender.heartbeat() * 30 + b"end")
    await heard.until(b"end")
    link = VehicleLink()
    for chunk in heard.chunks:
        link.receive(chunk, 1_760_000_000_000_000)

    assert list(link.vehicles) == [1]
    await vehicle.close()
