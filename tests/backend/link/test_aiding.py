"""What tells an autopilot where it is, field by field, and against a flight of ArduPilot on such messages."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink import mavutil

from backend.link.aiding import (
    FORMS,
    AidingForm,
    Origin,
    Reader,
    carried_on,
    external_position,
    global_position_sensor,
    gps_input,
    gps_time,
    odometry,
    request_origin,
    set_origin,
)
from backend.link.events import Autopilot
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_euler
from estimator.types import Mode, NavigationState
from tests.backend.flight_maker import state
from tests.backend.link.wire import Sender, dialect, parsed
from tests.shared_data import shared_data

T_US = 1_760_000_000_123_456
COPTER = Reader(7, 1, Autopilot.ARDUPILOT)
PX4 = Reader(7, 1, Autopilot.PX4)
FRAME = LocalFrame(math.radians(47.0), math.radians(8.0), 400.0)
# The message carries degrees times 1e7: half a unit is 6 mm of latitude.
PLACE_TOLERANCE_M = 0.006


def flown(yaw_deg: float = 0.0, vel_ned_m_s: tuple[float, float, float] = (3.0, -4.0, 0.5)) -> NavigationState:
    """300 m north and 400 m west of the frame's origin, 120 m above it."""
    place = np.array((300.0, -400.0, -120.0))
    lat, lon, alt = (float(value) for value in FRAME.geodetic_from_ned(place))
    return replace(
        state(T_US, mode=Mode.VISION, yaw_rad=math.radians(yaw_deg)), lat_rad=lat, lon_rad=lon, alt_amsl_m=alt,
        pos_ned_m=place, vel_ned_m_s=np.array(vel_ned_m_s), cov_pos_ned_m2=np.diag((4.0, 9.0, 2.25)),
        cov_vel_ned_m2_s2=np.diag((0.04, 0.16, 0.01)), cov_attitude_rad2=np.diag((1e-4, 2e-4, 3e-4)),
    )  # fmt: skip


def wired(message: Any) -> Any:
    """As it comes out of the wire at the other end."""
    (read,) = parsed([Sender(255, 190).pack(message)])
    return read


def test_an_external_position_is_a_command_with_an_unknown_altitude() -> None:
    """1 760 000 000 s is 31 999 s into its ten hours plus 0.123 456 s: 48 888 * 36 000 = 1 759 968 000."""
    m = wired(external_position(flown(), COPTER, T_US + 250_000))

    assert (m.get_type(), m.target_system, m.target_component, m.command, m.frame) == ("COMMAND_INT", 7, 1, 43003, 0)
    assert m.param1 == pytest.approx(32_000.373456, abs=0.002)  # a float's step there is 4 ms
    assert (m.param2, m.param3, m.param4) == (0.25, 3.0, 0.0)
    assert math.isnan(m.z)
    at = FRAME.ned_from_geodetic(math.radians(m.x * 1e-7), math.radians(m.y * 1e-7), flown().alt_amsl_m)
    assert_allclose(at[:2], (300.0, -400.0), atol=PLACE_TOLERANCE_M)


def test_a_global_position_sensor_says_what_it_stands_on() -> None:
    m = wired(global_position_sensor(flown(), PX4, T_US + 80_000))

    assert (m.get_msgId(), m.target_system, m.target_component, m.id) == (296, 7, 1, 0)
    assert (m.time_usec, m.processing_time, m.source, m.flags) == (T_US, 80_000, 2, 0)
    assert math.isnan(m.alt_ellipsoid)
    assert m.alt == pytest.approx(flown().alt_amsl_m, abs=1e-4)
    assert (m.eph, m.epv) == (3.0, 1.5)
    assert (m.lat, m.lon) == (round(math.degrees(flown().lat_rad) * 1e7), round(math.degrees(flown().lon_rad) * 1e7))


