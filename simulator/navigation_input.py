"""What tells the autopilot's filter from outside where it is, taken as ArduPilot takes it. No I/O, no clock.

A position by command moves it there at once, and only while its receiver has no fix. ODOMETRY is followed while the
set of sources in use says so. GPS_INPUT is its receiver where GPS1_TYPE says so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q
from estimator.types import Float
from simulator.believed import BelievedPosition
from simulator.parameters import ParameterStore
from simulator.sensors.gnss import GnssFix
from simulator.vehicles.state import VehicleState

EXTERNAL_POSITION, SET_SOURCES = 43003, 42007

_ACCEPTED, _DENIED = int(mavlink.MAV_RESULT_ACCEPTED), int(mavlink.MAV_RESULT_DENIED)
_GLOBAL_FRAMES = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_EXTERNAL_NAV, _GPS_FROM_LINK = 6, 14
_VISO_TYPES = (1, 3)
_SETS = (1, 2, 3)
_FIX_SILENT_US = 4_000_000


class NavigationInput:
    """Holds the set of sources in use and the last fix that came over the link.

    ``origin_ned_m`` (3,) is where the autopilot's own local frame begins.
    """

    def __init__(
        self, believed: BelievedPosition, parameters: ParameterStore, frame: LocalFrame, origin_ned_m: Float
    ) -> None:
        self._believed, self._parameters, self._frame = believed, parameters, frame
        self._origin_ned_m = origin_ned_m
        self._sources = 1
        self._fix: GnssFix | None = None

    def position(self, message: Any, truth: VehicleState, fix: GnssFix | None) -> int:
        """MAV_CMD_EXTERNAL_POSITION_ESTIMATE; its result. ``fix`` is the receiver's last."""
        if message.get_type() != "COMMAND_INT" or message.frame not in _GLOBAL_FRAMES or not np.isnan(message.z):
            return _DENIED
        lat_deg, lon_deg = message.x * 1e-7, message.y * 1e-7
        if (fix is not None and fix.has_fix) or abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
            return _DENIED
        at_ne_m = self._frame.ne_from_geodetic(np.radians(lat_deg), np.radians(lon_deg))
        self._believed.move(at_ne_m - truth.pos_ned_m[:2])
        return _ACCEPTED

    def use_sources(self, number: float) -> int:
        """MAV_CMD_SET_EKF_SOURCE_SET; its result."""
        if number not in _SETS:
            return _DENIED
        self._sources = int(number)
        return _ACCEPTED

    def odometry(self, message: Any, truth: VehicleState) -> None:
        """ODOMETRY; in other frames than LOCAL_FRD and BODY_FRD it is dropped without a word."""
        if (message.frame_id, message.child_frame_id) != (mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_BODY_FRD):
            return
        place = np.array((message.x, message.y, message.z))
        velocity_frd, q = np.array((message.vx, message.vy, message.vz)), np.array(message.q)
        if not np.all(np.isfinite((*place, *velocity_frd, *q))) or abs(float(np.linalg.norm(q)) - 1.0) > 0.1:
            return
        velocity = matrix_from_q(q / np.linalg.norm(q)) @ velocity_frd
        sources = f"EK3_SRC{self._sources}_POSXY"
        if self._parameters.value(sources) == _EXTERNAL_NAV and self._parameters.value("VISO_TYPE") in _VISO_TYPES:
            error = self._origin_ned_m + place - truth.pos_ned_m
            self._believed.see(truth.t_us, error, velocity - truth.vel_ned_m_s)

    def gps_input(self, message: Any, t_us: int) -> None:
        """GPS_INPUT for the first receiver."""
        numbers = (message.alt, message.vn, message.ve, message.vd, message.horiz_accuracy, message.vert_accuracy)
        if message.gps_id != 0 or message.time_week == 0 or not np.all(np.isfinite(numbers)):
            return
        lat, lon = np.radians(message.lat * 1e-7), np.radians(message.lon * 1e-7)
        if abs(lat) > np.pi / 2 or abs(lon) > np.pi:
            return
        self._fix = GnssFix(
            t_us, self._frame.ned_from_geodetic(lat, lon, message.alt),
            np.array((message.vn, message.ve, message.vd), dtype=np.float64), message.fix_type >= 3,
            message.satellites_visible, message.horiz_accuracy, message.vert_accuracy,
        )  # fmt: skip

    def fix_in_use(self, own: GnssFix, t_us: int) -> GnssFix:
        """The fix that counts: the receiver's own, or what comes over the link in its place."""
        if self._parameters.value("GPS1_TYPE") != _GPS_FROM_LINK:
            return own
        if self._fix is None or t_us - self._fix.t_us > _FIX_SILENT_US:
            return replace(own, has_fix=False, satellites=0)
        return self._fix
