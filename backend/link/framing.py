"""Splits a byte stream into MAVLink packets; a stray start byte costs itself and nothing else.

The law is written as if bytes came one at a time: the packet that is complete first is taken, and what lies before it
is noise. That makes the result independent of how the stream is cut, and lets a true packet pass that lies inside the
length a false header claims. One exception: a message that can carry packets in an opaque field (a log in a file
transfer, a tunnel) is judged by its own checksum before anything inside it is looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from fastcrc.crc16 import mcrf4xx

from backend.link.dialect import MessageLayout, decode_payload, message_layouts

START_V1 = 0xFE
START_V2 = 0xFD
_HEADER_BYTES = {START_V1: 6, START_V2: 10}
_CRC_BYTES = 2
_SIGNATURE_BYTES = 13
_LONGEST_PACKET_BYTES = 280
_FLAG_SIGNED = 0x01
_KNOWN_INCOMPATIBILITY_FLAGS = _FLAG_SIGNED
# A run of noise is reported in blocks, so that an endless one neither waits for ever nor grows the memory.
NOISE_BLOCK_BYTES = 4096


@dataclass(frozen=True, slots=True)
class RawPacket:
    """One packet whose checksum is right; ``data`` is the whole of it as received.

    ``known`` is False for an id outside the dialect: its checksum can be checked to one part in 256 only, and its
    payload cannot be decoded.
    """

    data: bytes
    version: int
    msg_id: int
    seq: int
    system_id: int
    component_id: int
    signed: bool
    known: bool = True

    @property
    def payload(self) -> bytes:
        """The payload bytes, as short as the sender made them."""
        header = _HEADER_BYTES[self.data[0]]
        return self.data[header : header + self.data[1]]

    def decode(self) -> Any:
        """pymavlink's message object, or KeyError when the id is not known."""
        return decode_payload(self.msg_id, self.payload)


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes that belong to no packet."""

    length: int


FramerEvent = RawPacket | Noise


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A start byte with a plausible header; ``end`` is one past the packet it claims."""

    start: int
    end: int
    header: int
    msg_id: int
    layout: MessageLayout | None
    signed: bool