def test_odometry_is_from_the_autopilot_s_origin_and_in_the_body_s_axes() -> None:
    """Heading east, 3 m/s to the north is to the left, 4 m/s to the west is backwards."""
    origin = Origin(FRAME.lat_rad, FRAME.lon_rad, 390.0)
    m = wired(odometry(flown(90.0), COPTER, origin, resets=258, quality_pct=80))

    assert (m.frame_id, m.child_frame_id, m.time_usec) == (20, 12, T_US)
    assert_allclose((m.x, m.y, m.z), (300.0, -400.0, -130.0), atol=0.02)  # the two frames' verticals differ by nothing
    assert_allclose((m.vx, m.vy, m.vz), (-4.0, -3.0, 0.5), atol=1e-6)
    assert_allclose(m.q, q_from_euler(0.0, 0.0, math.pi / 2), atol=1e-7)
    assert all(map(math.isnan, (m.rollspeed, m.pitchspeed, m.yawspeed)))
    assert (m.reset_counter, m.estimator_type, m.quality) == (2, 2, 80)
    # Upper triangle, row by row: the diagonal lies at 0, 6, 11, 15, 18, 20.
    diagonal = [0, 6, 11, 15, 18, 20]
    assert_allclose([m.pose_covariance[i] for i in diagonal], (4.0, 9.0, 2.25, 1e-4, 2e-4, 3e-4), rtol=1e-6)
    assert_allclose([m.velocity_covariance[i] for i in diagonal[:3]], (0.16, 0.04, 0.01), rtol=1e-6)
    assert all(math.isnan(m.velocity_covariance[i]) for i in diagonal[3:])


def test_a_slanted_ellipse_keeps_its_slant() -> None:
    cov = np.array(((4.0, 1.0, 0.5), (1.0, 9.0, -0.25), (0.5, -0.25, 2.25)))
    m = odometry(replace(flown(), cov_pos_ned_m2=cov), COPTER, Origin(FRAME.lat_rad, FRAME.lon_rad, 400.0), 0, 1)

    assert m.pose_covariance[:3] == [4.0, 1.0, 0.5]
    assert m.pose_covariance[6:8] == [9.0, -0.25]


def test_px4_is_told_that_the_axes_are_north_and_east() -> None:
    assert odometry(flown(), PX4, Origin(FRAME.lat_rad, FRAME.lon_rad, 400.0), 0, 1).frame_id == 1


def test_gps_input_has_every_field_real() -> None:
    m = wired(gps_input(flown()))

    assert (m.gps_id, m.ignore_flags, m.fix_type, m.yaw) == (0, 0, 3, 0)
    assert_allclose((m.vn, m.ve, m.vd), (3.0, -4.0, 0.5))
    assert m.alt == pytest.approx(flown().alt_amsl_m, abs=1e-4)
    assert (m.horiz_accuracy, m.vert_accuracy, m.hdop, m.vdop) == (3.0, 1.5, 2.0, 1.0)
    assert m.speed_accuracy == pytest.approx(0.4)
    # 9 October 2025, 08:53:20.123 UTC: a Thursday, 18 s ahead in GPS time.
    assert (m.time_week, m.time_week_ms) == (2387, ((4 * 24 + 8) * 3600 + 53 * 60 + 38) * 1000 + 123)


def test_gps_time_begins_in_1980_and_has_no_leap_seconds() -> None:
    assert gps_time((315_964_800 - 18) * 1_000_000) == (0, 0)
    # Midnight of Saturday to Sunday, 7 April 2019, as GPS has it: the roll-over of the old ten bits.
    assert gps_time((1_554_595_200 - 18) * 1_000_000) == (2048, 0)
    assert gps_time((1_554_595_200 - 18) * 1_000_000 - 1000) == (2047, 604_799_999)


def test_the_origin_is_asked_for_and_set() -> None:
    origin = Origin(FRAME.lat_rad, FRAME.lon_rad, 488.1)
    asked, told = wired(request_origin(COPTER)), wired(set_origin(origin, COPTER, 5))

    assert (asked.command, asked.param1, asked.target_system) == (512, 49.0, 7)
    assert (told.target_system, told.latitude, told.longitude) == (7, 470_000_000, 80_000_000)
    assert (told.altitude, told.time_usec) == (488_100, 5)


def test_a_state_is_carried_on_by_its_velocity_and_gets_less_sure() -> None:
    before = flown(vel_ned_m_s=(10.0, 0.0, -2.0))
    after = carried_on(before, FRAME, T_US + 400_000)

    assert_allclose(after.pos_ned_m, (304.0, -400.0, -120.8))
    at = FRAME.ned_from_geodetic(after.lat_rad, after.lon_rad, after.alt_amsl_m)
    assert_allclose(at, after.pos_ned_m, atol=1e-6)
    assert after.t_us == T_US + 400_000
    # Fully correlated, along each axis: the bound is above (2 + 0.08)^2 and below the sum with an unkind factor.
    std_m = np.sqrt(np.diag(after.cov_pos_ned_m2))
    fully = np.array((2.0 + 0.4 * 0.2, 3.0 + 0.4 * 0.4, 1.5 + 0.4 * 0.1))
    assert np.all(std_m >= fully - 1e-9)
    assert np.all(std_m <= fully + 0.3)


