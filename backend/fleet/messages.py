"""What the stream says about vehicles: plain fields, degrees, None where nothing is known."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from backend.navigation.setup import NavigationSetup
from backend.uncertainty import ellipse95
from estimator.geometry.ground import intersect_plane
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import euler_from_q, matrix_from_q
from estimator.types import FixReport, NavigationState, OffsetSource

FOOTPRINT_REACH_M = 5000.0


def finite(value: float) -> float | None:
    """The number, None in place of NaN and infinity."""
    return float(value) if math.isfinite(value) else None


def state_fields(state: NavigationState, epoch: int, gps_denied: bool, setup: NavigationSetup | None) -> dict[str, Any]:
    """Fields of a ``state`` message."""
    roll, pitch, yaw = (float(angle) for angle in euler_from_q(state.q_ned_from_body))
    cov = state.cov_pos_ned_m2
    std_n, std_e, std_d = (float(value) for value in np.sqrt(np.maximum(np.diag(cov), 0.0)))
    vn, ve, vd = (float(value) for value in state.vel_ned_m_s)
    return {
        "t_state_unix_us": state.t_us,
        "epoch": epoch,
        "mode": str(state.mode),
        "process_model": state.process_model,
        "lat_deg": math.degrees(state.lat_rad),
        "lon_deg": math.degrees(state.lon_rad),
        "alt_amsl_m": finite(state.alt_amsl_m),
        "alt_agl_m": finite(state.alt_agl_m),
        "std_n_m": finite(std_n),
        "std_e_m": finite(std_e),
        "std_d_m": finite(std_d),
        "cov_ne_m2": finite(float(cov[0, 1])),
        "ellipse95": asdict(ellipse95(cov[:2, :2])) if np.all(np.isfinite(cov[:2, :2])) else None,
        "vn_m_s": finite(vn),
        "ve_m_s": finite(ve),
        "vd_m_s": finite(vd),
        "ground_speed_m_s": finite(math.hypot(vn, ve)),
        "roll_deg": finite(math.degrees(roll)),
        "pitch_deg": finite(math.degrees(pitch)),
        "heading_deg": finite(math.degrees(yaw) % 360.0),
        "last_fix_age_s": finite(state.last_fix_age_s),
        "gps_denied": gps_denied,
        **camera_fields(state, setup),
        "footprint": footprint(state, setup) if setup is not None and setup.has_camera else None,
    }


def camera_fields(state: NavigationState, setup: NavigationSetup | None) -> dict[str, Any]:
    """What is known of the camera: its clock, and how far its axes lie from the stated mount; None without a camera.

    ``boresight_deg`` is about the axes x, y, z of the body, or of the gimbal's frame where there is a gimbal.
    """
    nothing: dict[str, Any] = {"video_clock": None, "boresight_deg": None, "boresight_std_deg": None}
    if setup is None or not setup.has_camera:
        return nothing
    fields = dict(nothing)
    offset = state.video_offset
    if offset is not None:
        given_s = setup.time_offset_s if offset.source is OffsetSource.GIVEN else offset.offset_s
        fields["video_clock"] = {
            "source": str(offset.source), "time_offset_s": given_s, "std_s": offset.std_s, "reason": offset.reason,
        }  # fmt: skip
    if state.boresight_rad is not None and state.cov_boresight_rad2 is not None:
        std_rad = np.sqrt(np.maximum(np.diag(state.cov_boresight_rad2), 0.0))
        fields["boresight_deg"] = [finite(math.degrees(float(angle))) for angle in state.boresight_rad]
        fields["boresight_std_deg"] = [finite(math.degrees(float(std))) for std in std_rad]
    return fields


def footprint(state: NavigationState, setup: NavigationSetup) -> list[list[float]] | None:
    """Latitude and longitude where the picture's four corners meet level ground, None when one sees the sky."""
    if not math.isfinite(state.alt_agl_m) or state.alt_agl_m <= 0.0:
        return None
    right, bottom = setup.camera.width_px - 0.5, setup.camera.height_px - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    rays = setup.camera.rays(corners) @ matrix_from_q(state.q_ned_from_camera).T
    points = intersect_plane(state.pos_ned_m, rays, float(state.pos_ned_m[2] + state.alt_agl_m))
    reach = np.linalg.norm(points[:, :2] - state.pos_ned_m[:2], axis=1)
    if not np.all(np.isfinite(points)) or float(reach.max()) > FOOTPRINT_REACH_M:
        return None
    lat, lon, _ = setup.frame.geodetic_from_ned(points)
    return [[math.degrees(float(a)), math.degrees(float(b))] for a, b in zip(lat, lon, strict=True)]


def fix_fields(report: FixReport, frame: LocalFrame) -> dict[str, Any]:
    """Fields of a ``fix`` message."""
    has_place = math.isfinite(report.north_m) and math.isfinite(report.east_m)
    lat_deg, lon_deg, cov = None, None, None
    if has_place:
        lat, lon = frame.geodetic_from_ne(np.array([report.north_m, report.east_m]))
        lat_deg, lon_deg = math.degrees(float(lat)), math.degrees(float(lon))
        cov = [[finite(float(value)) for value in row] for row in np.asarray(report.cov_ne_m2)]
    return {
        "frame_id": report.frame_id,
        "t_fix_unix_us": report.t_us,
        "kind": report.kind,
        "accepted": report.accepted,
        "reason": report.reason,
        "lat_deg": lat_deg,
        "lon_deg": lon_deg,
        "cov_ne_m2": cov,
        "score": finite(report.score),
        "elapsed_ms": finite(report.elapsed_ms),
    }
