"""The exposure time inside the picture: MISB ST 0604's precision time stamp as an H.264 SEI message.

The station reads the same message with its own code; the two meet on the wire only.
"""

from __future__ import annotations

import re

MISP_UUID = b"MISPmicrosectime"
# ST 0603 time stamp status: clock locked, no jump, reserved bits set.
_STATUS_LOCKED = 0x1F
_SEI_HEADER = b"\x00\x00\x00\x01\x06\x05"
# A slice (types 1 to 5) behind its start code; the zero before a four-byte start code belongs to the code.
_FIRST_SLICE = re.compile(rb"\x00?\x00\x00\x01[\x01-\x05\x21-\x25\x41-\x45\x61-\x65]", re.DOTALL)


def time_stamp_sei(t_unix_us: int) -> bytes:
    """SEI unit with its start code that says when the picture was taken, Unix microseconds.

    Raises
    ------
    ValueError
        The time does not fit into 64 bits.
    """
    if not 0 <= t_unix_us < 1 << 64:
        raise ValueError(f"time of {t_unix_us} us does not fit a precision time stamp")
    time = t_unix_us.to_bytes(8, "big")
    # 0xFF between pairs of bytes keeps start codes from appearing (ST 0604, modified precision time stamp).
    spread = b"\xff".join((time[0:2], time[2:4], time[4:6], time[6:8]))
    payload = MISP_UUID + bytes([_STATUS_LOCKED]) + spread
    return _SEI_HEADER + bytes([len(payload)]) + payload + b"\x80"


def stamped(access_unit: bytes, t_unix_us: int) -> bytes:
    """Access unit (byte stream) with the time stamp in front of its first slice.

    Raises
    ------
    ValueError
        There is no slice, or the time does not fit.
    """
    first = _FIRST_SLICE.search(access_unit)
    if first is None:
        raise ValueError("access unit holds no picture to stamp")
    return access_unit[: first.start()] + time_stamp_sei(t_unix_us) + access_unit[first.start() :]
