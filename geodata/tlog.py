"""The telemetry log: MAVLink as received, each packet behind its time of receipt.

A record is a uint64, big-endian, of Unix microseconds, then one MAVLink 1 or 2 packet (the format of MAVProxy, Mission
Planner and QGroundControl). Framing only: checksums are the link's business, as they were when the packet was received.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

_TIME = struct.Struct(">Q")
_V1, _V2 = 0xFE, 0xFD
_SIGNED = 0x01

# A clock that was never set starts at 1970 plus the uptime; 2100 bounds the other side.
_LATEST_US = 4_102_444_800_000_000
_NEIGHBOUR_US = 7 * 86_400_000_000

_HEADER = 8 + 3
_LONGEST_RECORD = 8 + 10 + 255 + 2 + 13
_CHUNK = 1 << 20


def iter_tlog(path: str | os.PathLike[str]) -> Iterator[tuple[int, bytes]]:
    """Yield (Unix microseconds, packet) in the file's order.

    Garbage between records is skipped; a record cut off at the end of the file ends the iteration.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    with Path(path).open("rb") as file:
        yield from _iter_stream(file, in_step=True)


def tlog_span(path: str | os.PathLike[str]) -> tuple[int, int] | None:
    """First and last time of a log in Unix microseconds, from its two ends; None when it holds no packet."""
    file = Path(path)
    first = next(iter_tlog(file), None)
    if first is None:
        return None
    last_us = first[0]
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 65536))
        for t_us, _ in _iter_stream(stream, in_step=stream.tell() == 0):
            last_us = t_us
    return first[0], last_us


class TlogWriter:
    """Appends packets to a telemetry log; each is with the operating system when :meth:`write` returns.

    A killed process so loses nothing that was written, and at most its last record is cut off.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._file = self.path.open("ab", buffering=0)

    def write(self, t_unix_us: int, packet: bytes) -> None:
        """Append one packet as it was received."""
        record = _TIME.pack(t_unix_us) + packet
        written = self._file.write(record)
        while written < len(record):
            record = record[written:]
            written = self._file.write(record)

    def sync(self) -> None:
        """Have what was written on the disk, also through a power cut."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file; closing twice does no harm."""
        self._file.close()

    def __enter__(self) -> TlogWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _iter_stream(file: BinaryIO, *, in_step: bool) -> Iterator[tuple[int, bytes]]:
    """Records of a stream; ``in_step`` says that the first byte is where a record begins."""
    buffer = bytearray()
    at = 0
    ended = False
    last_us: int | None = None
    while True:
        if not ended and len(buffer) - at < _LONGEST_RECORD + _HEADER:
            chunk = file.read(_CHUNK)
            ended = not chunk
            del buffer[:at]
            buffer += chunk
            at = 0
            continue
        if len(buffer) - at < _HEADER:
            return
        size = _record_size(buffer, at, last_us if in_step else None)
        if size is None or not _plausible_after(buffer, at, size, in_step, ended):
            in_step = False
            at += 1
            continue
        last_us = int(_TIME.unpack_from(buffer, at)[0])
        yield last_us, bytes(buffer[at + 8 : at + size])
        in_step = True
        at += size


def _record_size(buffer: bytes | bytearray, at: int, last_us: int | None) -> int | None:
    """Length of the record that seems to begin at ``at``, None when none can."""
    if len(buffer) - at < _HEADER:
        return None
    magic = buffer[at + 8]
    if magic == _V2:
        flags = buffer[at + 10]
        if flags & ~_SIGNED:
            return None
        size = 8 + 10 + buffer[at + 9] + 2 + (13 if flags & _SIGNED else 0)
    elif magic == _V1:
        size = 8 + 6 + buffer[at + 9] + 2
    else:
        return None
    t_us = _TIME.unpack_from(buffer, at)[0]
    if t_us > _LATEST_US or (last_us is not None and abs(t_us - last_us) > _NEIGHBOUR_US):
        return None
    return size


def _plausible_after(buffer: bytes | bytearray, at: int, size: int, in_step: bool, ended: bool) -> bool:
    """Whether what follows a record speaks for it: another record, the end, or that it was expected here."""
    rest = len(buffer) - at - size
    if rest < 0:
        return False
    if in_step or rest == 0:
        return True
    if rest < _HEADER:
        return ended
    return _record_size(buffer, at + size, _TIME.unpack_from(buffer, at)[0]) is not None
