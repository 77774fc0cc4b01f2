"""What the autopilot tells, each message at its own rate, packed as ArduPilot packs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import euler_from_q
from estimator.types import Float
from simulator.gimbal_manager import GimbalManager
from simulator.sensors.gnss import GnssFix
from simulator.vehicles.gimbal import GimbalReport
from simulator.vehicles.kinds import VEHICLES, VehicleKind
from simulator.vehicles.pilot import FlightMode

_DEFAULT_RATE_HZ = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 25.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 0.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 10.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 0.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 0.0,
}
_GIMBAL_RATE_HZ = {
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 25.0,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: 0.0,
}
_MAX_RATE_HZ = 50.0
_CELLS = 6
_CAPACITY_S = 45 * 60.0

# Fields of HIGHRES_IMU that are new: accelerometers, gyros, magnetometer, and the barometer's when it has read.
_IMU_FIELDS = 0x1FF
_BARO_FIELDS = 0x200 | 0x800


@dataclass(slots=True)
class Snapshot:
    """The newest values of everything that is told."""

    t_boot_us: int
    t_unix_us: int
    mode: FlightMode
    armed: bool
    rate_body_rad_s: Float
    specific_force_body_m_s2: Float
    field_body_gauss: Float
    pressure_pa: float
    pressure_alt_m: float
    baro_is_new: bool
    q_believed: Float
    pos_believed_ned_m: Float
    vel_believed_ned_m_s: Float
    fix: GnssFix | None
    airspeed_m_s: float
    home_ned_m: Float
    gimbal: GimbalReport | None = None
    mission_seq: int = 0
    mission_total: int = 0


class Telemetry:
    """Packs the messages that are due; packets come out in the order they are to be sent."""

    def __init__(
        self, system_id: int, frame: LocalFrame, gimbal: GimbalManager | None = None,
        kind: VehicleKind = VEHICLES["helicopter"],
    ) -> None:  # fmt: skip
        self._kind = kind
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._frame = frame
        self._rates_hz = _DEFAULT_RATE_HZ if gimbal is None else _DEFAULT_RATE_HZ | _GIMBAL_RATE_HZ
        self._streams = {message: _Stream(_interval_us(rate)) for message, rate in self._rates_hz.items()}
        self._build: dict[int, Callable[[Snapshot], Any]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self._home,
            mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: self._highres_imu,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps_raw,
            mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: self._pressure,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._vfr_hud,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: self._mission_current,
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self._origin,
        }
        if gimbal is not None:
            self._build |= {
                mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: lambda now: (
                    None if now.gimbal is None else gimbal.attitude(now.t_boot_us, now.gimbal)
                ),
                mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: lambda now: gimbal.status(now.t_boot_us),
                mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: lambda now: gimbal.information(now.t_boot_us),
            }

    def pack(self, message: Any) -> bytes:
        """One packet with the next sequence number."""
        packed: bytes = message.pack(self._mav)
        return packed

    def due(self, now: Snapshot) -> list[bytes]:
        """Packets whose time has come."""
        packets = []
        for message, stream in self._streams.items():
            if stream.is_due(now.t_boot_us):
                built = self._build[message](now)
                if built is not None:
                    packets.append(self.pack(built))
        return packets

    def one(self, message: int, now: Snapshot) -> bytes | None:
        """One message on request, None when it is not known or has nothing to tell."""
        build = self._build.get(message)
        built = build(now) if build is not None else None
        return None if built is None else self.pack(built)

    def set_interval(self, message: int, interval_us: float) -> bool:
        """Change a rate: 0 restores the default, -1 stops it. False when the message is not known."""
        stream = self._streams.get(message)
        if stream is None or not np.isfinite(interval_us):
            return False
        if interval_us == 0:
            stream.interval_us = _interval_us(self._rates_hz[message])
        elif interval_us < 0:
            stream.interval_us = 0
        else:
            stream.interval_us = max(int(interval_us), int(1e6 / _MAX_RATE_HZ))
        return True

    def _heartbeat(self, now: Snapshot) -> Any:
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        flags |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_HIL_ENABLED
        if now.mode in (FlightMode.AUTO, FlightMode.GUIDED, FlightMode.RTL, FlightMode.LAND):
            flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        if now.mode is FlightMode.AUTO:
            flags |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED
        if now.armed:
            flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        state = mavlink.MAV_STATE_ACTIVE if now.armed else mavlink.MAV_STATE_STANDBY
        kind, autopilot = self._kind, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        return mavlink.MAVLink_heartbeat_message(kind.mav_type, autopilot, flags, kind.modes[now.mode], state, 3)

    def _sys_status(self, now: Snapshot) -> Any:
        present = mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
        present |= mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
        present |= mavlink.MAV_SYS_STATUS_SENSOR_GPS | mavlink.MAV_SYS_STATUS_AHRS
        healthy = present
        if now.fix is None or not now.fix.has_fix:
            healthy &= ~mavlink.MAV_SYS_STATUS_SENSOR_GPS
        voltage, current, remaining = _battery(now.t_boot_us)
        return mavlink.MAVLink_sys_status_message(
            *(present, present, healthy, 310, round(voltage * 1000), round(current * 100), remaining),
            *(0, 0, 0, 0, 0, 0),
        )

    def _system_time(self, now: Snapshot) -> Any:
        return mavlink.MAVLink_system_time_message(now.t_unix_us, now.t_boot_us // 1000)

    def _battery(self, now: Snapshot) -> Any:
        voltage, current, remaining = _battery(now.t_boot_us)
        cells = [round(voltage / _CELLS * 1000)] * _CELLS + [0xFFFF] * (10 - _CELLS)
        used_mah = round(current * now.t_boot_us / 3.6e6)
        return mavlink.MAVLink_battery_status_message(
            0, 0, 1, 32767, cells, round(current * 100), used_mah, -1, remaining
        )

    def _mission_current(self, now: Snapshot) -> Any:
        return mavlink.MAVLink_mission_current_message(now.mission_seq, max(now.mission_total - 1, 0))

    def _home(self, now: Snapshot) -> Any:
        lat, lon, alt = self._geodetic(now.home_ned_m)
        return mavlink.MAVLink_home_position_message(
            *(lat, lon, alt, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0), now.t_boot_us
        )

    def _origin(self, now: Snapshot) -> Any:
        """Its local frame begins at home."""
        return mavlink.MAVLink_gps_global_origin_message(*self._geodetic(now.home_ned_m), now.t_boot_us)

    def _highres_imu(self, now: Snapshot) -> Any:
        fields = _IMU_FIELDS | (_BARO_FIELDS if now.baro_is_new else 0)
        now.baro_is_new = False
        return mavlink.MAVLink_highres_imu_message(
            now.t_boot_us,
            *now.specific_force_body_m_s2.tolist(),
            *now.rate_body_rad_s.tolist(),
            *now.field_body_gauss.tolist(),
            *(now.pressure_pa / 100.0, 0.0, now.pressure_alt_m, 31.0, fields),
        )

    def _attitude(self, now: Snapshot) -> Any:
        angles = (float(angle) for angle in euler_from_q(now.q_believed))
        return mavlink.MAVLink_attitude_message(now.t_boot_us // 1000, *angles, *now.rate_body_rad_s.tolist())

    def _attitude_quaternion(self, now: Snapshot) -> Any:
        return mavlink.MAVLink_attitude_quaternion_message(
            now.t_boot_us // 1000, *now.q_believed.tolist(), *now.rate_body_rad_s.tolist()
        )

    def _global_position(self, now: Snapshot) -> Any:
        lat, lon, alt = self._geodetic(now.pos_believed_ned_m)
        _, _, home_alt = self._geodetic(now.home_ned_m)
        velocity = [round(100 * v) for v in now.vel_believed_ned_m_s.tolist()]
        heading = round(100 * np.degrees(float(euler_from_q(now.q_believed)[2]))) % 36000
        return mavlink.MAVLink_global_position_int_message(
            now.t_boot_us // 1000, lat, lon, alt, alt - home_alt, *velocity, heading
        )

    def _gps_raw(self, now: Snapshot) -> Any:
        fix = now.fix
        if fix is None:
            return None
        lat, lon, alt = self._geodetic(fix.pos_ned_m)
        kind = mavlink.GPS_FIX_TYPE_3D_FIX if fix.has_fix else mavlink.GPS_FIX_TYPE_NO_FIX
        north, east = fix.vel_ned_m_s[:2].tolist()
        course = round(100 * np.degrees(np.arctan2(east, north))) % 36000
        dilution = (80, 120) if fix.has_fix else (9999, 9999)
        h_acc, v_acc = (round(1000 * std) if fix.has_fix else 0 for std in (fix.std_horizontal_m, fix.std_vertical_m))
        return mavlink.MAVLink_gps_raw_int_message(
            *(now.t_boot_us, kind, lat, lon, alt, *dilution, round(100 * float(np.hypot(north, east))), course),
            fix.satellites,
            *(alt, h_acc, v_acc, 200 if fix.has_fix else 0, 0, 0),
        )

    def _pressure(self, now: Snapshot) -> Any:
        return mavlink.MAVLink_scaled_pressure_message(now.t_boot_us // 1000, now.pressure_pa / 100.0, 0.0, 3100)

    def _vfr_hud(self, now: Snapshot) -> Any:
        north, east, down = now.vel_believed_ned_m_s.tolist()
        heading = round(np.degrees(float(euler_from_q(now.q_believed)[2]))) % 360
        alt = self._geodetic(now.pos_believed_ned_m)[2] / 1000.0
        return mavlink.MAVLink_vfr_hud_message(
            now.airspeed_m_s, float(np.hypot(north, east)), heading, 55 if now.armed else 0, alt, -down
        )

    def _local_position(self, now: Snapshot) -> Any:
        offset = (now.pos_believed_ned_m - now.home_ned_m).tolist()
        return mavlink.MAVLink_local_position_ned_message(
            now.t_boot_us // 1000, *offset, *now.vel_believed_ned_m_s.tolist()
        )

    def _geodetic(self, pos_ned_m: Float) -> tuple[int, int, int]:
        lat, lon, alt = self._frame.geodetic_from_ned(pos_ned_m)
        return round(np.degrees(float(lat)) * 1e7), round(np.degrees(float(lon)) * 1e7), round(float(alt) * 1000)


@dataclass(slots=True)
class _Stream:
    interval_us: int
    next_us: int = field(default=0)

    def is_due(self, t_us: int) -> bool:
        if self.interval_us <= 0 or t_us < self.next_us:
            return False
        # Steady on its own grid; at the start and after a pause it does not catch up.
        late_us = t_us - self.next_us
        self.next_us = self.next_us + self.interval_us if late_us < self.interval_us else t_us + self.interval_us
        return True


def _interval_us(rate_hz: float) -> int:
    return round(1e6 / rate_hz) if rate_hz > 0 else 0


def _battery(t_boot_us: int) -> tuple[float, float, int]:
    """Voltage, current and per cent left; somebody keeps changing packs."""
    left = 1.0 - (t_boot_us / 1e6 % _CAPACITY_S) / _CAPACITY_S
    return _CELLS * (3.55 + 0.6 * left), 38.0, round(100 * left)
