"""The filter's estimate as a state for everybody else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q, q_from_matrix, skew
from estimator.measurements.camera_attitude import CameraAttitude, camera_rotation_jacobian
from estimator.robust import largest_std
from estimator.types import Doubt, Float, Mode, NavigationState, PadRelative, VideoOffset


@dataclass(frozen=True, slots=True)
class Given:
    """What the navigator knows beside the filter."""

    t_us: int
    mode: Mode
    process_model: str
    last_fix_age_s: float
    video_offset: VideoOffset
    doubts: tuple[Doubt, ...] = ()
    pad: PadRelative | None = None


def snapshot(
    eskf: ErrorStateFilter, given: Given, frame: LocalFrame, camera: CameraAttitude, lever_arm_frd_m: Float,
    ground_down_m: float,
) -> NavigationState:  # fmt: skip
    """The state with its covariances, over ground at ``ground_down_m`` (NaN where unknown)."""
    motion = eskf.nominal.motion
    lat, lon, alt = frame.geodetic_from_ned(motion.pos_ned_m)
    lever_ned_m = matrix_from_q(motion.q_ned_from_body) @ lever_arm_frd_m
    # R_true = Exp(dtheta) R turns the lever by dtheta x lever
    lens = eskf.layout.jacobian(3, position=np.eye(3), attitude=-skew(lever_ned_m))
    T = np.vstack((lens, camera_rotation_jacobian(camera, eskf), eskf.layout.jacobian(1, ground_bias=np.ones((1, 2)))))
    cov = T @ eskf.P @ T.T
    motion_rows = np.vstack((np.eye(9, eskf.layout.size), T[6:]))
    has_boresight = eskf.layout.has("boresight")
    return NavigationState(
        t_us=given.t_us,
        mode=given.mode,
        process_model=given.process_model,
        lat_rad=float(lat),
        lon_rad=float(lon),
        alt_amsl_m=float(alt),
        alt_agl_m=float(ground_down_m - motion.pos_ned_m[2]),
        pos_ned_m=motion.pos_ned_m.copy(),
        vel_ned_m_s=motion.vel_ned_m_s.copy(),
        q_ned_from_body=motion.q_ned_from_body.copy(),
        q_ned_from_camera=q_from_matrix(camera.ned_from_camera),
        cov_pos_ned_m2=eskf.cov("position"),
        cov_vel_ned_m2_s2=eskf.cov("velocity"),
        cov_attitude_rad2=eskf.cov("attitude"),
        cov_camera_pose=cov[:6, :6],
        last_fix_age_s=given.last_fix_age_s,
        boresight_rad=eskf.nominal.boresight_rad.copy() if has_boresight else None,
        cov_boresight_rad2=eskf.cov("boresight") if has_boresight else None,
        video_offset=given.video_offset,
        doubts=given.doubts,
        lever_ned_m=lever_ned_m,
        ground_bias_m=eskf.nominal.ground_bias_m,
        cov_ground_bias=cov[6] if eskf.layout.has("ground_bias") else None,
        cov_motion=motion_rows @ eskf.P @ motion_rows.T,
        pad=given.pad,
    )


def carried_on(state: NavigationState, dt_s: float) -> NavigationState:
    """As sure as a state is after so long at a velocity that is no surer."""
    grown = state.cov_vel_ned_m2_s2 * dt_s**2
    pose = state.cov_camera_pose.copy()
    pose[:3, :3] += grown
    pad = state.pad
    if pad is not None:
        pad = replace(pad, cov_pos_ned_m2=pad.cov_pos_ned_m2 + grown)
    return replace(state, cov_pos_ned_m2=state.cov_pos_ned_m2 + grown, cov_camera_pose=pose, pad=pad)


def horizontal_std_m(eskf: ErrorStateFilter) -> float:
    """The longest semi-axis of the horizontal position's one-sigma ellipse."""
    return largest_std(eskf.cov("position")[:2, :2])
