"""MAVLink messages to the estimator's samples: SI units, the station's time, one source per quantity.

A message whose figures are missing, not finite or beyond what the sensor can show gives nothing and is counted under a
reason. Nothing here uses a position or speed that the autopilot may have taken from GPS, except ``GnssSample`` itself.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from backend.link.sources import SourceSelector
from backend.link.timebase import BootClock
from estimator.geometry.earth import isa_pressure_alt_m
from estimator.types import (
    AirspeedSample,
    AttitudeSample,
    BarometerSample,
    CameraAttitudeSample,
    GnssSample,
    HomeSample,
    InertialSample,
    MagnetometerSample,
    Sample,
)

SYS_STATUS = 1
GPS_RAW_INT = 24
SCALED_IMU = 26
RAW_IMU = 27
SCALED_PRESSURE = 29
ATTITUDE = 30
ATTITUDE_QUATERNION = 31
VFR_HUD = 74
HIGHRES_IMU = 105
HOME_POSITION = 242
MOUNT_ORIENTATION = 265
GIMBAL_DEVICE_ATTITUDE_STATUS = 285
AIRSPEED = 295

_MILLI_UNIT_IMU = (RAW_IMU, SCALED_IMU)
_ATTITUDES = (ATTITUDE, ATTITUDE_QUATERNION)
STANDARD_GRAVITY_M_S2 = 9.80665
_MAX_SPECIFIC_FORCE_M_S2 = 400.0
_MAX_RATE_RAD_S = 75.0
_MAX_ANGLE_RAD = 4.0 * math.pi
_MIN_PRESSURE_HPA = 150.0
_MAX_PRESSURE_HPA = 1200.0
_MIN_ALT_M, _MAX_ALT_M = -1_000.0, 50_000.0
_MAX_AIRSPEED_M_S = 350.0
_UINT16_UNKNOWN = 0xFFFF
_UINT8_UNKNOWN = 0xFF
# HDOP to metres where the receiver gives no accuracy of its own.
_HDOP_TO_STD_M = 1.5
_UNKNOWN_STD_M = 5.0
_FIX_3D = 3
# time_usec is either time since boot or Unix time; no boot lasts 30 years.
SMALLEST_UNIX_US = 1_000_000_000_000_000
# A fix is older than its packet by the receiver's and autopilot's delay, never by more.
_MAX_FIX_AGE_US = 2_000_000
# A second sensor's readings would look like the first one's noise.
_FIRST_SENSOR = 0
_HIGHRES_INERTIAL = 0x3F
_HIGHRES_MAGNETIC = 0x1C0
_HIGHRES_PRESSURE = 0x200
_GIMBAL_YAW_LOCK = 16
_GIMBAL_YAW_IN_VEHICLE = 32
_GIMBAL_YAW_IN_EARTH = 64
_SENSOR_DIFFERENTIAL_PRESSURE = 16
_AIRSPEED_UNHEALTHY = 1
_ISA_TEMPERATURE_K, _ISA_LAPSE_K_M = 288.15, 0.0065
# rho / rho0 = (T / T0)^4.2559 below 11 km
_ISA_DENSITY_EXPONENT = 4.2559


@dataclass(frozen=True, slots=True)
class Received:
    """When a message came, and the clock of its sender; turns the message's own stamps into station time."""

    clock: BootClock
    t_us: int

    def boot_ms(self, time_boot_ms: int) -> int:
        """Station time of a boot time, never after receipt; the time of receipt while the clock is not known."""
        return self._bounded(self.clock.unix_from_boot(time_boot_ms * 1000))

    def usec(self, time_usec: int) -> int:
        """The same for a stamp that is time since boot or the vehicle's Unix time; zero means no stamp."""
        if time_usec == 0:
            return self.t_us
        if time_usec >= SMALLEST_UNIX_US:
            return self._bounded(self.clock.unix_from_vehicle_unix(time_usec))
        return self._bounded(self.clock.unix_from_boot(time_usec))

    def fix_usec(self, time_usec: int) -> int:
        """The same for a GNSS fix, whose stamp may be on a clock of the receiver's own."""
        t_us = self.usec(time_usec)
        return t_us if self.t_us - t_us <= _MAX_FIX_AGE_US else self.t_us

    def _bounded(self, t_us: int | None) -> int:
        return self.t_us if t_us is None else min(t_us, self.t_us)


