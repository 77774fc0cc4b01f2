import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.link import samples as s
from backend.link.timebase import BootClock
from estimator.geometry.rotation import euler_from_q, q_from_euler
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

UNIX_US = 1_760_000_000_000_000
NAN = math.nan


class Station:
    """A sample maker with a clock that was set when the vehicle had run ten seconds."""

    def __init__(self, *, raw_imu_is_scaled: bool = True) -> None:
        self.maker = s.SampleMaker(raw_imu_is_scaled=raw_imu_is_scaled)
        self.clock = BootClock()
        self.clock.observe(10_000_000, UNIX_US)

    def take(self, message: Any, t_us: int = UNIX_US + 100_000) -> list[Sample]:
        # Not message.id: some messages have a field of that name.
        msg_id = message.get_msgId()
        if not self.maker.wants(msg_id, t_us):
            return []
        return self.maker.samples(msg_id, message, self.clock, t_us)

    def one(self, message: Any) -> Any:
        made = self.take(message)
        assert len(made) == 1
        return made[0]


def gps(**changes: Any) -> Any:
    fields: dict[str, Any] = {
        "time_usec": 10_050_000,
        "fix_type": 3,
        "lat": 583_000_000,
        "lon": 155_000_000,
        "alt": 130_500,
        "eph": 120,
        "epv": 200,
        "vel": 500,
        "cog": 9_000,
        "satellites_visible": 12,
        "h_acc": 800,
        "v_acc": 1_200,
    }
    return dialect.MAVLink_gps_raw_int_message(**(fields | changes))


def highres(fields_updated: int = 0xFFFF, **changes: Any) -> Any:
    fields: dict[str, Any] = {
        "time_usec": 10_050_000,
        "xacc": 0.1,
        "yacc": -0.2,
        "zacc": -9.8,
        "xgyro": 0.01,
        "ygyro": -0.02,
        "zgyro": 0.03,
        "xmag": 0.2,
        "ymag": 0.0,
        "zmag": 0.4,
        "abs_pressure": 1000.0,
        "diff_pressure": 0.0,
        "pressure_alt": 0.0,
        "temperature": 20.0,
    }
    return dialect.MAVLink_highres_imu_message(**(fields | {"fields_updated": fields_updated} | changes))


def sys_status(sensors: int) -> Any:
    return dialect.MAVLink_sys_status_message(sensors, sensors, sensors, 0, 12_000, 0, 80, 0, 0, 0, 0, 0, 0)


def vfr_hud(airspeed: float) -> Any:
    return dialect.MAVLink_vfr_hud_message(airspeed, 15.0, 90, 50, 130.0, 0.0)


def test_raw_imu_of_ardupilot_is_in_milli_g_and_milli_rad() -> None:
    inertial, magnetic = Station().take(
        dialect.MAVLink_raw_imu_message(10_050_000, 100, -200, -1000, 10, -20, 30, 200, 0, 400)
    )

    assert isinstance(inertial, InertialSample)
    assert isinstance(magnetic, MagnetometerSample)
    assert inertial.t_us == UNIX_US + 50_000
    assert_allclose(inertial.specific_force_body_m_s2, [0.980665, -1.96133, -9.80665])
    assert_allclose(inertial.rate_body_rad_s, [0.01, -0.02, 0.03])


def test_raw_imu_of_others_has_no_known_unit() -> None:
    message = dialect.MAVLink_raw_imu_message(10_050_000, 1, 2, 3, 4, 5, 6, 7, 8, 9)

    assert Station(raw_imu_is_scaled=False).take(message) == []


def test_highres_imu_gives_all_that_it_says_is_new() -> None:
    made = Station().take(highres())
    assert [type(x) for x in made] == [InertialSample, MagnetometerSample, BarometerSample]
    inertial = made[0]
    assert isinstance(inertial, InertialSample)
    assert_allclose(inertial.specific_force_body_m_s2, [0.1, -0.2, -9.8])

    assert [type(x) for x in Station().take(highres(fields_updated=0x3F))] == [InertialSample]
    assert Station().take(highres(fields_updated=0x07)) == []


