"""MPEG-TS (ISO/IEC 13818-1) to coded pictures, at once: bytes in, units out, no I/O and no clock.

FFmpeg's own reader holds each picture until the next one begins, a whole frame period. Here a picture ends when its PES
packet's stated length is reached, or else with the TS packet that is padded, or else where the next one begins.
"""

from __future__ import annotations

from dataclasses import dataclass

from backend.video.frames import VideoUnit

PACKET_BYTES = 188
SYNC = 0x47
_PAT_PID = 0
_NULL_PID = 0x1FFF
_CODECS = {0x1B: "h264", 0x24: "hevc"}
_MAX_UNIT_BYTES = 8_000_000
_MAX_SECTION_BYTES = 4096
_PTS_WRAP = 1 << 33


@dataclass(slots=True)
class TsCounters:
    """What has come: good packets, bytes that are no packets, packets missing, pictures spoilt by that."""

    packets: int = 0
    noise_bytes: int = 0
    lost_packets: int = 0
    spoilt_units: int = 0


class TsDemuxer:
    """The first H.264 or H.265 stream of a transport stream. `receive` takes bytes cut anywhere.

    ``video_codec`` is None until the stream's tables have named one; ``other_codecs`` are stream types it has instead.
    """

    def __init__(self) -> None:
        self.counters = TsCounters()
        self.video_codec: str | None = None
        self.other_types: tuple[int, ...] = ()
        self._rest = b""
        self._t_rest_us = 0
        self._sections: dict[int, bytearray] = {}
        self._parsed: dict[int, bytes] = {}
        self._pmt_pids: frozenset[int] = frozenset()
        self._video_pid: int | None = None
        self._pes = _PesAssembler(self.counters)

    def receive(self, data: bytes, t_us: int) -> list[VideoUnit]:
        """Units that are complete with these bytes, which arrived at ``t_us``."""
        units: list[VideoUnit] = []
        carried = len(self._rest)
        buffer = self._rest + data if carried else data
        at, end = 0, len(buffer)
        while end - at >= PACKET_BYTES:
            following = at + PACKET_BYTES
            if buffer[at] == SYNC and (following == end or buffer[following] == SYNC):
                self.counters.packets += 1
                t_packet_us = self._t_rest_us if at < carried else t_us
                units += self._packet(buffer[at:following], t_packet_us)
                at = following
            else:
                found = self._next_sync(buffer, at + 1)
                self.counters.noise_bytes += found - at
                at = found
        if at < end and buffer[at] != SYNC:
            found = buffer.find(SYNC, at)
            found = end if found < 0 else found
            self.counters.noise_bytes += found - at
            at = found
        if at >= carried:
            self._t_rest_us = t_us
        self._rest = buffer[at:]
        return units

    def reset(self) -> None:
        """Forget a picture that has begun and everything about the stream, as after a long silence."""
        self.video_codec = None
        self._rest = b""
        self._sections.clear()
        self._parsed.clear()
        self._pmt_pids = frozenset()
        self._video_pid = None
        self._pes = _PesAssembler(self.counters)

    @staticmethod
    def _next_sync(buffer: bytes, at: int) -> int:
        """Where the next packet may begin: a sync byte with another one after it, or too near the end to tell."""
        while True:
            at = buffer.find(SYNC, at)
            if at < 0:
                return len(buffer)
            if at + PACKET_BYTES >= len(buffer) or buffer[at + PACKET_BYTES] == SYNC:
                return at
            at += 1

    def _packet(self, packet: bytes, t_us: int) -> list[VideoUnit]:
        pid = int.from_bytes(packet[1:3], "big") & 0x1FFF
        if pid == _NULL_PID or packet[1] & 0x80:  # padding, or marked as broken on the way
            return []
        if pid == self._video_pid:
            return self._pes.packet(packet, t_us)
        if pid == _PAT_PID or pid in self._pmt_pids:
            self._table_packet(pid, packet)
        return []

    def _table_packet(self, pid: int, packet: bytes) -> None:
        payload = _payload(packet)
        if not payload:
            return
        if packet[1] & 0x40:
            start = 1 + payload[0]
            self._sections[pid] = bytearray(payload[start:])
        elif pid in self._sections:
            self._sections[pid] += payload
        section = self._sections.get(pid)
        if section is None or len(section) < 3:
            return
        length = 3 + (int.from_bytes(section[1:3], "big") & 0x0FFF)
        if len(section) < length <= _MAX_SECTION_BYTES:
            return
        whole = bytes(self._sections.pop(pid)[:length])
        if length < 12 or whole == self._parsed.get(pid) or _crc32(whole) != 0:
            return
        self._parsed[pid] = whole
        if pid == _PAT_PID and whole[0] == 0:
            self._read_pat(whole)
        elif pid != _PAT_PID and whole[0] == 2:
            self._read_pmt(whole)

    def _read_pat(self, section: bytes) -> None:
        entries = [section[at : at + 4] for at in range(8, len(section) - 4, 4)]
        pids = frozenset(
            int.from_bytes(e[2:4], "big") & 0x1FFF for e in entries if len(e) == 4 and e[0:2] != b"\x00\x00"
        )
        if pids != self._pmt_pids:
            self._pmt_pids = pids
            self._parsed = {_PAT_PID: section}

    def _read_pmt(self, section: bytes) -> None:
        at = 12 + (int.from_bytes(section[10:12], "big") & 0x0FFF)
        others = []
        while at + 5 <= len(section) - 4:
            kind, pid = section[at], int.from_bytes(section[at + 1 : at + 3], "big") & 0x1FFF
            at += 5 + (int.from_bytes(section[at + 3 : at + 5], "big") & 0x0FFF)
            if kind not in _CODECS:
                others.append(kind)
                continue
            if (pid, _CODECS[kind]) != (self._video_pid, self.video_codec):
                self._video_pid, self.video_codec = pid, _CODECS[kind]
                self._pes = _PesAssembler(self.counters, self.video_codec)
            return
        self.other_types = tuple(others)


