"""MAVLink over TCP: a client that connects again, or a listener for one vehicle at a time."""

from __future__ import annotations

import asyncio

from backend.transports.base import FIRST_RETRY_S, OnData, Reconnecting, TransportError, deliver

_READ_BYTES = 65_536
_CONNECT_TIMEOUT_S = 5.0
# Beyond this a peer does not read: packets are dropped rather than sent when they are old.
_MOST_UNSENT_BYTES = 65_536


class TcpClientTransport(Reconnecting):
    """Connects to a listening vehicle or router."""

    def __init__(self, host: str, port: int, *, first_retry_s: float = FIRST_RETRY_S) -> None:
        super().__init__(f"TCP to {host}:{port}", first_retry_s=first_retry_s)
        self._host = host
        self._port = port
        self._writer: asyncio.StreamWriter | None = None

    async def session(self) -> None:
        """One connection's life."""
        self._status = f"{self._name}: connecting"
        try:
            async with asyncio.timeout(_CONNECT_TIMEOUT_S):
                reader, self._writer = await asyncio.open_connection(self._host, self._port)
        except TimeoutError:
            message = f"no answer within {_CONNECT_TIMEOUT_S:g} s"
            raise OSError(message) from None
        self._status = f"{self._name}: connected, waiting for a first packet"
        try:
            while data := await reader.read(_READ_BYTES):
                self._received(data)
        finally:
            writer, self._writer = self._writer, None
            writer.transport.abort()

    def write(self, data: bytes) -> None:
        """Send when connected."""
        _write(self._writer, data)


class TcpServerTransport:
    """Listens; the newest connection is the vehicle, and an older one is closed.

    Two byte streams cannot be mixed into one without cutting packets.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port
        self._on_data: OnData | None = None
        self._server: asyncio.Server | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._serving: set[asyncio.Task[None]] = set()
        self._closed = False

    @property
    def local_port(self) -> int:
        """The port in use, of interest when 0 asked for any."""
        return self._port

    @property
    def status(self) -> str:
        """What it is doing or waiting for."""
        name = f"TCP port {self._port} on {self._host}"
        if self._server is None:
            return f"{name}: closed" if self._closed else f"{name}: not open"
        if self._writer is None:
            return f"{name}: waiting for a connection"
        host, port = (self._writer.get_extra_info("peername") or ("?", "?"))[:2]
        return f"{name}: connected with {host}:{port}"

    async def open(self, on_data: OnData) -> None:
        """Listen; TransportError when the port is taken or the address is not of this machine."""
        self._on_data = on_data
        try:
            self._server = await asyncio.start_server(self._accept, self._host, self._port)
        except OSError as error:
            reason = f"cannot listen on TCP port {self._port} of {self._host}: {error.strerror or error}"
            raise TransportError(f"tcpin:{self._host}:{self._port}", reason) from error
        self._port = self._server.sockets[0].getsockname()[1]

    def write(self, data: bytes) -> None:
        """Send to the connected vehicle."""
        _write(self._writer, data)

    async def close(self) -> None:
        """Close the connection and free the port."""
        self._closed = True
        if self._server is not None:
            self._server.close()
            for task in list(self._serving):
                task.cancel()
            await asyncio.gather(*self._serving, return_exceptions=True)
            await self._server.wait_closed()
            self._server = None

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.ensure_future(self._serve(reader, writer))
        self._serving.add(task)
        task.add_done_callback(self._serving.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._writer is not None:
            self._writer.transport.abort()
        self._writer = writer
        try:
            while self._writer is writer and (data := await reader.read(_READ_BYTES)):
                if self._on_data is not None and self._writer is writer:
                    deliver(self._on_data, data)
        except OSError:
            # The vehicle went away without a word; it may connect again.
            return
        finally:
            if self._writer is writer:
                self._writer = None
            writer.transport.abort()


def _write(writer: asyncio.StreamWriter | None, data: bytes) -> None:
    if writer is None or writer.is_closing():
        return
    if writer.transport.get_write_buffer_size() <= _MOST_UNSENT_BYTES:
        writer.write(data)
