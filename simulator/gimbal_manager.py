"""Gimbal protocol v2 on the side of the vehicle: who may point the gimbal, and what it is told. No I/O, no clock."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.rotation import euler_from_q
from simulator.vehicles.gimbal import PITCH_MAX_RAD, PITCH_MIN_RAD, YAW_MAX_RAD, GimbalReport, PanTiltGimbal

_DEVICE = 1
_UNCHANGED, _MYSELF, _GIVE_BACK = -1, -2, -3
_CAPABILITIES = (
    mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_ROLL_LOCK
    | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS
    | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_LOCK
    | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_AXIS
    | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_FOLLOW
    | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_LOCK
)
_LEVEL = mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
_IN_VEHICLE, _IN_EARTH = (
    mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME,
    mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME,
)
CONFIGURE, PITCH_YAW = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW


class GimbalManager:
    """One gimbal, pointed by whoever has taken control, and by nobody before."""

    def __init__(self, gimbal: PanTiltGimbal) -> None:
        self._gimbal = gimbal
        self._primary = (0, 0)

    def command(self, message: Any) -> int:
        """Result of DO_GIMBAL_MANAGER_CONFIGURE or _PITCHYAW."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.command == CONFIGURE:
            return self._configure(sender, (message.param1, message.param2))
        if sender != self._primary:
            return int(mavlink.MAV_RESULT_DENIED)
        self._point(math.radians(message.param1), math.radians(message.param2), int(message.param5))
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def receive(self, message: Any) -> None:
        """Set-points, from who has control."""
        if (message.get_srcSystem(), message.get_srcComponent()) != self._primary:
            return
        kind = message.get_type()
        if kind == "GIMBAL_MANAGER_SET_PITCHYAW":
            self._point(message.pitch, message.yaw, message.flags)
        elif kind == "GIMBAL_MANAGER_SET_ATTITUDE" and np.all(np.isfinite(message.q)):
            _, pitch, yaw = euler_from_q(np.array(message.q))
            self._point(float(pitch), float(yaw), message.flags)

    def status(self, t_boot_us: int) -> Any:
        """GIMBAL_MANAGER_STATUS."""
        return mavlink.MAVLink_gimbal_manager_status_message(
            *(t_boot_us // 1000, _LEVEL | _IN_VEHICLE, _DEVICE, *self._primary, 0, 0)
        )

    def information(self, t_boot_us: int) -> Any:
        """GIMBAL_MANAGER_INFORMATION."""
        return mavlink.MAVLink_gimbal_manager_information_message(
            *(t_boot_us // 1000, _CAPABILITIES, _DEVICE, 0.0, 0.0, PITCH_MIN_RAD, PITCH_MAX_RAD),
            *(-YAW_MAX_RAD, YAW_MAX_RAD),
        )

    def attitude(self, t_boot_us: int, report: GimbalReport) -> Any:
        """GIMBAL_DEVICE_ATTITUDE_STATUS."""
        return mavlink.MAVLink_gimbal_device_attitude_status_message(
            *(0, 0, t_boot_us // 1000, _LEVEL | _IN_VEHICLE, report.q_level_from_gimbal.tolist()),
            *(*report.rate_rad_s.tolist(), 0, math.nan, math.nan, _DEVICE),
        )

    def _configure(self, sender: tuple[int, int], wanted: tuple[float, float]) -> int:
        if not all(math.isfinite(part) for part in wanted):
            return int(mavlink.MAV_RESULT_DENIED)
        system, component = (int(part) for part in wanted)
        if (system, component) == (_GIVE_BACK, _GIVE_BACK):
            if sender == self._primary:
                self._primary = (0, 0)
        elif _MYSELF in (system, component):
            self._primary = sender
        elif _UNCHANGED not in (system, component):
            if not (0 <= system < 256 and 0 <= component < 256):
                return int(mavlink.MAV_RESULT_DENIED)
            self._primary = (system, component)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _point(self, pitch_rad: float, yaw_rad: float, flags: int) -> None:
        # Where neither frame is named, the lock alone tells it.
        stated = flags & (_IN_VEHICLE | _IN_EARTH)
        earth = flags & _IN_EARTH if stated else flags & mavlink.GIMBAL_MANAGER_FLAGS_YAW_LOCK
        self._gimbal.point(pitch_rad, yaw_rad, from_north=bool(earth))
