"""MAVLink over UDP: listening for vehicles that send here, or sending to one that listens."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from backend.transports.base import FIRST_RETRY_S, OnData, Reconnecting, TransportError, deliver

Address = tuple[Any, ...]
# A vehicle that restarts sends from another port; the old one must not be answered for ever.
_PEER_FORGOTTEN_S = 30.0
_MOST_PEERS = 32


class UdpInTransport:
    """Listens on a local port and answers everyone heard lately."""

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port
        self._on_data: OnData | None = None
        self._socket: asyncio.DatagramTransport | None = None
        self._peers: dict[Address, float] = {}
        self._closed = False
        self._reopening: asyncio.Task[None] | None = None

    @property
    def local_port(self) -> int:
        """The port in use, of interest when 0 asked for any."""
        return self._port

    @property
    def status(self) -> str:
        """What it is doing or waiting for."""
        name = f"UDP port {self._port} on {self._host}"
        if self._socket is None:
            return f"{name}: closed" if self._closed else f"{name}: not open"
        if not self._peers:
            return f"{name}: waiting for a first packet"
        host, port = next(reversed(self._peers))[:2]
        return f"{name}: receiving from {host}:{port}"

    async def open(self, on_data: OnData) -> None:
        """Bind; TransportError when the port is taken or the address is not of this machine."""
        self._on_data = on_data
        self._closed = False
        try:
            await self._bind()
        except OSError as error:
            reason = f"cannot listen on UDP port {self._port} of {self._host}: {error.strerror or error}"
            raise TransportError(f"udpin:{self._host}:{self._port}", reason) from error

    async def _bind(self) -> None:
        loop = asyncio.get_running_loop()
        address = (self._host, self._port)
        self._socket, _ = await loop.create_datagram_endpoint(
            lambda: _Datagrams(self._received, self._lost), local_addr=address
        )
        self._port = self._socket.get_extra_info("sockname")[1]

    def write(self, data: bytes) -> None:
        """Send to every peer heard in the last half minute."""
        if self._socket is None or not self._peers:
            return
        now_s = asyncio.get_running_loop().time()
        for peer, heard_s in list(self._peers.items()):
            if now_s - heard_s > _PEER_FORGOTTEN_S:
                del self._peers[peer]
            else:
                self._socket.sendto(data, peer)

    async def close(self) -> None:
        """Free the port."""
        self._closed = True
        if self._reopening is not None:
            self._reopening.cancel()
            await asyncio.gather(self._reopening, return_exceptions=True)
            self._reopening = None
        if self._socket is not None:
            self._socket.close()
            self._socket = None
            # The socket is closed by the loop's next turn, and the port may be wanted at once.
            await asyncio.sleep(0)
        self._peers.clear()

    def _received(self, data: bytes, peer: Address) -> None:
        self._peers.pop(peer, None)
        self._peers[peer] = asyncio.get_running_loop().time()
        if len(self._peers) > _MOST_PEERS:
            del self._peers[next(iter(self._peers))]
        if self._on_data is not None:
            deliver(self._on_data, data)

    def _lost(self) -> None:
        if not self._closed:
            self._socket = None
            self._reopening = asyncio.ensure_future(self._reopen())

    async def _reopen(self) -> None:
        """The interface went away under the socket; the port is taken again when it is back."""
        while self._socket is None:
            await asyncio.sleep(FIRST_RETRY_S)
            try:
                await self._bind()
            except OSError:
                continue


class UdpOutTransport(Reconnecting):
    """Sends to one address and hears its answers."""

    def __init__(self, host: str, port: int, *, first_retry_s: float = FIRST_RETRY_S) -> None:
        super().__init__(f"UDP to {host}:{port}", first_retry_s=first_retry_s)
        self._host = host
        self._port = port
        self._socket: asyncio.DatagramTransport | None = None

    async def session(self) -> None:
        """One socket's life, which ends only when the socket breaks."""
        loop = asyncio.get_running_loop()
        lost = asyncio.Event()
        self._socket, _ = await loop.create_datagram_endpoint(
            lambda: _Datagrams(lambda data, _: self._received(data), lost.set),
            remote_addr=(self._host, self._port),
        )
        self._status = f"{self._name}: sending, waiting for an answer"
        try:
            await lost.wait()
        finally:
            self._socket.close()
            self._socket = None

    def write(self, data: bytes) -> None:
        """Send; nobody listening there is no error, somebody may start to."""
        if self._socket is not None:
            self._socket.sendto(data)


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, received: Callable[[bytes, Address], None], lost: Callable[[], None]) -> None:
        self._received = received
        self._lost = lost

    def datagram_received(self, data: bytes, addr: Address) -> None:
        self._received(data, addr)

    def error_received(self, exc: Exception) -> None:
        """An ICMP answer: the peer is not there yet, or has gone. The socket is good for the next packet."""

    def connection_lost(self, _exc: Exception | None) -> None:
        self._lost()
