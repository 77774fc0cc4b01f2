"""What tells an autopilot's own filter where the vehicle is: four messages, each in the form that its reader takes.

Pure. Sources: MAVLink's common.xml; ArduPilot GCS_Common.cpp (``handle_command_int_external_position_estimate``,
``handle_odometry``), AP_NavEKF3_PosVelFusion.cpp (``setLatLng``), AP_GPS_MAV.cpp; PX4 mavlink_receiver.cpp
(``handle_message_odometry``, ``handle_message_global_position_sensor``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.events import Autopilot
from backend.uncertainty import worst_std
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q
from estimator.types import Float, NavigationState

EXTERNAL_POSITION_ESTIMATE = 43003
GPS_GLOBAL_ORIGIN = 49
REQUEST_MESSAGE = 512
# What a vehicle may do beyond going straight on while a state is carried on.
MANOEUVRE_M_S2 = 2.0
# A float of 32 bits tells 36 000 s to 4 ms. Each return to zero upsets the reader's idea of the delay: be it seldom.
_WRAP_S = 36_000
_GLOBAL, _LOCAL_NED, _BODY_FRD, _LOCAL_FRD = 0, 1, 12, 20
_ESTIMATOR_VISION = 2
_SOURCE_VISION = 2
_NAN = math.nan
_GPS_EPOCH_UNIX_S = 315_964_800
# GPS time runs ahead of UTC; no leap second has been added since 2017, and none is announced.
_LEAP_SECONDS = 18
_WEEK_MS = 7 * 86_400_000
_FIX_3D = 3
# What a receiver's dilution is multiplied with to get metres, as where the station reads one.
_METRES_PER_DILUTION = 1.5
# ArduPilot's filter and its arming checks ask for six and more.
_SATELLITES = 10
_UPPER_6X6 = np.triu_indices(6)


class AidingForm(StrEnum):
    """How an autopilot is told; ``gps_input`` pretends to be its GPS receiver and is the last resort."""

    EXTERNAL_POSITION = "external_position"
    ODOMETRY = "odometry"
    GPS_INPUT = "gps_input"
    GLOBAL_POSITION_SENSOR = "global_position_sensor"


FORMS: dict[Autopilot, tuple[AidingForm, ...]] = {
    Autopilot.ARDUPILOT: (AidingForm.EXTERNAL_POSITION, AidingForm.ODOMETRY, AidingForm.GPS_INPUT),
    Autopilot.PX4: (AidingForm.GLOBAL_POSITION_SENSOR, AidingForm.ODOMETRY),
}
"""What each autopilot takes, the best first."""


@dataclass(frozen=True, slots=True)
class Reader:
    """Whom a message is for."""

    system_id: int
    component_id: int
    autopilot: Autopilot


@dataclass(frozen=True, slots=True)
class Origin:
    """Where an autopilot's local frame begins, as it says itself (GPS_GLOBAL_ORIGIN)."""

    lat_rad: float
    lon_rad: float
    alt_amsl_m: float


def carried_on(state: NavigationState, frame: LocalFrame, t_us: int) -> NavigationState:
    """The state at a later ``t_us`` by its velocity, with what that adds to the covariance of the position.

    ``frame`` is that of ``pos_ned_m``. Where how position and velocity err together is not known, the bound holds for
    any: ``(1 + s) P + (1 + 1/s) dt^2 V``. A state of ``t_us`` or later comes back as it is.
    """
    dt_s = (t_us - state.t_us) * 1e-6
    if dt_s <= 0.0:
        return state
    pos_ned_m = state.pos_ned_m + dt_s * state.vel_ned_m_s
    lat_rad, lon_rad, alt_m = (float(value) for value in frame.geodetic_from_ned(pos_ned_m))
    moved = dt_s**2 * state.cov_vel_ned_m2_s2
    trace_pos, trace_moved = float(np.trace(state.cov_pos_ned_m2)), float(np.trace(moved))
    s = math.sqrt(trace_moved / trace_pos) if trace_pos > 0.0 and trace_moved > 0.0 else 1.0
    manoeuvre = (0.5 * MANOEUVRE_M_S2 * dt_s**2) ** 2 * np.eye(3)
    return replace(
        state, t_us=t_us, lat_rad=lat_rad, lon_rad=lon_rad, alt_amsl_m=alt_m, pos_ned_m=pos_ned_m,
        cov_pos_ned_m2=(1.0 + s) * state.cov_pos_ned_m2 + (1.0 + 1.0 / s) * moved + manoeuvre,
    )  # fmt: skip


def external_position(state: NavigationState, to: Reader, t_sent_us: int) -> Any:
    """MAV_CMD_EXTERNAL_POSITION_ESTIMATE (43003) as COMMAND_INT, for ArduPilot; at most once a second.

    Parameters: when it is sent (seconds of our clock), how old it is then, one sigma along the worst horizontal
    direction. The altitude is NaN: with a number in it the command is denied. Each that is accepted moves the
    autopilot's position there at once.
    """
    return _dialect.MAVLink_command_int_message(
        to.system_id, to.component_id, _GLOBAL, EXTERNAL_POSITION_ESTIMATE, 0, 0,
        t_sent_us % (_WRAP_S * 1_000_000) * 1e-6, _age_us(state, t_sent_us) * 1e-6,
        worst_std(state.cov_pos_ned_m2[:2, :2]), 0.0, _e7(state.lat_rad), _e7(state.lon_rad), _NAN,
    )  # fmt: skip


