"""RTP (RFC 3550) with H.264 (RFC 6184) or H.265 (RFC 7798) to coded pictures, and the SDP that describes it. Pure."""

from __future__ import annotations

import base64
import binascii
import re
from dataclasses import dataclass

from backend.video.annexb import START_CODE
from backend.video.frames import VideoUnit

_CODECS = {"H264": "h264", "H265": "hevc", "HEVC": "hevc"}
_VIDEO = re.compile(r"m=video (\d{1,7})(?:/\d+)? RTP/S?AVPF? (.+)")
_CONNECTION = re.compile(r"^c=IN IP[46] ([^/\s]+)", re.MULTILINE)
_RTPMAP = re.compile(r"^a=rtpmap:(\d{1,3}) ([\w-]+)/(\d{1,9})", re.MULTILINE)
_FMTP = re.compile(r"^a=fmtp:(\d{1,3}) (.*)$", re.MULTILINE)
# A swapped datagram comes within a few milliseconds; waiting longer for a lost one would only hold up the picture.
_MAX_HELD = 16
_LONGEST_HOLD_US = 20_000
_MAX_UNIT_BYTES = 8_000_000


@dataclass(frozen=True, slots=True)
class RtpSession:
    """What an SDP says of its video: where it comes, how it is coded, and parameter sets as a byte stream."""

    address: str
    port: int
    payload_type: int
    codec: str
    clock_hz: int
    parameter_sets: bytes


def parse_sdp(text: str) -> RtpSession:
    """The first video that this station understands.

    Raises
    ------
    ValueError
        There is no video over RTP in H.264 or H.265.
    """
    heading, *media = re.split(r"^(?=m=)", text.replace("\r\n", "\n"), flags=re.MULTILINE)
    found = [(m, section) for section in media if (m := _VIDEO.match(section)) is not None]
    if not found:
        raise ValueError("it has no line 'm=video PORT RTP/AVP TYPE'")
    line, section = found[0]
    port = int(line.group(1))
    if not 0 < port < 65536:
        raise ValueError(f"its video port is {port}; it has to name the port to listen on")
    connection = _CONNECTION.search(section) or _CONNECTION.search(heading)
    address = connection.group(1) if connection else "0.0.0.0"  # noqa: S104  without an address any is meant
    codings = {m[1]: (m[2].upper(), int(m[3])) for m in _RTPMAP.finditer(section)}
    parameters = {m[1]: m[2] for m in _FMTP.finditer(section)}
    for payload_type in line.group(2).split():
        name, clock_hz = codings.get(payload_type, ("", 0))
        if name in _CODECS and clock_hz > 0:
            sets = _parameter_sets(parameters.get(payload_type, ""))
            return RtpSession(address, port, int(payload_type), _CODECS[name], clock_hz, sets)
    named = ", ".join(name for name, _ in codings.values()) or "none"
    raise ValueError(f"its video codings are {named}; H264 or H265 is needed")


def _parameter_sets(fmtp: str) -> bytes:
    units = []
    for field in fmtp.split(";"):
        name, _, value = field.strip().partition("=")
        if name.lower().startswith("sprop-"):
            for part in value.split(","):
                try:
                    units.append(base64.b64decode(part, validate=True))
                except (binascii.Error, ValueError):
                    continue
    return b"".join(START_CODE + u for u in units if u)


