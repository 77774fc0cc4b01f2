"""Receivers of CoT events on the loopback, which wait a bounded time."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
from collections.abc import AsyncIterator, Callable
from typing import Any

from tests.backend.exports.samples import valid_event

HOST = "127.0.0.1"
PATIENCE_S = 20.0


class UdpReceiver(asyncio.DatagramProtocol):
    def __init__(self) -> None:
        self.port = 0
        self._heard: asyncio.Queue[bytes] = asyncio.Queue()

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._heard.put_nowait(data)

    async def event(self) -> Any:
        """The next event, valid."""
        async with asyncio.timeout(PATIENCE_S):
            return valid_event(await self._heard.get())

    async def event_of(self, callsign: str) -> Any:
        for _ in range(1000):
            event = await self.event()
            if event.find("detail/contact").get("callsign") == callsign:
                return event
        raise AssertionError(callsign)

    @property
    def is_silent(self) -> bool:
        return self._heard.empty()


@contextlib.asynccontextmanager
async def udp_receiver(port: int = 0, group: str | None = None) -> AsyncIterator[UdpReceiver]:
    """Listens on the loopback; of a group, if one is given."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    sock.bind((group or HOST, port))
    if group is not None:
        member = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton(HOST))
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    transport, receiver = await asyncio.get_running_loop().create_datagram_endpoint(UdpReceiver, sock=sock)
    receiver.port = sock.getsockname()[1]
    try:
        yield receiver
    finally:
        transport.close()
        await asyncio.sleep(0)


class TcpReceiver:
    """Takes the stream apart at ``</event>``, as TAK programs do; reads nothing while ``deaf``."""

    def __init__(self, deaf: bool) -> None:
        self.port = 0
        self.connections = 0
        self._deaf = deaf
        self._heard: asyncio.Queue[bytes] = asyncio.Queue()
        self._writers: list[asyncio.StreamWriter] = []

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        self._writers.append(writer)
        writer.write(b"<event a server tells everybody/>" * 100)
        if self._deaf:
            return
        with contextlib.suppress(asyncio.IncompleteReadError, OSError):
            while True:
                self._heard.put_nowait(await reader.readuntil(b"</event>"))

    async def event(self) -> Any:
        async with asyncio.timeout(PATIENCE_S):
            return valid_event((await self._heard.get()).strip())

    def hang_up(self) -> None:
        for writer in self._writers:
            writer.transport.abort()


@contextlib.asynccontextmanager
async def tcp_receiver(port: int = 0, *, deaf: bool = False) -> AsyncIterator[TcpReceiver]:
    receiver = TcpReceiver(deaf)
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    if deaf:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    sock.bind((HOST, port))
    server = await asyncio.start_server(receiver.serve, sock=sock, limit=4096 if deaf else 2**20)
    receiver.port = sock.getsockname()[1]
    try:
        yield receiver
    finally:
        server.close()
        receiver.hang_up()
        await server.wait_closed()


async def until(condition: Callable[[], bool]) -> None:
    """Give the event loop turns until something holds."""
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.005)


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind((HOST, 0))
        port: int = sock.getsockname()[1]
        return port
