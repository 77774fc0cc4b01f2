import random
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.link.dialect import MESSAGES, decode_payload, message_layouts


def _random_payload(message: Any, rng: random.Random) -> bytes:
    # Small bytes only: an exponent of all ones would make NaN, which is not equal to itself.
    return bytes(rng.randrange(100) for _ in range(message.unpacker.size))


@pytest.mark.parametrize("msg_id", sorted(MESSAGES))
def test_decodes_as_pymavlink_does(msg_id: int) -> None:
    message = MESSAGES[msg_id]
    payload = _random_payload(message, random.Random(msg_id))
    header = bytes([0xFD, len(payload), 0, 0, 0, 1, 1, msg_id & 0xFF, msg_id >> 8 & 0xFF, msg_id >> 16])
    crc = dialect.x25crc(bytearray(header[1:] + payload) + bytearray([message.crc_extra])).crc
    expected = dialect.MAVLink(None).decode(bytearray(header + payload + crc.to_bytes(2, "little")))

    assert decode_payload(msg_id, payload).to_dict() == expected.to_dict()


def test_a_truncated_payload_is_filled_with_zeros() -> None:
    message = decode_payload(30, bytes([1]))

    assert (message.time_boot_ms, message.roll, message.yawspeed) == (1, 0.0, 0.0)


def test_carriers_are_the_messages_with_long_opaque_fields() -> None:
    names = {layout.name for layout in message_layouts().values() if layout.carries_packets}

    assert {"TUNNEL", "FILE_TRANSFER_PROTOCOL", "LOG_DATA", "ENCAPSULATED_DATA", "STATUSTEXT"} <= names
    assert not {"HEARTBEAT", "ATTITUDE", "RAW_IMU", "GPS_RAW_INT", "ODOMETRY"} & names