class MavlinkFramer:
    """Byte stream to packets, MAVLink 1 and 2, signed or not; any chunking gives the same events."""

    def __init__(self) -> None:
        self._layouts = message_layouts()
        self._buffer = bytearray()
        self._noise = bytearray()
        # Everything that can be decided with the bytes before this index of the buffer has been decided.
        self._decided = 0
        self._ended = False
        self._shared = 0  # 1 while the buffer's first byte is also the last one of the packet before

    def feed(self, data: bytes) -> list[FramerEvent]:
        """Take bytes, give the packets and the noise that they complete, in order."""
        self._buffer += data
        events: list[FramerEvent] = []
        while self._buffer and self._step(events):
            pass
        return events

    def finish(self) -> list[FramerEvent]:
        """The end of the stream: what waited for more is decided with what there is."""
        events: list[FramerEvent] = []
        self._ended = True
        self._decided = 0
        while self._buffer and self._step(events):
            pass
        self._ended = False
        self._flush_noise(events)
        return events

    def _step(self, events: list[FramerEvent]) -> bool:
        """Decide what is at the front; False when more bytes are needed."""
        buffer = self._buffer
        start = _next_start(buffer, 0)
        if start > 0:
            self._skip(start, events)
        if not buffer:
            return False
        available = len(buffer)
        front = self._candidate(0, available)
        if front is False:
            self._skip(1, events)
            return True
        limit = available
        if front is not None and front.end <= available:
            if _next_start(buffer, 1, front.end) == front.end and self._is_packet(front):
                self._take(front, events)
                return True
            limit = min(available, front.end + _LONGEST_PACKET_BYTES) if front.signed else front.end
        for moment in self._moments(limit):
            found = self._first_packet(moment)
            if found is not None:
                self._take(found, events)
                return True
            self._decided = moment
        if (front is None and self._ended) or (front is not None and self._verdict(front, limit) is False):
            self._skip(1, events)
            return True
        return False

    def _moments(self, limit: int) -> list[int]:
        """Buffer lengths, ascending, at which something is decided that was not before."""
        buffer = self._buffer
        moments = {limit} if self._ended else set()
        signed = False
        start = _next_start(buffer, 0, limit)
        while start < limit:
            candidate = self._candidate(start, len(buffer))
            if candidate:
                moments.add(candidate.end)
                signed |= candidate.signed
            if signed:
                moments |= {start + 3, start + _HEADER_BYTES[buffer[start]]}
            start = _next_start(buffer, start + 1, limit)
        return sorted(moment for moment in moments if self._decided < moment <= limit)

    def _first_packet(self, moment: int) -> _Candidate | None:
        """The first packet among the bytes before ``moment``, unless one that is not yet decided may contain it."""
        buffer = self._buffer
        start = _next_start(buffer, 0, moment)
        while start < moment:
            candidate = self._candidate(start, moment)
            # Packets of unknown type never take bytes from others: they are looked for in what is left over.
            if candidate and candidate.layout is not None:
                verdict = self._verdict(candidate, moment)
                if verdict:
                    return candidate
                if verdict is None and (candidate.layout.carries_packets or candidate.end <= moment):
                    return None
            start = _next_start(buffer, start + 1, moment)
        return None

    def _verdict(self, candidate: _Candidate, moment: int) -> bool | None:
        """Whether the candidate is a packet, by the bytes before ``moment``; None when they do not tell yet."""
        if candidate.end > moment:
            return False if self._ended and candidate.end > len(self._buffer) else None
        if not self._is_packet(candidate):
            return False
        return not candidate.signed or self._signature_is_whole(candidate, moment)

    def _signature_is_whole(self, candidate: _Candidate, moment: int) -> bool | None:
        """The checksum does not cover the signature: a packet cut off there must not swallow the next one's head."""
        buffer = self._buffer
        start = _next_start(buffer, candidate.end - _SIGNATURE_BYTES, candidate.end)
        while start < candidate.end:
            inner = self._candidate(start, moment)
            if inner is None and not (self._ended and moment == len(buffer)):
                return None
            if inner and inner.layout is not None:
                verdict = self._verdict(inner, moment)
                if verdict is not False:
                    return None if verdict is None else False
            start = _next_start(buffer, start + 1, candidate.end)
        return True

    def _candidate(self, start: int, limit: int) -> _Candidate | Literal[False] | None:
        """What the header at ``start`` claims; False when it cannot be one, None when it is not whole at ``limit``."""
        return _candidate_at(self._buffer, start, limit, self._layouts)

    def _is_packet(self, candidate: _Candidate) -> bool:
        layout = candidate.layout
        if layout is None:
            return False
        buffer = self._buffer
        crc_at = candidate.start + candidate.header + buffer[candidate.start + 1]
        crc = mcrf4xx(bytes(buffer[candidate.start + 1 : crc_at]) + layout.crc_extra)
        return bool(crc == buffer[crc_at] | buffer[crc_at + 1] << 8)

    def _take(self, packet: _Candidate, events: list[FramerEvent]) -> None:
        self._skip(packet.start, events)
        self._flush_noise(events)
        length = packet.end - packet.start
        events.append(_raw_packet(bytes(self._buffer[:length]), packet.msg_id, known=True))
        # A packet cut off before its last checksum byte is made whole by the next one's start byte, when that is the
        # byte it lacks: then both have it.
        self._shared = int(not packet.signed and self._buffer[length - 1] in _HEADER_BYTES)
        del self._buffer[: length - self._shared]
        self._decided = 0

    def _skip(self, count: int, events: list[FramerEvent]) -> None:
        if not count:
            return
        self._noise += self._buffer[self._shared : count]
        self._shared = 0
        del self._buffer[:count]
        self._decided = max(0, self._decided - count)
        while len(self._noise) >= NOISE_BLOCK_BYTES:
            events.extend(_unknown_packets(bytes(self._noise[:NOISE_BLOCK_BYTES]), self._layouts))
            del self._noise[:NOISE_BLOCK_BYTES]

    def _flush_noise(self, events: list[FramerEvent]) -> None:
        if self._noise:
            events.extend(_unknown_packets(bytes(self._noise), self._layouts))
            self._noise.clear()


