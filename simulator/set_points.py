"""What a station streams to the autopilot while it flies: velocities, and where the landing target is. Pure."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.rotation import euler_from_q, matrix_from_q
from estimator.types import Float

_IN_NED = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED)
_IN_BODY = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)
_MASK_POSITION, _MASK_VELOCITY = 0b111, 0b111000
_FASTEST_M_S = 20.0
_FARTHEST_M = 100.0


def velocity_of(message: Any, q_ned_from_body: Float) -> Float | None:
    """Velocity (3,) NED of a SET_POSITION_TARGET_LOCAL_NED that asks for nothing else, None for any other.

    In the frames of the body, forward and right are those of the heading.
    """
    velocity = np.array((message.vx, message.vy, message.vz))
    wanted = message.type_mask & _MASK_VELOCITY == 0 and message.type_mask & _MASK_POSITION == _MASK_POSITION
    if not wanted or not np.all(np.isfinite(velocity)) or float(np.linalg.norm(velocity)) > _FASTEST_M_S:
        return None
    if message.coordinate_frame in _IN_NED:
        return velocity
    if message.coordinate_frame not in _IN_BODY:
        return None
    yaw = float(euler_from_q(q_ned_from_body)[2])
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array((c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2]))


def target_of(message: Any, q_ned_from_body: Float) -> Float | None:
    """From the vehicle to the target, (3,) NED, of a LANDING_TARGET as ArduPilot takes it; None for what it refuses.

    With ``position_valid`` the place is in body axes (frame BODY_FRD); without it the line of sight is by two angles,
    ``angle_x`` to the right and ``angle_y`` forward the negative, as long as ``distance``.
    """
    if message.position_valid:
        if message.frame != mavlink.MAV_FRAME_BODY_FRD:
            return None
        body = np.array((message.x, message.y, message.z))
    else:
        if not (abs(message.angle_x) < 1.5 and abs(message.angle_y) < 1.5):
            return None
        sight = np.array((-math.tan(message.angle_y), math.tan(message.angle_x), 1.0))
        body = sight / np.linalg.norm(sight) * message.distance
    if not np.all(np.isfinite(body)) or not 0.0 < float(np.linalg.norm(body)) < _FARTHEST_M:
        return None
    target: Float = matrix_from_q(q_ned_from_body) @ body
    return target
