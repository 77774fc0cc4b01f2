"""The gimbal of one vehicle by gimbal protocol v2: control is asked for, seen to be given, used, and handed back.

The manager is the component that sends GIMBAL_MANAGER_INFORMATION or GIMBAL_MANAGER_STATUS; until one has, the
autopilot is asked, which manages the gimbals of most vehicles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.commands import CommandStep
from backend.link.framing import RawPacket

GIMBAL_MANAGER_INFORMATION, GIMBAL_MANAGER_STATUS = 280, 281
_REQUEST_MESSAGE = 512
_SET_MESSAGE_INTERVAL = 511
_CONFIGURE = 1001
_UNCHANGED, _REMOVE = -1.0, -3.0
_ALL_DEVICES = 0
_STATUS_PERIOD_US = 1e6
# Roll and pitch are held against the horizon, yaw goes with the vehicle.
_FOLLOWING_YAW = (
    _dialect.GIMBAL_MANAGER_FLAGS_ROLL_LOCK
    | _dialect.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
    | _dialect.GIMBAL_MANAGER_FLAGS_YAW_IN_VEHICLE_FRAME
)
_LOCKED_YAW = (
    _dialect.GIMBAL_MANAGER_FLAGS_ROLL_LOCK
    | _dialect.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
    | _dialect.GIMBAL_MANAGER_FLAGS_YAW_LOCK
    | _dialect.GIMBAL_MANAGER_FLAGS_YAW_IN_EARTH_FRAME
)


@dataclass(frozen=True, slots=True)
class GimbalManager:
    """What is known of the manager: its component, and who may point the gimbal (system, component); 0 is nobody."""

    component_id: int
    t_us: int
    primary: tuple[int, int] | None = None

    def obeys(self, system_id: int, component_id: int) -> bool:
        """Whether it says that this station has control."""
        return self.primary == (system_id, component_id)


class Gimbals:
    """Listens to the gimbal managers of a system id, and says what to send to the first."""

    def __init__(self, autopilot_id: int) -> None:
        self._autopilot_id = autopilot_id
        self._managers: dict[int, GimbalManager] = {}

    @property
    def manager(self) -> GimbalManager | None:
        """The first that was heard: a vehicle with several is pointed by its lowest component; None before one was."""
        return min(self._managers.values(), key=lambda manager: manager.component_id, default=None)

    @property
    def component_id(self) -> int:
        """Who is asked."""
        manager = self.manager
        return self._autopilot_id if manager is None else manager.component_id

    def receive(self, packet: RawPacket, t_us: int) -> None:
        """Take any packet of the vehicle."""
        if not packet.known or packet.msg_id not in (GIMBAL_MANAGER_INFORMATION, GIMBAL_MANAGER_STATUS):
            return
        known = self._managers.get(packet.component_id)
        primary = None if known is None else known.primary
        if packet.msg_id == GIMBAL_MANAGER_STATUS:
            status = packet.decode()
            primary = int(status.primary_control_sysid), int(status.primary_control_compid)
        self._managers[packet.component_id] = GimbalManager(packet.component_id, t_us, primary)


def take_control(system_id: int, component_id: int) -> Sequence[CommandStep]:
    """Ask for control of all gimbals, then for the status that shows whether it was given, once a second."""
    return (
        CommandStep(
            _CONFIGURE, (float(system_id), float(component_id), _UNCHANGED, _UNCHANGED, 0.0, 0.0, _ALL_DEVICES)
        ),
        CommandStep(_SET_MESSAGE_INTERVAL, (float(GIMBAL_MANAGER_STATUS), _STATUS_PERIOD_US)),
    )


def release_control() -> Sequence[CommandStep]:
    """Hand control back, if it is ours: who has taken it meanwhile keeps it."""
    return (CommandStep(_CONFIGURE, (_REMOVE, _REMOVE, _UNCHANGED, _UNCHANGED, 0.0, 0.0, _ALL_DEVICES)),)


def pitch_yaw(system_id: int, component_id: int, pitch_rad: float, yaw_rad: float, *, earth: bool = False) -> Any:
    """GIMBAL_MANAGER_SET_PITCHYAW (287): pitch up from the horizon, yaw to the right of the vehicle's nose.

    With ``earth`` the yaw is from north instead. The rates are left to the gimbal.
    """
    if not (math.isfinite(pitch_rad) and math.isfinite(yaw_rad)):
        message = f"a gimbal cannot be pointed to pitch {pitch_rad}, yaw {yaw_rad}"
        raise ValueError(message)
    return _dialect.MAVLink_gimbal_manager_set_pitchyaw_message(
        system_id, component_id, _LOCKED_YAW if earth else _FOLLOWING_YAW, _ALL_DEVICES, pitch_rad, yaw_rad, math.nan,
        math.nan,
    )  # fmt: skip