def _next_start(buffer: bytes | bytearray, start: int, limit: int | None = None) -> int:
    """Index of the next start byte in [start, limit), or limit (default the length) when there is none."""
    end = len(buffer) if limit is None else limit
    v2 = buffer.find(START_V2, start, end)
    v1 = buffer.find(START_V1, start, end if v2 < 0 else v2)
    if v1 >= 0:
        return v1
    return v2 if v2 >= 0 else end


def _candidate_at(
    buffer: bytes | bytearray, start: int, limit: int, layouts: dict[int, MessageLayout]
) -> _Candidate | Literal[False] | None:
    available = limit - start
    if buffer[start] == START_V2:
        if available >= 3 and buffer[start + 2] & ~_KNOWN_INCOMPATIBILITY_FLAGS:
            return False
        if available < 10:
            return None
        msg_id = buffer[start + 7] | buffer[start + 8] << 8 | buffer[start + 9] << 16
        signed = bool(buffer[start + 2] & _FLAG_SIGNED)
        end = start + 10 + buffer[start + 1] + _CRC_BYTES + (_SIGNATURE_BYTES if signed else 0)
        return _Candidate(start, end, 10, msg_id, layouts.get(msg_id), signed)
    if available < 6:
        return None
    msg_id = buffer[start + 5]
    layout = layouts.get(msg_id)
    # Version 1 does not truncate and knows no extensions: a longer payload cannot be.
    if layout is not None and buffer[start + 1] > layout.size:
        return False
    return _Candidate(start, start + 6 + buffer[start + 1] + _CRC_BYTES, 6, msg_id, layout, signed=False)


def _raw_packet(data: bytes, msg_id: int, *, known: bool) -> RawPacket:
    if data[0] == START_V2:
        return RawPacket(data, 2, msg_id, data[4], data[5], data[6], bool(data[2] & _FLAG_SIGNED), known)
    return RawPacket(data, 1, msg_id, data[2], data[3], data[4], signed=False, known=known)


def _unknown_packets(noise: bytes, layouts: dict[int, MessageLayout]) -> list[FramerEvent]:
    """Sort left-over bytes into packets of message types outside the dialect and true noise.

    The type's own checksum byte is unknown, so a packet counts when any of the 256 makes the checksum right.
    """
    events: list[FramerEvent] = []
    noise_from = 0
    start = _next_start(noise, 0)
    while start < len(noise):
        candidate = _candidate_at(noise, start, len(noise), layouts)
        if (
            not isinstance(candidate, _Candidate)
            or candidate.layout is not None
            or candidate.end > len(noise)
            or not _some_checksum_holds(noise, candidate)
        ):
            start = _next_start(noise, start + 1)
            continue
        if start > noise_from:
            events.append(Noise(start - noise_from))
        events.append(_raw_packet(noise[start : candidate.end], candidate.msg_id, known=False))
        noise_from = candidate.end
        start = _next_start(noise, noise_from)
    if noise_from < len(noise):
        events.append(Noise(len(noise) - noise_from))
    return events


def _some_checksum_holds(data: bytes, candidate: _Candidate) -> bool:
    crc_at = candidate.start + candidate.header + data[candidate.start + 1]
    body = data[candidate.start + 1 : crc_at]
    crc = data[crc_at] | data[crc_at + 1] << 8
    return any(mcrf4xx(body + bytes([extra])) == crc for extra in range(256))
