"""Exposure times inside pictures: MISB ST 0604's precision time stamp in H.264 SEI messages. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator

from backend.video.annexb import SEI, SLICE_IDR, SLICE_NON_IDR, START_CODE, escaped, nal_type, nal_units, unescaped

UUID_MICROSECONDS = b"MISPmicrosectime"
UUID_NANOSECONDS = b"MISPnanosectime "
_USER_DATA_UNREGISTERED = 5
# ST 0603 time stamp status: clock locked, no jump, reserved bits set.
_STATUS_LOCKED = 0x1F
_STAMP_BYTES = 11
_UNIT_START = re.compile(rb"\x00?\x00\x00\x01(.)", re.DOTALL)


def insert_sei(annexb: bytes, t_unix_us: int) -> bytes:
    """Access unit with the time stamp in front of its first slice.

    Raises
    ------
    ValueError
        There is no slice, or the time does not fit into 64 bits.
    """
    if not 0 <= t_unix_us < 1 << 64:
        raise ValueError(f"time of {t_unix_us} us does not fit a precision time stamp")
    time = t_unix_us.to_bytes(8, "big")
    spread = b"\xff".join((time[0:2], time[2:4], time[4:6], time[6:8]))
    payload = UUID_MICROSECONDS + bytes([_STATUS_LOCKED]) + spread
    message = bytes([_USER_DATA_UNREGISTERED, len(payload)]) + payload
    sei = START_CODE + bytes([SEI]) + escaped(message) + b"\x80"
    for start in _UNIT_START.finditer(annexb):
        if SLICE_NON_IDR <= start.group(1)[0] & 0x1F <= SLICE_IDR:
            return annexb[: start.start()] + sei + annexb[start.start() :]
    raise ValueError("access unit holds no picture to stamp")


def read_sei(annexb: bytes) -> int | None:
    """Unix microseconds that an access unit's precision time stamp says; None without a whole one."""
    for unit in nal_units(annexb):
        kind = nal_type(unit)
        if SLICE_NON_IDR <= kind <= SLICE_IDR:
            return None
        if kind != SEI:
            continue
        for payload_type, payload in _messages(unescaped(unit)[1:]):
            if payload_type == _USER_DATA_UNREGISTERED:
                t_unix_us = _stamp(payload)
                if t_unix_us is not None:
                    return t_unix_us
    return None


def _messages(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Messages of one SEI unit, type and payload (7.3.2.3.1); ends at the first one that is cut short."""
    at = 0
    while at < len(data) - 1:
        numbers = []
        for _ in range(2):
            number = 0
            while at < len(data) and data[at] == 0xFF:
                number += 255
                at += 1
            if at >= len(data):
                return
            numbers.append(number + data[at])
            at += 1
        kind, size = numbers
        if at + size > len(data):
            return
        yield kind, data[at : at + size]
        at += size


def _stamp(payload: bytes) -> int | None:
    uuid, spread = payload[:16], payload[17 : 17 + _STAMP_BYTES]
    if uuid not in (UUID_MICROSECONDS, UUID_NANOSECONDS) or len(spread) < _STAMP_BYTES:
        return None
    if spread[2::3] != b"\xff\xff\xff":
        return None
    time = int.from_bytes(spread[0:2] + spread[3:5] + spread[6:8] + spread[9:11], "big")
    return time if uuid == UUID_MICROSECONDS else time // 1000