class RtpDepacketiser:
    """Datagrams of one session to units. A swapped datagram is put right; a lost one spoils its picture."""

    def __init__(self, session: RtpSession) -> None:
        self._session = session
        self.packets = 0
        self.noise_bytes = 0
        self.lost_packets = 0
        self._expected: int | None = None
        self._ssrc: bytes | None = None
        self._held: dict[int, tuple[bytes, int]] = {}
        self._parts: list[bytes] = []
        self._fragment: list[bytes] = []
        self._size = 0
        self._ticks: int | None = None
        self._last_ticks: int | None = None
        self._t_first_us = 0
        self._spoilt = False
        self._gap = False
        self._after_loss = False
        self._sets_due = True

    def receive(self, datagram: bytes, t_us: int) -> list[VideoUnit]:
        """Units that are complete with this datagram, which arrived at ``t_us``."""
        if len(datagram) < 13 or datagram[0] >> 6 != 2 or datagram[1] & 0x7F != self._session.payload_type:
            self.noise_bytes += len(datagram)
            return []
        self.packets += 1
        sequence = int.from_bytes(datagram[2:4], "big")
        if datagram[8:12] != self._ssrc:
            self._restart(datagram[8:12])
        if self._expected is None:
            self._expected = sequence
        ahead = (sequence - self._expected) & 0xFFFF
        if ahead >= 0x8000:
            return []  # late or repeated
        self._held[sequence] = (datagram, t_us)
        units = self._in_order()
        while self._held and self._gap_is_lost(t_us):
            self._pass_over_gap()
            units += self._in_order()
        return units

    def reset(self) -> None:
        """Forget everything, as after a long silence."""
        self._restart(None)

    def _restart(self, ssrc: bytes | None) -> None:
        self._ssrc = ssrc
        self._expected = None
        self._held.clear()
        self._parts, self._fragment, self._size = [], [], 0
        self._ticks = None
        self._spoilt = self._gap = False
        self._after_loss = False
        self._sets_due = True

    def _in_order(self) -> list[VideoUnit]:
        units: list[VideoUnit] = []
        while self._expected in self._held:
            datagram, t_us = self._held.pop(self._expected)
            self._expected = (self._expected + 1) & 0xFFFF
            units += self._packet(datagram, t_us)
        return units

    def _gap_is_lost(self, t_us: int) -> bool:
        return len(self._held) > _MAX_HELD or t_us - min(t for _, t in self._held.values()) > _LONGEST_HOLD_US

    def _pass_over_gap(self) -> None:
        base = self._expected or 0
        nearest = min(self._held, key=lambda s: (s - base) & 0xFFFF)
        self.lost_packets += (nearest - base) & 0xFFFF
        self._expected = nearest
        self._spoilt = self._gap = True
        self._fragment = []

    def _packet(self, datagram: bytes, t_us: int) -> list[VideoUnit]:
        payload = _rtp_payload(datagram)
        if not payload:
            return []
        units: list[VideoUnit] = []
        ticks = int.from_bytes(datagram[4:8], "big")
        if ticks != self._ticks:
            units += self._finish()  # a sender that sets no markers, or whose last packet was lost
            self._ticks = ticks
            self._t_first_us = t_us
            # What was lost may have been the end of that picture or the beginning of this one.
            self._spoilt = self._gap
        self._gap = False
        self._take(payload)
        if datagram[1] & 0x80:
            units += self._finish()
            self._ticks = None
        return units

    def _take(self, payload: bytes) -> None:
        if self._session.codec == "h264":
            header_bytes, kind, aggregate, fragment = 1, payload[0] & 0x1F, 24, 28
        else:
            header_bytes, kind, aggregate, fragment = 2, payload[0] >> 1 & 0x3F, 48, 49
        if kind == aggregate:
            at = header_bytes
            while at + 2 < len(payload):
                size = int.from_bytes(payload[at : at + 2], "big")
                self._add(payload[at + 2 : at + 2 + size])
                at += 2 + size
        elif kind == fragment and len(payload) > header_bytes + 1:
            self._take_fragment(payload, header_bytes)
        elif kind < aggregate:
            self._add(payload)

    def _take_fragment(self, payload: bytes, header_bytes: int) -> None:
        flags = payload[header_bytes]
        if flags & 0x80:
            if header_bytes == 1:
                header = bytes([payload[0] & 0xE0 | flags & 0x1F])
            else:
                header = bytes([payload[0] & 0x81 | (flags & 0x3F) << 1, payload[1]])
            self._fragment = [header]
        if not self._fragment:
            self._spoilt = True
            return
        self._fragment.append(payload[header_bytes + 1 :])
        if flags & 0x40:
            self._add(b"".join(self._fragment))
            self._fragment = []

    def _add(self, unit: bytes) -> None:
        self._size += len(unit)
        if self._size > _MAX_UNIT_BYTES:
            self._spoilt = True
        elif unit:
            self._parts += [START_CODE, unit]

    def _finish(self) -> list[VideoUnit]:
        parts, spoilt = self._parts, self._spoilt or bool(self._fragment)
        self._parts, self._fragment, self._size, self._spoilt = [], [], 0, False
        if spoilt:
            self._after_loss = True
        if spoilt or not parts or self._ticks is None:
            return []
        payload = b"".join(parts)
        if self._sets_due:
            payload = self._session.parameter_sets + payload
            self._sets_due = False
        unit = VideoUnit(self._session.codec, payload, self._pts_us(self._ticks), self._t_first_us, self._after_loss)
        self._after_loss = False
        return [unit]

    def _pts_us(self, ticks: int) -> int:
        if self._last_ticks is not None:
            step = (ticks - self._last_ticks + (1 << 31)) % (1 << 32) - (1 << 31)
            ticks = self._last_ticks + step
        self._last_ticks = ticks
        return ticks * 1_000_000 // self._session.clock_hz


def _rtp_payload(datagram: bytes) -> bytes:
    """What an RTP packet carries, without header, extension and padding; empty where it is broken."""
    start = 12 + 4 * (datagram[0] & 0x0F)
    if datagram[0] & 0x10:
        if len(datagram) < start + 4:
            return b""
        start += 4 + 4 * int.from_bytes(datagram[start + 2 : start + 4], "big")
    end = len(datagram)
    if datagram[0] & 0x20:
        end -= datagram[-1]
    return datagram[start:end]
