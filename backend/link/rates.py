"""Asks a vehicle for the messages the station lives on, one by one, and falls back where it refuses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.commands import CommandStep
from backend.link.events import CommandResult, CommandStatus

SET_MESSAGE_INTERVAL = 511
_REFUSED = (CommandStatus.DENIED, CommandStatus.FAILED, CommandStatus.TEMPORARILY_REJECTED)
_SILENT = (CommandStatus.UNSUPPORTED, CommandStatus.TIMEOUT)

# For an IP link; conventions for the messages in ``backend.link.samples`` and ``telemetry``.
DEFAULT_RATES_HZ: Mapping[int, float] = {
    30: 25.0,  # ATTITUDE
    105: 50.0,  # HIGHRES_IMU
    27: 50.0,  # RAW_IMU
    29: 10.0,  # SCALED_PRESSURE
    24: 5.0,  # GPS_RAW_INT
    33: 5.0,  # GLOBAL_POSITION_INT
    2: 1.0,  # SYSTEM_TIME
    1: 1.0,  # SYS_STATUS
    74: 4.0,  # VFR_HUD
    42: 1.0,  # MISSION_CURRENT
    147: 0.5,  # BATTERY_STATUS
    242: 0.2,  # HOME_POSITION
    285: 10.0,  # GIMBAL_DEVICE_ATTITUDE_STATUS
    168: 1.0,  # WIND, of ArduPilot
    231: 1.0,  # WIND_COV, of PX4
}
# Stream ids of REQUEST_DATA_STREAM (raw sensors, extended status, position, extra 1, 2, 3) and their rates.
_STREAM_RATES_HZ = {1: 25, 2: 2, 6: 5, 10: 25, 11: 4, 12: 2}


@dataclass(slots=True)
class RateRequests:
    """The requests to one vehicle: ``begin`` after it appears, reboots or returns, then feed it the results."""

    rates_hz: Mapping[int, float]
    _asked: dict[int, tuple[int, float]] = field(default_factory=dict)  # command id -> message id, rate
    granted_hz: dict[int, float] = field(default_factory=dict)
    fell_back: bool = False
    _streams_asked: bool = False

    def begin(self) -> list[tuple[int, float]]:
        """Message ids and rates to ask for now."""
        self._asked.clear()
        self.granted_hz.clear()
        self.fell_back = False
        self._streams_asked = False
        return list(self.rates_hz.items())

    def step(self, command_id: int, msg_id: int, rate_hz: float) -> CommandStep:
        """The command that asks for one message; its id ties the answer to it."""
        self._asked[command_id] = (msg_id, rate_hz)
        return CommandStep(SET_MESSAGE_INTERVAL, (float(msg_id), 1e6 / rate_hz))

    def result(self, result: CommandResult) -> tuple[int, float] | None:
        """Take an answer; gives a message and a lower rate to ask for when the vehicle refused the first."""
        asked = self._asked.pop(result.command_id, None)
        if asked is None or not result.final:
            return None
        msg_id, rate_hz = asked
        if result.status is CommandStatus.ACCEPTED:
            self.granted_hz[msg_id] = rate_hz
        elif result.status in _REFUSED and rate_hz == self.rates_hz.get(msg_id):
            # A plane's autopilot refuses 50 Hz and grants 25.
            return msg_id, 0.5 * rate_hz
        elif result.status in _SILENT and not self.granted_hz:
            self.fell_back = True
        return None

    def fallback_messages(self, system_id: int, component_id: int) -> list[Any]:
        """REQUEST_DATA_STREAM, once, for an autopilot that has shown not to know SET_MESSAGE_INTERVAL."""
        if not self.fell_back or self._streams_asked:
            return []
        self._streams_asked = True
        return [
            _dialect.MAVLink_request_data_stream_message(system_id, component_id, stream, rate_hz, 1)
            for stream, rate_hz in _STREAM_RATES_HZ.items()
        ]
