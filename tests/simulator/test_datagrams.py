"""UDP for MAVLink."""

from __future__ import annotations

import select
import socket

import pytest

from simulator.datagrams import DatagramLink, parse_address
from simulator.errors import LinkAddressError


def wait_for(link: DatagramLink) -> list[bytes]:
    select.select([link.fileno()], [], [], 5.0)
    return link.received()


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("udpout:127.0.0.1:14550", ("out", "127.0.0.1", 14550)),
        ("udpout://station.local:14550", ("out", "station.local", 14550)),
        ("udp:10.0.0.2:1", ("out", "10.0.0.2", 1)),
        (" udpin:127.0.0.2:14551 ", ("in", "127.0.0.2", 14551)),
    ],
)
def test_addresses(address: str, expected: tuple[str, str, int]) -> None:
    assert parse_address(address) == expected


@pytest.mark.parametrize(
    "address", ["", "14550", "tcp:127.0.0.1:5760", "udpout:127.0.0.1", "udpout:h:0", "udpout:h:70000"]
)
def test_nonsense_is_refused_with_an_example(address: str) -> None:
    with pytest.raises(LinkAddressError, match="udpout:127"):
        parse_address(address)


def test_out_sends_and_hears_the_answer() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(5.0)
        link = DatagramLink(f"udpout:127.0.0.1:{station.getsockname()[1]}")
        link.send(b"hello")
        data, sender = station.recvfrom(100)
        assert data == b"hello"
        station.sendto(b"answer", sender)
        assert wait_for(link) == [b"answer"]
        link.close()


def test_nobody_listening_does_no_harm() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    link = DatagramLink(f"udpout:127.0.0.1:{port}")
    for _ in range(5):
        link.send(b"into the dark")
        assert link.received() == []
    link.close()


def test_in_answers_whoever_spoke() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    link = DatagramLink(f"udpin:127.0.0.1:{port}")
    link.send(b"lost")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.settimeout(5.0)
        station.sendto(b"hello", ("127.0.0.1", port))
        assert wait_for(link) == [b"hello"]
        link.send(b"heartbeat")
        assert station.recv(100) == b"heartbeat"
    link.close()


def test_taken_port_is_an_error_with_the_reason() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(LinkAddressError, match="in use"):
            DatagramLink(f"udpin:127.0.0.1:{taken.getsockname()[1]}")
