import asyncio
import os
import pty
import tty
from pathlib import Path

from backend.transports.serial_port import SerialTransport
from tests.backend.transports.inbox import Inbox

BAUD = 57_600


def _cable() -> tuple[int, int]:
    """A pseudo terminal: our end and the file descriptor that names the device."""
    ours, device = pty.openpty()
    tty.setraw(device)
    os.set_blocking(ours, False)
    return ours, device


async def _until(transport: SerialTransport, word: str) -> None:
    async with asyncio.timeout(10.0):
        while word not in transport.status:
            await asyncio.sleep(0.005)


async def _read(ours: int, count: int) -> bytes:
    data = b""
    async with asyncio.timeout(10.0):
        while len(data) < count:
            try:
                data += os.read(ours, 65_536)
            except BlockingIOError:
                await asyncio.sleep(0.001)
    return data


async def test_bytes_both_ways() -> None:
    ours, device = _cable()
    transport, heard = SerialTransport(os.ttyname(device), BAUD), Inbox()
    await transport.open(heard)
    await _until(transport, "open, waiting for a first packet")
    os.write(ours, b"telemetry\xfd\x00\x03\x11\x13")
    await heard.until(b"telemetry\xfd\x00\x03\x11\x13")
    transport.write(b"command\x00\xff")

    assert await _read(ours, 9) == b"command\x00\xff"
    assert transport.status.endswith("receiving")
    await transport.close()
    assert transport.status.endswith("closed")
    os.close(ours)
    os.close(device)


async def test_a_device_that_is_not_there_is_waited_for(tmp_path: Path) -> None:
    link = tmp_path / "ttyUSB0"
    transport, heard = SerialTransport(str(link), BAUD, first_retry_s=0.01), Inbox()
    await transport.open(heard)
    await _until(transport, "No such file")

    ours, device = _cable()
    link.symlink_to(os.ttyname(device))
    await _until(transport, "waiting for a first packet")
    os.write(ours, b"plugged in")
    await heard.until(b"plugged in")
    await transport.close()
    os.close(ours)
    os.close(device)


async def test_an_unplugged_device_is_opened_again(tmp_path: Path) -> None:
    link = tmp_path / "ttyUSB0"
    ours, device = _cable()
    link.symlink_to(os.ttyname(device))
    transport, heard = SerialTransport(str(link), BAUD, first_retry_s=0.01), Inbox()
    await transport.open(heard)
    await _until(transport, "waiting for a first packet")
    os.write(ours, b"before")
    await heard.until(b"before")
    link.unlink()
    os.close(device)
    os.close(ours)
    await _until(transport, "trying again")

    ours, device = _cable()
    link.symlink_to(os.ttyname(device))
    await _until(transport, "waiting for a first packet")
    os.write(ours, b"after")
    await heard.until(b"after")
    await transport.close()
    os.close(ours)
    os.close(device)


async def test_a_choked_port_drops_whole_packets_and_does_not_block() -> None:
    ours, device = _cable()
    transport = SerialTransport(os.ttyname(device), BAUD)
    await transport.open(Inbox())
    await _until(transport, "waiting for a first packet")
    packet = bytes(range(100))
    for _ in range(1_000):
        transport.write(packet)
    received = b""
    async with asyncio.timeout(10.0):
        while not received or transport._unsent:
            try:
                received += os.read(ours, 65_536)
            except BlockingIOError:
                await asyncio.sleep(0.001)
    received += await _read(ours, 0)

    assert 0 < len(received) < 100_000
    whole = len(received) // 100 * 100
    assert received[:whole] == packet * (whole // 100)
    await transport.close()
    os.close(ours)
    os.close(device)