def global_position_sensor(state: NavigationState, to: Reader, t_sent_us: int) -> Any:
    """GLOBAL_POSITION_SENSOR (296), for PX4: place, altitude above mean sea level, and one sigma of both."""
    return _dialect.MAVLink_global_position_sensor_message(
        to.system_id, to.component_id, 0, state.t_us, _age_us(state, t_sent_us), _SOURCE_VISION, 0,
        _e7(state.lat_rad), _e7(state.lon_rad), _NAN, state.alt_amsl_m,
        worst_std(state.cov_pos_ned_m2[:2, :2]), math.sqrt(float(state.cov_pos_ned_m2[2, 2])),
    )  # fmt: skip


def odometry(state: NavigationState, to: Reader, origin: Origin, resets: int, quality_pct: int) -> Any:
    """ODOMETRY (331): north, east and down of the autopilot's own origin, velocity in body axes.

    ArduPilot drops without a word what is not in LOCAL_FRD (20) with BODY_FRD (12), and takes its axes for north and
    east; to PX4 LOCAL_FRD is a frame of unknown heading, so it is told LOCAL_NED (1). ``resets`` counts the jumps of
    what is sent. How fast it turns is not told (NaN), nor how position and attitude err together (zero).
    """
    frame_id = _LOCAL_NED if to.autopilot is Autopilot.PX4 else _LOCAL_FRD
    frame = LocalFrame(origin.lat_rad, origin.lon_rad, origin.alt_amsl_m)
    place = frame.ned_from_geodetic(state.lat_rad, state.lon_rad, state.alt_amsl_m)
    body_from_ned = matrix_from_q(state.q_ned_from_body).T
    cov_pose, cov_twist = np.zeros((6, 6)), np.zeros((6, 6))
    cov_pose[:3, :3], cov_pose[3:, 3:] = state.cov_pos_ned_m2, state.cov_attitude_rad2
    cov_twist[:3, :3] = body_from_ned @ state.cov_vel_ned_m2_s2 @ body_from_ned.T
    cov_twist[3:, 3:] = _NAN
    return _dialect.MAVLink_odometry_message(
        state.t_us, frame_id, _BODY_FRD, *_floats(place), _floats(state.q_ned_from_body),
        *_floats(body_from_ned @ state.vel_ned_m_s), _NAN, _NAN, _NAN,
        _floats(cov_pose[_UPPER_6X6]), _floats(cov_twist[_UPPER_6X6]), resets % 256, _ESTIMATOR_VISION, quality_pct,
    )  # fmt: skip


def gps_input(state: NavigationState, gps_id: int = 0) -> Any:
    """GPS_INPUT (232), for ArduPilot with GPS1_TYPE 14. A LAST RESORT: the autopilot takes it for a GPS receiver.

    Place, velocities and accuracies are the estimate's. What an estimate has none of is what ArduPilot asks for:
    ten satellites, and dilutions that stand for the accuracies. No heading is given (0).
    """
    week, week_ms = gps_time(state.t_us)
    std_horizontal_m = worst_std(state.cov_pos_ned_m2[:2, :2])
    std_vertical_m = math.sqrt(float(state.cov_pos_ned_m2[2, 2]))
    return _dialect.MAVLink_gps_input_message(
        state.t_us, gps_id, 0, week_ms, week, _FIX_3D, _e7(state.lat_rad), _e7(state.lon_rad), state.alt_amsl_m,
        std_horizontal_m / _METRES_PER_DILUTION, std_vertical_m / _METRES_PER_DILUTION, *_floats(state.vel_ned_m_s),
        worst_std(state.cov_vel_ned_m2_s2), std_horizontal_m, std_vertical_m, _SATELLITES, 0,
    )  # fmt: skip


def request_origin(to: Reader) -> Any:
    """Ask for GPS_GLOBAL_ORIGIN, once."""
    return _dialect.MAVLink_command_long_message(
        to.system_id, to.component_id, REQUEST_MESSAGE, 0, GPS_GLOBAL_ORIGIN, 0, 0, 0, 0, 0, 0
    )


def set_origin(origin: Origin, to: Reader, t_us: int) -> Any:
    """SET_GPS_GLOBAL_ORIGIN (48). ArduPilot takes the first of its life and no other."""
    return _dialect.MAVLink_set_gps_global_origin_message(
        to.system_id, _e7(origin.lat_rad), _e7(origin.lon_rad), round(origin.alt_amsl_m * 1000), t_us
    )


def gps_time(t_unix_us: int) -> tuple[int, int]:
    """GPS week and milliseconds of the week at a Unix time."""
    return divmod(t_unix_us // 1000 + (_LEAP_SECONDS - _GPS_EPOCH_UNIX_S) * 1000, _WEEK_MS)


def _age_us(state: NavigationState, t_sent_us: int) -> int:
    return max(t_sent_us - state.t_us, 0)


def _e7(angle_rad: float) -> int:
    return round(math.degrees(angle_rad) * 1e7)


def _floats(values: Float) -> list[float]:
    return [float(value) for value in values]