class SampleMaker:
    """One vehicle's messages to samples; holds the choice of sources and the counts of what was dropped.

    ``raw_imu_is_scaled``: RAW_IMU carries mg and mrad/s, as ArduPilot fills it; elsewhere its unit is unknown and it is
    not used.
    """

    def __init__(self, *, raw_imu_is_scaled: bool) -> None:
        self.rejected: Counter[str] = Counter()
        inertial = (HIGHRES_IMU, RAW_IMU, SCALED_IMU) if raw_imu_is_scaled else (HIGHRES_IMU, SCALED_IMU)
        # Autopilots stream what they are asked for: one message at 50 Hz may lie beside a better one at 4 Hz.
        self._inertial = SourceSelector(inertial, enough_interval_us=50_000)
        self._pressure = SourceSelector((SCALED_PRESSURE, HIGHRES_IMU), enough_interval_us=250_000)
        self._attitude = SourceSelector((ATTITUDE_QUATERNION, ATTITUDE), enough_interval_us=60_000)
        self._camera = SourceSelector((GIMBAL_DEVICE_ATTITUDE_STATUS, MOUNT_ORIENTATION), enough_interval_us=250_000)
        self._airspeed = SourceSelector((AIRSPEED, VFR_HUD), enough_interval_us=500_000)
        self._newest_us: dict[tuple[int, type], int] = {}
        self._pressure_alt_m: float | None = None
        self._has_airspeed_sensor = False
        self._makers: dict[int, Callable[[Any, Received], list[Sample]]] = {
            SYS_STATUS: self._from_sys_status,
            GPS_RAW_INT: self._from_gps_raw_int,
            SCALED_PRESSURE: self._from_scaled_pressure,
            SCALED_IMU: self._from_scaled_imu,
            ATTITUDE: self._from_attitude,
            ATTITUDE_QUATERNION: self._from_attitude_quaternion,
            VFR_HUD: self._from_vfr_hud,
            HIGHRES_IMU: self._from_highres_imu,
            HOME_POSITION: self._from_home_position,
            MOUNT_ORIENTATION: self._from_mount_orientation,
            GIMBAL_DEVICE_ATTITUDE_STATUS: self._from_gimbal,
            AIRSPEED: self._from_airspeed,
        }
        if raw_imu_is_scaled:
            self._makers[RAW_IMU] = self._from_raw_imu

    @property
    def message_ids(self) -> frozenset[int]:
        """The ids that ``samples`` can use; others need not be decoded."""
        return frozenset(self._makers)

    def wants(self, msg_id: int, t_receive_us: int) -> bool:
        """Whether the message is worth decoding: of several inertial or attitude messages only one is."""
        if msg_id in _MILLI_UNIT_IMU:
            return msg_id in self._makers and self._inertial.accept(msg_id, t_receive_us)
        if msg_id in _ATTITUDES:
            return self._attitude.accept(msg_id, t_receive_us)
        return msg_id in self._makers

    def samples(self, msg_id: int, message: Any, clock: BootClock, t_receive_us: int) -> list[Sample]:
        """The samples of one decoded message that ``wants`` has let through, without repeats."""
        made = self._makers[msg_id](message, Received(clock, t_receive_us))
        return [sample for sample in made if self._is_new(msg_id, sample)]

    def _is_new(self, msg_id: int, sample: Sample) -> bool:
        """An autopilot repeats the last fix when asked for more than the receiver gives; a relay repeats packets."""
        key = (msg_id, type(sample))
        if self._newest_us.get(key) == sample.t_us:
            self.rejected["repeated"] += 1
            return False
        self._newest_us[key] = sample.t_us
        return True

    def _reject(self, reason: str) -> list[Sample]:
        self.rejected[reason] += 1
        return []

    # --- inertial, pressure, magnetic field ---

    def _inertial_sample(self, t_us: int, rate: tuple[float, ...], force: tuple[float, ...]) -> list[Sample]:
        if not _bounded(rate, _MAX_RATE_RAD_S) or not _bounded(force, _MAX_SPECIFIC_FORCE_M_S2):
            return self._reject("inertial out of range")
        if not any(rate) and not any(force):
            return self._reject("inertial empty")
        return [InertialSample(t_us, np.array(rate), np.array(force))]

    def _from_milli_units(self, m: Any, t_us: int) -> list[Sample]:
        rate = (m.xgyro * 1e-3, m.ygyro * 1e-3, m.zgyro * 1e-3)
        scale = STANDARD_GRAVITY_M_S2 * 1e-3
        made = self._inertial_sample(t_us, rate, (m.xacc * scale, m.yacc * scale, m.zacc * scale))
        if any((m.xmag, m.ymag, m.zmag)):
            made.append(MagnetometerSample(t_us, np.array((m.xmag, m.ymag, m.zmag), dtype=np.float64)))
        return made

    def _from_raw_imu(self, m: Any, at: Received) -> list[Sample]:
        if m.id != _FIRST_SENSOR:
            return []
        return self._from_milli_units(m, at.usec(m.time_usec))

    def _from_scaled_imu(self, m: Any, at: Received) -> list[Sample]:
        return self._from_milli_units(m, at.boot_ms(m.time_boot_ms))

    def _from_highres_imu(self, m: Any, at: Received) -> list[Sample]:
        if m.id != _FIRST_SENSOR:
            return []
        t_us = at.usec(m.time_usec)
        made: list[Sample] = []
        if m.fields_updated & _HIGHRES_INERTIAL == _HIGHRES_INERTIAL and self._inertial.accept(HIGHRES_IMU, at.t_us):
            made += self._inertial_sample(t_us, (m.xgyro, m.ygyro, m.zgyro), (m.xacc, m.yacc, m.zacc))
            if m.fields_updated & _HIGHRES_MAGNETIC == _HIGHRES_MAGNETIC and _bounded((m.xmag, m.ymag, m.zmag), 1e5):
                made.append(MagnetometerSample(t_us, np.array((m.xmag, m.ymag, m.zmag))))
        if m.fields_updated & _HIGHRES_PRESSURE and self._pressure.accept(HIGHRES_IMU, at.t_us):
            made += self._barometer_sample(t_us, m.abs_pressure)
        return made

    def _from_scaled_pressure(self, m: Any, at: Received) -> list[Sample]:
        if not self._pressure.accept(SCALED_PRESSURE, at.t_us):
            return []
        return self._barometer_sample(at.boot_ms(m.time_boot_ms), m.press_abs)

    def _barometer_sample(self, t_us: int, pressure_hpa: float) -> list[Sample]:
        if not _MIN_PRESSURE_HPA <= pressure_hpa <= _MAX_PRESSURE_HPA:
            return self._reject("pressure out of range")
        self._pressure_alt_m = float(isa_pressure_alt_m(pressure_hpa * 100.0))
        return [BarometerSample(t_us, self._pressure_alt_m)]

    # --- attitude of body and camera ---

    def _from_attitude(self, m: Any, at: Received) -> list[Sample]:
        rate = (m.rollspeed, m.pitchspeed, m.yawspeed)
        if not _bounded((m.roll, m.pitch, m.yaw), _MAX_ANGLE_RAD) or not _bounded(rate, _MAX_RATE_RAD_S):
            return self._reject("attitude out of range")
        t_us = at.boot_ms(m.time_boot_ms)
        return [AttitudeSample(t_us, _q_from_angles(m.roll, m.pitch, m.yaw), np.array(rate))]

    def _from_attitude_quaternion(self, m: Any, at: Received) -> list[Sample]:
        q = _unit_quaternion((m.q1, m.q2, m.q3, m.q4))
        rate = (m.rollspeed, m.pitchspeed, m.yawspeed)
        if q is None or not _bounded(rate, _MAX_RATE_RAD_S):
            return self._reject("attitude out of range")
        return [AttitudeSample(at.boot_ms(m.time_boot_ms), q, np.array(rate))]

    def _from_gimbal(self, m: Any, at: Received) -> list[Sample]:
        if not self._camera.accept(GIMBAL_DEVICE_ATTITUDE_STATUS, at.t_us):
            return []
        q = _unit_quaternion(m.q)
        if q is None:
            return self._reject("gimbal attitude out of range")
        # Before the two frame flags existed, the yaw lock alone told the frame.
        stated = m.flags & (_GIMBAL_YAW_IN_VEHICLE | _GIMBAL_YAW_IN_EARTH)
        yaw_is_earth = bool(m.flags & (_GIMBAL_YAW_IN_EARTH if stated else _GIMBAL_YAW_LOCK))
        return [CameraAttitudeSample(at.boot_ms(m.time_boot_ms), q, yaw_is_earth)]

    def _from_mount_orientation(self, m: Any, at: Received) -> list[Sample]:
        if not self._camera.accept(MOUNT_ORIENTATION, at.t_us):
            return []
        yaw_is_earth = not math.isfinite(m.yaw)
        angles_deg = (m.roll, m.pitch, m.yaw_absolute if yaw_is_earth else m.yaw)
        if not _bounded(angles_deg, 720.0):
            return self._reject("gimbal attitude out of range")
        q = _q_from_angles(*(math.radians(angle) for angle in angles_deg))
        return [CameraAttitudeSample(at.boot_ms(m.time_boot_ms), q, yaw_is_earth)]

    # --- airspeed ---

    def _from_sys_status(self, m: Any, _at: Received) -> list[Sample]:
        states = (
            m.onboard_control_sensors_present,
            m.onboard_control_sensors_enabled,
            m.onboard_control_sensors_health,
        )
        self._has_airspeed_sensor = all(state & _SENSOR_DIFFERENTIAL_PRESSURE for state in states)
        return []

    def _from_airspeed(self, m: Any, at: Received) -> list[Sample]:
        if m.id != _FIRST_SENSOR or m.flags & _AIRSPEED_UNHEALTHY or not self._airspeed.accept(AIRSPEED, at.t_us):
            return []
        return self._airspeed_sample(at.t_us, m.airspeed)

    def _from_vfr_hud(self, m: Any, at: Received) -> list[Sample]:
        # ArduPilot fills the field with GPS ground speed when there is no sensor, which must not reach the estimator.
        if not self._has_airspeed_sensor or not self._airspeed.accept(VFR_HUD, at.t_us):
            return []
        return self._airspeed_sample(at.t_us, m.airspeed)

    def _airspeed_sample(self, t_us: int, calibrated_m_s: float) -> list[Sample]:
        if self._pressure_alt_m is None:
            return self._reject("airspeed before pressure")
        if not 0.0 <= calibrated_m_s <= _MAX_AIRSPEED_M_S:
            return self._reject("airspeed out of range")
        temperature_ratio = 1.0 - _ISA_LAPSE_K_M * self._pressure_alt_m / _ISA_TEMPERATURE_K
        return [AirspeedSample(t_us, calibrated_m_s * temperature_ratio ** (-0.5 * _ISA_DENSITY_EXPONENT))]

    # --- positions ---

    def _from_gps_raw_int(self, m: Any, at: Received) -> list[Sample]:
        if m.fix_type < _FIX_3D:
            return []
        position = _position(m.lat, m.lon, m.alt)
        if position is None:
            return self._reject("GNSS position out of range")
        lat_rad, lon_rad, alt_amsl_m = position
        std_horizontal_m, std_vertical_m = gnss_accuracy_m(m)
        satellites = 0 if m.satellites_visible == _UINT8_UNKNOWN else m.satellites_visible
        t_us = at.fix_usec(m.time_usec)
        velocity = _gnss_velocity(m)
        return [GnssSample(t_us, lat_rad, lon_rad, alt_amsl_m, velocity, std_horizontal_m, std_vertical_m, satellites)]

    def _from_home_position(self, m: Any, at: Received) -> list[Sample]:
        position = _position(m.latitude, m.longitude, m.altitude)
        if position is None:
            return self._reject("home position out of range")
        return [HomeSample(at.t_us, *position)]