class _PesAssembler:
    """Packets of one PID to units."""

    def __init__(self, counters: TsCounters, codec: str = "h264") -> None:
        self._counters = counters
        self._codec = codec
        self._parts: list[bytes] | None = None
        self._size = 0
        self._stated = 0
        self._t_first_us = 0
        self._continuity: int | None = None
        self._last_packet = b""
        self._spoilt = False
        self._after_loss = False
        self._padding_ends_unit = True
        self._ended_by_padding = False
        self._pts: int | None = None

    def packet(self, packet: bytes, t_us: int) -> list[VideoUnit]:
        payload = _payload(packet)
        starts = bool(packet[1] & 0x40)
        if not self._in_sequence(packet, has_payload=bool(packet[3] & 0x10)):
            return []
        units: list[VideoUnit] = []
        if starts:
            units += self._finish(reached_end=self._stated == 0)
            self._begin(t_us)
        elif self._parts is None:
            if self._ended_by_padding and payload:
                # This sender pads in mid-picture: from here on only lengths and beginnings tell where one ends.
                self._padding_ends_unit = False
                self._ended_by_padding = False
                self._after_loss = True
            return units
        if self._parts is None or self._size + len(payload) > _MAX_UNIT_BYTES:
            self._spoil()
            return units
        self._parts.append(payload)
        self._size += len(payload)
        if self._stated == 0 and starts and len(payload) >= 6:
            length = int.from_bytes(payload[4:6], "big")
            self._stated = length + 6 if length else 0
        if self._stated:
            if self._size >= self._stated:
                units += self._finish(reached_end=True)
        elif self._padding_ends_unit and _is_padded(packet):
            units += self._finish(reached_end=True)
            self._ended_by_padding = True
        return units

    def _in_sequence(self, packet: bytes, *, has_payload: bool) -> bool:
        """Check the continuity counter (2.4.3.3); False for a packet that is to be passed over."""
        if not has_payload:
            return False
        counter = packet[3] & 0x0F
        expected = None if self._continuity is None else (self._continuity + 1) & 0x0F
        jump_is_announced = bool(packet[3] & 0x20 and packet[4] and packet[5] & 0x80)
        if counter == self._continuity and packet == self._last_packet:
            return False  # senders may repeat a packet once
        self._continuity = counter
        self._last_packet = packet
        if expected is not None and counter != expected and not jump_is_announced:
            self._counters.lost_packets += (counter - expected) & 0x0F or 16
            self._spoil()
        return True

    def _begin(self, t_us: int) -> None:
        self._parts = []
        self._size = 0
        self._stated = 0
        self._t_first_us = t_us
        self._spoilt = False
        self._ended_by_padding = False

    def _spoil(self) -> None:
        """The unit under way cannot be completed, or one between was lost whole."""
        if self._parts is not None:
            self._counters.spoilt_units += 1
        self._parts = None
        self._after_loss = True
        self._ended_by_padding = False

    def _finish(self, *, reached_end: bool) -> list[VideoUnit]:
        parts = self._parts
        self._parts = None
        if parts is None:
            return []
        pes = b"".join(parts)
        if self._stated:
            pes = pes[: self._stated]
        header = _pes_header(pes)
        if header is None or not reached_end:
            self._counters.spoilt_units += 1
            self._after_loss = True
            return []
        start, pts = header
        payload = pes[start:]
        if not payload:
            return []
        pts_us = None if pts is None else self._unwrapped(pts) * 100 // 9
        unit = VideoUnit(self._codec, payload, pts_us, self._t_first_us, self._after_loss)
        self._after_loss = False
        return [unit]

    def _unwrapped(self, pts: int) -> int:
        """PTS without its wrap at 33 bits."""
        if self._pts is not None:
            step = (pts - self._pts + _PTS_WRAP // 2) % _PTS_WRAP - _PTS_WRAP // 2
            pts = self._pts + step
        self._pts = pts
        return pts


def _payload(packet: bytes) -> bytes:
    """Payload of a TS packet; empty where it has none or its adaptation field claims too much."""
    if not packet[3] & 0x10:
        return b""
    start = 5 + packet[4] if packet[3] & 0x20 else 4
    return packet[start:]


def _is_padded(packet: bytes) -> bool:
    """Whether the adaptation field is longer than what it says it holds."""
    if not packet[3] & 0x20:
        return False
    length = packet[4]
    if length == 0:
        return True  # a single byte of padding is a field of length zero
    flags = packet[5]
    used = 1 + 6 * bool(flags & 0x10) + 6 * bool(flags & 0x08) + bool(flags & 0x04)
    if flags & 0x02 and 5 + used <= 4 + length:
        used += 1 + packet[5 + used]
    if flags & 0x01 and 5 + used <= 4 + length:
        used += 1 + packet[5 + used]
    return length > used


def _pes_header(pes: bytes) -> tuple[int, int | None] | None:
    """Where the payload begins, and the PTS in 90 kHz ticks; None if this is no video PES packet (2.4.3.6)."""
    if len(pes) < 9 or pes[0:3] != b"\x00\x00\x01" or not (0xE0 <= pes[3] <= 0xEF or pes[3] == 0xBD):
        return None
    start = 9 + pes[8]
    if pes[6] >> 6 != 2 or start > len(pes):
        return None
    if not pes[7] & 0x80 or pes[8] < 5:
        return start, None
    p = pes[9:14]
    return start, (p[0] >> 1 & 0x07) << 30 | p[1] << 22 | (p[2] >> 1) << 15 | p[3] << 7 | p[4] >> 1


def _crc32(section: bytes) -> int:
    """CRC of annex A; zero over a whole section with its own CRC."""
    crc = 0xFFFFFFFF
    for byte in section:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ 0x04C11DB7) & 0xFFFFFFFF if crc & 0x80000000 else crc << 1
    return crc
