"""What is said of a landing: plain fields, degrees, None where nothing is known."""

from __future__ import annotations

import math
from typing import Any

from backend.fleet.messages import finite
from backend.landing.view import outlines_px
from backend.navigation.setup import NavigationSetup
from backend.schemas.landing import PadBody, RingBody, TagBody
from backend.uncertainty import worst_std
from estimator.geometry.rotation import euler_from_q, matrix_from_q
from estimator.landing.pad import Pad, TagPad
from estimator.landing.pose import PadPose
from estimator.measurements.pad_tracking import PadConfig
from estimator.types import NavigationState, PadMode, PadRelative
from geodata.pad_file import as_description

_PLACE = (
    "north_m", "east_m", "height_m", "sink_m_s", "speed_m_s", "ahead_m", "right_m", "x_m", "y_m", "heading_on_pad_deg",
    "std_horizontal_m", "std_height_m", "std_velocity_m_s", "coast_left_s",
)  # fmt: skip


def pad_body(pad: Pad) -> PadBody:
    """A pad as the page draws it."""
    rings = [] if isinstance(pad, TagPad) else pad.rings
    tags = pad.tags if isinstance(pad, TagPad) else ()
    return PadBody(
        name=pad.name, kind="tags" if isinstance(pad, TagPad) else "circles",
        rings=[RingBody(x_m=r.x_m, y_m=r.y_m, outer_m=r.outer_m, inner_m=r.inner_m, triple=r.triple) for r in rings],
        tags=[TagBody(number=t.number, x_m=t.x_m, y_m=t.y_m, side_m=t.side_m) for t in tags],
        description=as_description(pad),
    )  # fmt: skip


def place_fields(state: NavigationState | None, setup: NavigationSetup | None) -> dict[str, Any]:
    """Where the vehicle is relative to the pad, and what the newest picture that showed it showed."""
    pad = None if setup is None else setup.pad
    relative = None if state is None else state.pad
    fields: dict[str, Any] = {
        "t_state_unix_us": None if state is None else state.t_us, "pad": None if pad is None else pad.name,
        "mode": None, "reason": "" if pad is not None else "no pad is described", "age_s": None, "seen": None,
        "outlines_px": None,
        **dict.fromkeys(_PLACE),
    }  # fmt: skip
    if state is None or relative is None or setup is None or pad is None:
        return fields
    fields.update(mode=str(relative.mode), reason=relative.reason, age_s=finite(relative.age_s))
    fields.update({name: finite(value) for name, value in _place(state, relative).items()})
    if relative.mode.known:
        fields["outlines_px"] = outlines_px(_foreseen(state, relative), setup.camera, pad)
    seen = relative.seen
    if seen is not None:
        fields["seen"] = {
            "frame_id": seen.frame_id, "t_frame_unix_us": seen.t_us, "width_px": setup.camera.width_px,
            "height_px": setup.camera.height_px, "triple": seen.triple, "seen_share": round(float(seen.seen_share), 3),
            "outlines_px": outlines_px(seen, setup.camera, pad),
        }  # fmt: skip
    return fields


def _foreseen(state: NavigationState, relative: PadRelative) -> PadPose:
    """Where the estimate has the pad in the camera frame."""
    camera_from_ned = matrix_from_q(state.q_ned_from_camera).T
    return PadPose(
        camera_from_ned @ matrix_from_q(relative.q_ned_from_pad),
        -camera_from_ned @ (relative.pos_ned_m + state.lever_ned_m),
    )


def _place(state: NavigationState, relative: PadRelative) -> dict[str, float]:
    north, east, down = (float(value) for value in relative.pos_ned_m)
    vn, ve, vd = (float(value) for value in relative.vel_ned_m_s)
    x, y, _ = (float(value) for value in matrix_from_q(relative.q_ned_from_pad).T @ relative.pos_ned_m)
    heading = float(euler_from_q(state.q_ned_from_body)[2])
    pad_heading = float(euler_from_q(relative.q_ned_from_pad)[2])
    sin, cos = math.sin(heading), math.cos(heading)
    return {
        "north_m": north, "east_m": east, "height_m": -down, "sink_m_s": vd, "speed_m_s": math.hypot(vn, ve),
        "ahead_m": -north * cos - east * sin, "right_m": north * sin - east * cos, "x_m": x, "y_m": y,
        "heading_on_pad_deg": math.degrees(heading - pad_heading) % 360.0,
        "std_horizontal_m": worst_std(relative.cov_pos_ned_m2[:2, :2]),
        "std_height_m": worst_std(relative.cov_pos_ned_m2[2:, 2:]),
        "std_velocity_m_s": worst_std(relative.cov_vel_ned_m2_s2), "coast_left_s": coast_left_s(relative),
    }  # fmt: skip


def coast_left_s(relative: PadRelative, landing_std_m: float = PadConfig().landing_std_m) -> float:
    """How long until a place that is dead reckoned is too uncertain to land by; NaN while the pad is seen.

    The error is taken to grow by the velocity's since the pad was seen: p^2(t) = p0^2 + (v t)^2, so that it is longest
    where the velocity is known well. What the accelerometers add is left out, a share of it for some seconds.
    """
    if relative.mode is PadMode.LOST:
        return 0.0
    if relative.mode is not PadMode.DEAD_RECKONING:
        return math.nan
    place, velocity = worst_std(relative.cov_pos_ned_m2), max(worst_std(relative.cov_vel_ned_m2_s2), 1e-3)
    first = max(place**2 - (velocity * relative.age_s) ** 2, 0.0)
    return max(math.sqrt(max(landing_std_m**2 - first, 0.0)) / velocity - relative.age_s, 0.0)
