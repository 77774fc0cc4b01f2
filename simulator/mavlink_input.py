"""Finds MAVLink packets in whatever arrives; noise costs only itself."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_V1_MARK, _V2_MARK = 0xFE, 0xFD
_SIGNED = 0x01


def messages_in(data: bytes) -> list[Any]:
    """All messages with a right checksum in one datagram, in order."""
    decoder = mavlink.MAVLink(None)
    found, at = [], 0
    while at < len(data):
        size = _packet_bytes(data, at)
        if size is None or at + size > len(data):
            at += 1
            continue
        try:
            message = decoder.decode(bytearray(data[at : at + size]))
        except mavlink.MAVError:
            at += 1
            continue
        if isinstance(message, mavlink.MAVLink_unknown):
            # of an unknown id the checksum cannot be told, and noise that looks so must not swallow what follows
            at += 1
            continue
        found.append(message)
        at += size
    return found


def _packet_bytes(data: bytes, at: int) -> int | None:
    if data[at] == _V2_MARK and at + 12 <= len(data):
        return 12 + data[at + 1] + (13 if data[at + 2] & _SIGNED else 0)
    if data[at] == _V1_MARK and at + 8 <= len(data):
        return 8 + data[at + 1]
    return None
