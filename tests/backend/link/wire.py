"""Packets for the tests of the link, made by pymavlink as a vehicle would."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

QUADROTOR, HELICOPTER, FIXED_WING, GCS = 2, 4, 1, 6
ARDUPILOT, PX4, INVALID = 3, 12, 8


class Sender:
    """A component on the wire that counts its packets."""

    def __init__(
        self, system_id: int = 1, component_id: int = 1, *, version: int = 2, key: bytes | None = None
    ) -> None:
        self._mav = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._version = version
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.sign_outgoing = True
            self._mav.signing.link_id = 0
            self._mav.signing.timestamp = 1

    def pack(self, message: Any) -> bytes:
        data = bytes(message.pack(self._mav, force_mavlink1=self._version == 1))
        self._mav.seq = (self._mav.seq + 1) % 256
        return data

    def skip(self, count: int) -> None:
        self._mav.seq = (self._mav.seq + count) % 256

    def heartbeat(
        self, mav_type: int = HELICOPTER, autopilot: int = ARDUPILOT, base_mode: int = 0x81, custom_mode: int = 4
    ) -> bytes:
        return self.pack(dialect.MAVLink_heartbeat_message(mav_type, autopilot, base_mode, custom_mode, 4, 3))

    def attitude(self, t_boot_ms: int, roll: float = 0.1, pitch: float = -0.2, yaw: float = 1.0) -> bytes:
        return self.pack(dialect.MAVLink_attitude_message(t_boot_ms, roll, pitch, yaw, 0.01, 0.02, 0.03))

    def status_text(self, text: str, severity: int = 4, text_id: int = 0, chunk: int = 0) -> bytes:
        return self.pack(dialect.MAVLink_statustext_message(severity, text.encode(), text_id, chunk))

    def ack(self, command: int, result: int, progress: int = 255) -> bytes:
        return self.pack(dialect.MAVLink_command_ack_message(command, result, progress, 0, 255, 190))


def parsed(packets: list[bytes]) -> list[Any]:
    """What the vehicle makes of packets sent to it, by pymavlink's own parser."""
    mav = dialect.MAVLink(None)
    return [message for packet in packets for message in mav.parse_buffer(packet) or []]
