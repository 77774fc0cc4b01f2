"""The transports by the scheme of their connection strings."""

from __future__ import annotations

from collections.abc import Callable

from backend.transports.address import Connection
from backend.transports.base import Transport, TransportError
from backend.transports.serial_port import SerialTransport
from backend.transports.tcp import TcpClientTransport, TcpServerTransport
from backend.transports.udp import UdpInTransport, UdpOutTransport

_ANY_HOST = "0.0.0.0"  # noqa: S104 - a vehicle sends from elsewhere


def _udp_in(connection: Connection) -> Transport:
    return UdpInTransport(*connection.host_and_port(_ANY_HOST))


def _udp_out(connection: Connection) -> Transport:
    return UdpOutTransport(*connection.host_and_port())


def _tcp_client(connection: Connection) -> Transport:
    return TcpClientTransport(*connection.host_and_port())


def _tcp_server(connection: Connection) -> Transport:
    return TcpServerTransport(*connection.host_and_port(_ANY_HOST))


def _serial(connection: Connection) -> Transport:
    return SerialTransport(*connection.device_and_baud())


TRANSPORTS: dict[str, Callable[[Connection], Transport]] = {
    "udpin": _udp_in,
    "udp": _udp_in,
    "udpout": _udp_out,
    "tcp": _tcp_client,
    "tcpout": _tcp_client,
    "tcpin": _tcp_server,
    "serial": _serial,
}


def create_transport(connection: str) -> Transport:
    """The transport of a connection string, not yet open.

    Raises TransportError for a string that is not understood, with what was expected.
    """
    parsed = Connection.parse(connection)
    create = TRANSPORTS.get(parsed.scheme)
    if create is None:
        known = ", ".join(TRANSPORTS)
        raise TransportError(connection, f"unknown kind of connection '{parsed.scheme}' (known: {known})")
    return create(parsed)