def test_a_second_sensor_is_left_out() -> None:
    raw = dialect.MAVLink_raw_imu_message(10_050_000, 0, 0, -1000, 1, 1, 1, 0, 0, 0, id=1)

    assert Station().take(raw) == []
    assert Station().take(highres(id=1)) == []


def test_only_one_inertial_source() -> None:
    station = Station()
    used = []
    for i in range(200):
        t_us = UNIX_US + 20_000 * i
        t_boot_us = 10_000_000 + 20_000 * i
        used += station.take(dialect.MAVLink_raw_imu_message(t_boot_us, 0, 0, -1000, 1, 1, 1, 0, 0, 0), t_us)
        used += station.take(highres(time_usec=t_boot_us), t_us)
    inertial = [x for x in used if isinstance(x, InertialSample)]

    # The other serves until the better one has shown that it flows.
    assert 199 <= len(inertial) <= 201
    assert all(x.specific_force_body_m_s2[2] == -9.8 for x in inertial[60:])


def test_attitude_and_its_quaternion_agree() -> None:
    by_angles = Station().one(dialect.MAVLink_attitude_message(10_050, 0.1, -0.2, 3.0, 0.01, 0.02, 0.03))
    q = by_angles.q_ned_from_body
    by_quaternion = Station().one(dialect.MAVLink_attitude_quaternion_message(10_050, *q, 0.01, 0.02, 0.03))

    assert isinstance(by_angles, AttitudeSample)
    assert_allclose(euler_from_q(q), (0.1, -0.2, 3.0))
    assert_allclose(by_quaternion.q_ned_from_body, q)
    assert by_quaternion.t_us == by_angles.t_us == UNIX_US + 50_000
    assert_allclose(by_angles.rate_body_rad_s, [0.01, 0.02, 0.03])


def test_pressure_is_standard_atmosphere_altitude() -> None:
    sample = Station().one(dialect.MAVLink_scaled_pressure_message(10_050, 898.7457, 0.0, 2000))

    # US Standard Atmosphere 1976: 898.7457 hPa at 1000 m (geopotential).
    assert isinstance(sample, BarometerSample)
    assert abs(sample.pressure_alt_m - 1000.0) < 1.0


def test_gnss_units() -> None:
    fix = Station().one(gps())

    assert isinstance(fix, GnssSample)
    assert fix.t_us == UNIX_US + 50_000
    assert_allclose(np.degrees([fix.lat_rad, fix.lon_rad]), [58.3, 15.5])
    assert fix.alt_amsl_m == 130.5
    assert_allclose(fix.vel_ned_m_s, [0.0, 5.0, NAN], atol=1e-12)
    assert (fix.std_horizontal_m, fix.std_vertical_m, fix.satellites) == (0.8, 1.2, 12)


@pytest.mark.parametrize("bad", [{"fix_type": 2}, {"lat": 0, "lon": 0}, {"lat": 910_000_000}, {"alt": 90_000_000}])
def test_no_fix_no_sample(bad: dict[str, int]) -> None:
    assert Station().take(gps(**bad)) == []


def test_gnss_accuracy_from_dilution_when_the_receiver_gives_none() -> None:
    fix = Station().one(gps(h_acc=0, v_acc=0))
    assert_allclose((fix.std_horizontal_m, fix.std_vertical_m), (1.8, 3.0))

    fix = Station().one(gps(h_acc=0, v_acc=0, eph=65535, epv=65535, vel=65535, satellites_visible=255))
    assert_allclose((fix.std_horizontal_m, fix.std_vertical_m), (5.0, 10.0))
    assert np.isnan(fix.vel_ned_m_s).all()
    assert fix.satellites == 0


@pytest.mark.parametrize("stamp", [0, 1_600_000_000_000_000, 100, 4_000_000_000])
def test_a_fix_with_a_foreign_stamp_is_taken_at_its_receipt(stamp: int) -> None:
    assert Station().one(gps(time_usec=stamp)).t_us == UNIX_US + 100_000


def test_a_repeated_fix_is_one_fix() -> None:
    station = Station()
    assert len([x for _ in range(5) for x in station.take(gps())]) == 1
    assert station.maker.rejected["repeated"] == 4


