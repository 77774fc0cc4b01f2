from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.video.annexb import START_CODE, nal_type, nal_units
from backend.video.misp import insert_sei, read_sei

PICTURE = START_CODE + b"\x67abc" + START_CODE + b"\x68de" + b"\x00\x00\x01\x65fgh"
# Written out by hand after ST 0604: user_data_unregistered, 28 bytes, UUID, status, time with 0xFF after each pair.
BY_HAND = (
    START_CODE
    + bytes.fromhex("06 05 1c 4d495350 6d696372 6f736563 74696d65 1f 0006 ff 40b9 ff 9c3e ff c123 80")
    + START_CODE
    + b"\x65fgh"
)


@given(st.integers(0, 2**64 - 1))
def test_a_stamp_survives(t_unix_us: int) -> None:
    """Any time comes back, also where its bytes look like start codes."""
    assert read_sei(insert_sei(PICTURE, t_unix_us)) == t_unix_us


def test_the_written_out_message_is_read() -> None:
    assert read_sei(BY_HAND) == 0x000640B99C3EC123


def test_the_stamp_comes_before_the_first_slice_and_changes_nothing_else() -> None:
    stamped = insert_sei(PICTURE, 1_700_000_000_000_000)

    units = list(nal_units(stamped))
    assert [nal_type(u) for u in units] == [7, 8, 6, 5]
    assert [u for u in units if nal_type(u) != 6] == list(nal_units(PICTURE))


def test_other_messages_in_the_unit_are_passed_over() -> None:
    """x264's own signature, longer than 255 bytes, stands before the stamp."""
    signature = bytes([5, 255, 60]) + bytes(range(1, 256)) + bytes(60)
    stamp = next(u for u in nal_units(insert_sei(PICTURE, 77)) if nal_type(u) == 6)
    unit = START_CODE + b"\x06" + signature + stamp[1:] + START_CODE + b"\x65x"

    assert read_sei(unit) == 77


def test_nanoseconds_are_rounded_down() -> None:
    assert read_sei(BY_HAND.replace(b"MISPmicrosectime", b"MISPnanosectime ")) == 0x000640B99C3EC123 // 1000


@pytest.mark.parametrize("unit", [PICTURE, b"", BY_HAND[:30], BY_HAND.replace(b"MISP", b"misp")])
def test_no_stamp_is_none(unit: bytes) -> None:
    assert read_sei(unit) is None


@given(st.binary(max_size=80))
def test_random_messages_never_break_reading(data: bytes) -> None:
    t_unix_us = read_sei(START_CODE + b"\x06" + data + START_CODE + b"\x65x")

    assert t_unix_us is None or b"MISP" in data


def test_misuse_is_refused() -> None:
    with pytest.raises(ValueError, match="no picture"):
        insert_sei(START_CODE + b"\x67abc", 1)
    with pytest.raises(ValueError, match="does not fit"):
        insert_sei(PICTURE, -1)