def test_a_state_of_now_stays_as_it_is() -> None:
    before = flown()
    assert carried_on(before, FRAME, T_US) is before
    assert carried_on(before, FRAME, T_US - 1) is before


def test_each_autopilot_is_told_in_its_own_forms_and_the_pretence_comes_last() -> None:
    assert FORMS[Autopilot.ARDUPILOT][-1] is AidingForm.GPS_INPUT
    assert AidingForm.GPS_INPUT not in FORMS[Autopilot.PX4]
    assert Autopilot.OTHER not in FORMS


# --- a flight on such messages ---


@cache
def recorded(name: str) -> tuple[Any, ...]:
    log = mavutil.mavlink_connection(str(shared_data(f"telemetry/{name}.tlog")), dialect="ardupilotmega")
    kinds = ["ODOMETRY", "SIM_STATE", "GPS_GLOBAL_ORIGIN", "SET_GPS_GLOBAL_ORIGIN"]
    found = []
    while (message := log.recv_match(type=kinds)) is not None:
        found.append(message)
    return tuple(found)


def test_from_the_truth_of_a_flight_comes_what_it_was_flown_by() -> None:
    """
    An ArduPilot copter was flown by ODOMETRY made of its true state plus noise: 0.3 m a position, 0.1 m/s a velocity.
    Ours, made of the true state about the origin that it named, differs from it by that noise and nothing more.
    """
    log = recorded("ext_odom")
    named = next(m for m in log if m.get_type() == "GPS_GLOBAL_ORIGIN")
    origin = Origin(math.radians(named.latitude * 1e-7), math.radians(named.longitude * 1e-7), named.altitude * 1e-3)
    truths = [m for m in log if m.get_type() == "SIM_STATE"]
    stamps_us = np.array([m._timestamp for m in truths]) * 1e6
    off, off_body, speeds = [], [], []
    for told in (m for m in log if m.get_type() == "ODOMETRY"):
        truth = truths[int(np.argmin(np.abs(stamps_us - told.time_usec)))]
        at = replace(
            flown(), t_us=told.time_usec, lat_rad=math.radians(truth.lat_int * 1e-7),
            lon_rad=math.radians(truth.lon_int * 1e-7), alt_amsl_m=truth.alt,
            vel_ned_m_s=np.array((truth.vn, truth.ve, truth.vd)), q_ned_from_body=np.array(told.q),
        )  # fmt: skip
        ours = odometry(at, COPTER, origin, 0, 90)
        assert (ours.frame_id, ours.child_frame_id) == (told.frame_id, told.child_frame_id)
        assert (ours.time_usec, ours.quality) == (told.time_usec, told.quality)
        off.append((ours.x - told.x, ours.y - told.y, ours.z - told.z))
        off_body.append((ours.vx - told.vx, ours.vy - told.vy, ours.vz - told.vz))
        speeds.append((told.vx, told.vy))
    assert len(off) == 1170
    assert_allclose(np.std(off, axis=0), 0.3, atol=0.06)
    # The mean of 1170 is good to 1 cm; the truth is 20 ms off at most, and home stands 0.1 m above the origin.
    assert_allclose(np.mean(off, axis=0)[:2], 0.0, atol=0.05)
    assert_allclose(np.std(off_body, axis=0), 0.1, atol=0.03)
    # It flew ahead and sideways, so that no exchange of axes passes.
    assert np.ptp(speeds, axis=0).min() > 2.0


def test_the_origin_that_was_set_is_the_one_that_came_back() -> None:
    log = recorded("ext_odom")
    sent = next(m for m in log if m.get_type() == "SET_GPS_GLOBAL_ORIGIN")
    came = next(m for m in log if m.get_type() == "GPS_GLOBAL_ORIGIN")
    origin = Origin(math.radians(sent.latitude * 1e-7), math.radians(sent.longitude * 1e-7), sent.altitude * 1e-3)
    ours = set_origin(origin, Reader(1, 1, Autopilot.ARDUPILOT), sent.time_usec)

    packer = dialect.MAVLink(None, srcSystem=sent.get_srcSystem(), srcComponent=sent.get_srcComponent())
    packer.seq = sent.get_seq()
    assert bytes(ours.pack(packer)) == bytes(sent.get_msgbuf())
    assert (came.latitude, came.longitude, came.altitude) == (sent.latitude, sent.longitude, sent.altitude)
