"""LANDING_TARGET (149) in the form that each autopilot takes, and the set-points of a station that lands by itself.

ArduPilot takes the target as seen from the vehicle: body axes forward, right, down, with ``position_valid``
(AC_PrecLand_MAVLink.cpp). PX4 takes only a place in the local frame of its own estimator (mavlink_receiver.cpp,
``landing_target_pose.x_abs``), so what is relative is added to its own LOCAL_POSITION_NED.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.events import Autopilot, TelemetryLocalPosition
from estimator.geometry.rotation import matrix_from_q
from estimator.types import Float

LOCAL_POSITION_RATE_HZ = 20.0
LOCAL_POSITION_NED = 32
_FRAME_LOCAL_NED = 1
_FRAME_BODY_FRD = 12
_VISION_FIDUCIAL = 2
_NO_ROTATION = [1.0, 0.0, 0.0, 0.0]
# Position, acceleration, yaw and yaw rate are ignored: MAVLink's POSITION_TARGET_TYPEMASK.
_VELOCITY_ONLY = 0x0DC7


class TargetForm(StrEnum):
    """How a target is told: ``body`` to ArduPilot, ``local`` to PX4."""

    BODY = "body"
    LOCAL = "local"


def form_for(autopilot: Autopilot) -> TargetForm:
    """The form for an autopilot. Raises ValueError for one of which nobody knows what it takes."""
    forms = {Autopilot.ARDUPILOT: TargetForm.BODY, Autopilot.PX4: TargetForm.LOCAL}
    if autopilot not in forms:
        message = (
            f"an autopilot of kind '{autopilot}' takes no LANDING_TARGET that is known here: ArduPilot or PX4 does"
        )
        raise ValueError(message)
    return forms[autopilot]


def target_in_body(t_us: int, q_ned_from_body: Float, vehicle_from_pad_ned_m: Float) -> Any:
    """The message for ArduPilot.

    ``vehicle_from_pad_ned_m`` (3,) leads from the pad's centre to the vehicle; ``q_ned_from_body`` (4,) is of the same
    time ``t_us``, Unix microseconds.
    """
    target = -matrix_from_q(q_ned_from_body).T @ np.asarray(vehicle_from_pad_ned_m, dtype=np.float64)
    return _message(t_us, _FRAME_BODY_FRD, target, float(np.linalg.norm(target)), _NO_ROTATION)


def target_in_local(
    t_us: int, q_ned_from_pad: Float, vehicle_from_pad_ned_m: Float, vehicle: TelemetryLocalPosition
) -> Any:
    """The message for PX4; ``vehicle`` is its own idea of where it is, which is carried on to ``t_us``."""
    ahead_s = (t_us - vehicle.t_us) * 1e-6
    own = np.array(vehicle.pos_ned_m) + ahead_s * np.array(vehicle.vel_ned_m_s)
    relative = np.asarray(vehicle_from_pad_ned_m, dtype=np.float64)
    return _message(
        t_us, _FRAME_LOCAL_NED, own - relative, float(np.linalg.norm(relative)), [float(x) for x in q_ned_from_pad]
    )


def _message(t_us: int, frame: int, place_m: Float, distance_m: float, q: list[float]) -> Any:
    x, y, z = (float(value) for value in place_m)
    return _dialect.MAVLink_landing_target_message(
        t_us, 0, frame, 0.0, 0.0, distance_m, 0.0, 0.0, x, y, z, q, _VISION_FIDUCIAL, 1
    )


def velocity_set_point(system_id: int, component_id: int, vel_ned_m_s: Float) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED (84) with a velocity only; the heading stays as it is."""
    north, east, down = (float(value) for value in vel_ned_m_s)
    # The time is for the receiver's statistics; ArduPilot and PX4 take a set-point when it comes.
    return _dialect.MAVLink_set_position_target_local_ned_message(
        0, system_id, component_id, _FRAME_LOCAL_NED, _VELOCITY_ONLY,
        0.0, 0.0, 0.0, north, east, down, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
