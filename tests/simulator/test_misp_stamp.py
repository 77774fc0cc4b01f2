from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.video.misp import read_sei
from simulator.misp_stamp import stamped, time_stamp_sei


def test_message_is_as_the_standard_writes_it() -> None:
    """ST 0604: user_data_unregistered of 28 bytes: UUID, status, the time with 0xFF after each pair of bytes."""
    expected = "00000001 06 05 1c 4d495350 6d696372 6f736563 74696d65 1f 0006 ff 40b9 ff 9c3e ff c123 80"

    assert time_stamp_sei(0x000640B99C3EC123) == bytes.fromhex(expected)


@given(st.integers(0, 2**64 - 1))
def test_the_station_reads_the_same_time(t_unix_us: int) -> None:
    picture = b"\x00\x00\x00\x01\x09\xf0\x00\x00\x00\x01\x67abc\x00\x00\x01\x65fgh"

    assert read_sei(stamped(picture, t_unix_us)) == t_unix_us


def test_misuse_is_refused() -> None:
    with pytest.raises(ValueError, match="no picture"):
        stamped(b"\x00\x00\x00\x01\x67abc", 1)
    with pytest.raises(ValueError, match="does not fit"):
        time_stamp_sei(2**64)