def test_home() -> None:
    home = Station().one(
        dialect.MAVLink_home_position_message(583_000_000, 155_000_000, 52_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
    )

    assert isinstance(home, HomeSample)
    assert_allclose((np.degrees(home.lat_rad), np.degrees(home.lon_rad), home.alt_amsl_m), (58.3, 15.5, 52.0))


@pytest.mark.parametrize(("flags", "earth"), [(0, False), (16, True), (32, False), (48, False), (64, True), (80, True)])
def test_gimbal_yaw_frame(flags: int, earth: bool) -> None:
    sample = Station().one(
        dialect.MAVLink_gimbal_device_attitude_status_message(
            0, 0, 10_050, flags, [math.sqrt(0.5), 0, -math.sqrt(0.5), 0], 0, 0, 0, 0
        )
    )

    assert isinstance(sample, CameraAttitudeSample)
    assert sample.yaw_is_earth is earth
    assert_allclose(sample.q_ned_from_gimbal, [math.sqrt(0.5), 0, -math.sqrt(0.5), 0])


def test_mount_orientation() -> None:
    relative = Station().one(dialect.MAVLink_mount_orientation_message(10_050, 1.0, -45.0, 30.0, 120.0))
    absolute = Station().one(dialect.MAVLink_mount_orientation_message(10_050, 1.0, -45.0, NAN, 120.0))

    assert (relative.yaw_is_earth, absolute.yaw_is_earth) == (False, True)
    assert_allclose(np.degrees(euler_from_q(relative.q_ned_from_gimbal)), (1.0, -45.0, 30.0))
    assert_allclose(np.degrees(euler_from_q(absolute.q_ned_from_gimbal)), (1.0, -45.0, 120.0))


def test_airspeed_of_the_head_up_figures_needs_a_sensor() -> None:
    """Without one ArduPilot fills the field with GPS ground speed."""
    station = Station()
    station.take(dialect.MAVLink_scaled_pressure_message(10_050, 795.0, 0.0, 2000))
    assert station.take(vfr_hud(20.0)) == []

    station.take(sys_status(sensors=16))
    sample = station.one(vfr_hud(20.0))
    assert isinstance(sample, AirspeedSample)
    # 795 hPa is 2000 m, where the density is 0.8216 of that at sea level (US Standard Atmosphere 1976).
    assert abs(sample.airspeed_m_s - 20.0 / math.sqrt(0.8216)) < 0.02

    station.take(sys_status(sensors=0))
    assert station.take(vfr_hud(20.0), UNIX_US + 200_000) == []


@pytest.mark.parametrize(
    "message",
    [
        dialect.MAVLink_attitude_message(10_050, NAN, 0.0, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_attitude_message(10_050, 0.0, 1e9, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_attitude_message(10_050, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0),
        dialect.MAVLink_attitude_quaternion_message(10_050, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_attitude_quaternion_message(10_050, NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_scaled_pressure_message(10_050, 0.0, 0.0, 0),
        dialect.MAVLink_scaled_pressure_message(10_050, NAN, 0.0, 0),
        dialect.MAVLink_raw_imu_message(10_050_000, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        highres(0x3F, xacc=NAN),
        highres(0x3F, zgyro=1e4),
        gps(lat=0, lon=0),
        dialect.MAVLink_mount_orientation_message(10_050, NAN, 0.0, NAN, NAN),
        dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, 10_050, 64, [NAN] * 4, 0, 0, 0, 0),
        dialect.MAVLink_home_position_message(0, 0, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
        dialect.MAVLink_airspeed_message(0, 20.0, 0, 0.0, 0),
    ],
    ids=lambda m: m.get_type(),
)
def test_absurd_figures_are_dropped_and_counted(message: Any) -> None:
    station = Station()

    assert station.take(message) == []
    assert station.maker.rejected.total() == 1


@pytest.mark.parametrize("angles", [(0.1, -0.2, 3.0), (-3.0, 1.5, -3.1), (0.0, 0.0, 6.0)])
def test_attitude_is_the_rotation_of_its_angles(angles: tuple[float, float, float]) -> None:
    sample = Station().one(dialect.MAVLink_attitude_message(10_050, *angles, 0.0, 0.0, 0.0))

    assert_allclose(sample.q_ned_from_body, q_from_euler(*angles))
