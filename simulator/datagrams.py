"""MAVLink over UDP: the only sockets of the telemetry."""

from __future__ import annotations

import re
import socket

from simulator.errors import LinkAddressError

_ADDRESS = re.compile(r"^(udpout|udpin|udp):(?://)?(\[[^\]]+\]|[^:/]+):(\d+)/?$")
_EXAMPLE = "udpout:127.0.0.1:14550 or udpin:0.0.0.0:14551"
_MAX_DATAGRAMS = 64
_MAX_BYTES = 65536


class DatagramLink:
    """``udpout:`` sends to a station and hears its answers; ``udpin:`` waits for one and answers whoever spoke last."""

    def __init__(self, address: str) -> None:
        direction, host, port = parse_address(address)
        self._peer: tuple[str, int] | None = (host, port) if direction == "out" else None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(("", 0) if direction == "out" else (host, port))
            if direction == "out":
                socket.getaddrinfo(host, port, socket.AF_INET)
        except OSError as error:
            self._socket.close()
            raise LinkAddressError(address, error.strerror or str(error), _EXAMPLE) from error
        self._follows_sender = direction == "in"
        self.errors = 0

    def send(self, packet: bytes) -> None:
        """Send one packet; where nobody listens it is lost, as over the air."""
        if self._peer is None:
            return
        try:
            self._socket.sendto(packet, self._peer)
        except OSError:
            self.errors += 1

    def received(self) -> list[bytes]:
        """Datagrams that have come in, oldest first; never waits."""
        datagrams = []
        for _ in range(_MAX_DATAGRAMS):
            try:
                data, sender = self._socket.recvfrom(_MAX_BYTES)
            except BlockingIOError:
                break
            except OSError:
                # Linux reports here that an earlier packet found no listener.
                self.errors += 1
                continue
            if self._follows_sender:
                self._peer = sender
            datagrams.append(data)
        return datagrams

    def fileno(self) -> int:
        """The socket's number, to wait on."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def parse_address(address: str) -> tuple[str, str, int]:
    """Direction ``out`` or ``in``, host and port of a connection string.

    Raises
    ------
    LinkAddressError
        It is not one.
    """
    match = _ADDRESS.match(address.strip())
    if match is None:
        raise LinkAddressError(address, "is not a UDP connection string", _EXAMPLE)
    port = int(match[3])
    if not 0 < port < 65536:
        raise LinkAddressError(address, f"port {port} does not exist", _EXAMPLE)
    return ("in" if match[1] == "udpin" else "out"), match[2].strip("[]"), port