def gnss_accuracy_m(m: Any) -> tuple[float, float]:
    """One-sigma accuracy, horizontal and vertical, of a GPS_RAW_INT: the receiver's own, else from the dilution."""
    if m.h_acc:
        horizontal_m = m.h_acc * 1e-3
    else:
        horizontal_m = _UNKNOWN_STD_M if m.eph in (0, _UINT16_UNKNOWN) else m.eph * 1e-2 * _HDOP_TO_STD_M
    if m.v_acc:
        return horizontal_m, m.v_acc * 1e-3
    unknown = m.epv in (0, _UINT16_UNKNOWN)
    return horizontal_m, 2.0 * horizontal_m if unknown else m.epv * 1e-2 * _HDOP_TO_STD_M


def _gnss_velocity(m: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    # The message has no vertical speed; course is unknown at rest on many receivers.
    if _UINT16_UNKNOWN in (m.vel, m.cog):
        return np.full(3, np.nan)
    speed_m_s, course_rad = m.vel * 1e-2, math.radians(m.cog * 1e-2)
    return np.array((speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad), math.nan))


def _position(lat_e7: int, lon_e7: int, alt_mm: int) -> tuple[float, float, float] | None:
    lat_deg, lon_deg, alt_m = lat_e7 * 1e-7, lon_e7 * 1e-7, alt_mm * 1e-3
    # Autopilots fill both with zero when they do not know.
    if (lat_e7 == 0 and lon_e7 == 0) or abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
        return None
    if not _MIN_ALT_M <= alt_m <= _MAX_ALT_M:
        return None
    return math.radians(lat_deg), math.radians(lon_deg), alt_m


def _bounded(values: tuple[float, ...], limit: float) -> bool:
    # A comparison with NaN is false, so NaN is not bounded.
    return all(abs(value) <= limit for value in values)


def _q_from_angles(roll_rad: float, pitch_rad: float, yaw_rad: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """As ``estimator.geometry.rotation.q_from_euler``, of plain floats: a tenth of the time, at 50 Hz."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return np.array(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )


def _unit_quaternion(q: Any) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    out = np.array(q, dtype=np.float64)
    norm = math.sqrt(float(out @ out))
    if not 0.9 <= norm <= 1.1:
        return None
    return out / norm
