"""What a look at a picture becomes: a message to those who watch, a change of the target, a line of the recording."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from backend.following.follower import Look
from backend.recorder.followed import FollowedRow
from backend.schemas.geometry import ellipse_of, track_body_of
from backend.store.targets import LOST, SEEN, TrackUpdate
from backend.uncertainty import circular_error_m


def update_of(look: Look) -> TrackUpdate:
    """The change of a target."""
    motion = look.motion
    pos, vel, known = motion.cov_pos_ne_m2, motion.cov_vel_ne_m2_s2, motion.moving is not None
    return TrackUpdate(
        SEEN if look.reason is None else LOST, look.reason, motion.t_us, look.lat_deg, look.lon_deg, look.alt_amsl_m,
        float(pos[0, 0]), float(pos[1, 1]), float(pos[0, 1]), motion.down_std_m**2, motion.moving,
        float(motion.vel_ne_m_s[0]) if known else None, float(motion.vel_ne_m_s[1]) if known else None,
        float(vel[0, 0]) if known else None, float(vel[1, 1]) if known else None, float(vel[0, 1]) if known else None,
    )  # fmt: skip


def sighting_fields(look: Look) -> dict[str, Any]:
    """Fields of the ``sighting`` message, which is of every picture that was looked at.

    Place, ellipse and ``track`` are as in the target's properties; ``u_px``, ``v_px`` and ``size_px`` are of the frame
    ``frame_id``, and null where the target is not seen in it.
    """
    u_px, v_px = (None, None) if look.uv_px is None else look.uv_px
    cov = np.array(look.motion.cov_pos_ne_m2)
    return {
        "target_id": look.target_id, "frame_id": look.frame.frame_id, "t_frame_unix_us": look.frame.t_us,
        "u_px": u_px, "v_px": v_px, "size_px": look.size_px, "confidence": look.confidence,
        "lat_deg": look.lat_deg, "lon_deg": look.lon_deg, "alt_amsl_m": look.alt_amsl_m,
        "ce90_m": circular_error_m(cov), "ellipse95": ellipse_of(cov).model_dump(),
        "track": track_body_of(update_of(look)).model_dump(),
    }  # fmt: skip


def row_of(look: Look, name: str) -> FollowedRow:
    """The line of ``followed.csv``."""
    motion, cov = look.motion, look.motion.cov_pos_ne_m2
    return FollowedRow(
        look.frame.t_us, name, SEEN if look.reason is None else LOST, look.reason, look.uv_px, look.confidence,
        motion.t_us, look.lat_deg, look.lon_deg, look.alt_amsl_m,
        (math.sqrt(float(cov[0, 0])), math.sqrt(float(cov[1, 1]))), float(cov[0, 1]), motion.moving,
        (float(motion.vel_ne_m_s[0]), float(motion.vel_ne_m_s[1])),
    )  # fmt: skip
