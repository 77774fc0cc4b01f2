"""MAVLink over a serial port: a telemetry radio or a USB cable that may be unplugged."""

from __future__ import annotations

import asyncio
import os

import serial

from backend.transports.base import FIRST_RETRY_S, Reconnecting

_READ_BYTES = 4_096
# Two seconds of a 57600 baud radio; what does not fit would be old when it is sent.
_MOST_UNSENT_BYTES = 11_520


class SerialTransport(Reconnecting):
    """Opens the device, and again when it was unplugged; waits for it when it is not there yet. POSIX only."""

    def __init__(self, device: str, baud: int, *, first_retry_s: float = FIRST_RETRY_S) -> None:
        super().__init__(f"serial port {device} at {baud} baud", first_retry_s=first_retry_s)
        self._device = device
        self._baud = baud
        self._port: serial.Serial | None = None
        self._unsent = bytearray()
        self._over: asyncio.Future[None] | None = None

    async def session(self) -> None:
        """One opening's life. SerialException is an OSError."""
        loop = asyncio.get_running_loop()
        self._status = f"{self._name}: opening"
        port = await loop.run_in_executor(None, self._open_port)
        self._status = f"{self._name}: open, waiting for a first packet"
        self._port = port
        self._unsent.clear()
        self._over = loop.create_future()
        loop.add_reader(port.fileno(), self._readable)
        try:
            await self._over
        finally:
            self._port = None
            loop.remove_reader(port.fileno())
            loop.remove_writer(port.fileno())
            port.close()

    def write(self, data: bytes) -> None:
        """Send when the port is open and not choked; a packet is sent whole or not at all."""
        if self._port is not None and len(self._unsent) + len(data) <= _MOST_UNSENT_BYTES:
            self._unsent += data
            self._writable()

    def _open_port(self) -> serial.Serial:
        return serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)

    def _readable(self) -> None:
        if self._port is None:
            return
        try:
            data = os.read(self._port.fileno(), _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(error)
            return
        if data:
            self._received(data)
        else:
            self._end(OSError("the device was unplugged"))

    def _writable(self) -> None:
        port = self._port
        if port is None:
            return
        loop = asyncio.get_running_loop()
        try:
            # Not port.write: it spins while the driver's buffer is full.
            sent = os.write(port.fileno(), self._unsent)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            self._end(error)
            return
        del self._unsent[:sent]
        if self._unsent:
            loop.add_writer(port.fileno(), self._writable)
        else:
            loop.remove_writer(port.fileno())

    def _end(self, error: OSError) -> None:
        # A device that is gone stays readable: it would be called again and again.
        if self._port is not None:
            asyncio.get_running_loop().remove_reader(self._port.fileno())
        if self._over is not None and not self._over.done():
            self._over.set_exception(error)
