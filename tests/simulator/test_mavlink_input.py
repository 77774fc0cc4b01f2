"""Commands in noise."""

from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simulator.mavlink_input import messages_in


def command(number: int, *, version_1: bool = False) -> bytes:
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    message = mavlink.MAVLink_command_long_message(1, 1, number, 0, 1, 2, 3, 4, 5, 6, 7)
    return bytes(message.pack(sender, force_mavlink1=version_1))


@example(b"\xfd\x00", b"", False)
@given(st.binary(max_size=60), st.binary(max_size=60), st.booleans())
def test_a_command_survives_noise_around_it(before: bytes, after: bytes, version_1: bool) -> None:
    found = messages_in(before + command(400, version_1=version_1) + after)
    assert 400 in [message.command for message in found if message.get_type() == "COMMAND_LONG"]


def test_a_stray_start_byte_swallows_nothing() -> None:
    data = b"\xfd" + command(22) + b"\xfe\x02" + command(21) + b"\xfd\xff"
    assert [message.command for message in messages_in(data)] == [22, 21]


def test_damaged_and_cut_packets_are_left_out() -> None:
    damaged = bytearray(command(400))
    damaged[14] ^= 0x40
    assert messages_in(bytes(damaged)) == []
    assert messages_in(command(400)[:-3]) == []
    assert messages_in(b"") == []
