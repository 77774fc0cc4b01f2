"""Attitude of the camera from the vehicle's, the gimbal's report and the mount, and how errors pass through."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.camera import GIMBAL_FROM_CAMERA, Mount
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.history import AttitudeTrack, level_yaw_matrix
from estimator.types import CameraAttitudeSample, Float

MAX_SLEW_RAD_S = 0.5


class Gimbal(StrEnum):
    """How the camera hangs on the vehicle (design, section 4)."""

    FIXED = "fixed"
    STABILISED = "stabilised"
    PAN_TILT = "pan_tilt"


@dataclass(frozen=True, slots=True, eq=False)
class CameraAttitude:
    """Rotation (3, 3) of the camera, and its error about the NED axes.

    The error is ``by_attitude`` (3, 3) times the vehicle's attitude error plus ``by_boresight`` (3, 3) times the
    misalignment error. ``slew_ned_rad_s`` (3,) is how fast a gimbal turns: its reports lag and are read between.
    """

    ned_from_camera: Float
    by_attitude: Float
    by_boresight: Float
    slew_ned_rad_s: Float = field(default_factory=lambda: np.zeros(3))

    @property
    def slew_rad_s(self) -> float:
        """How fast a gimbal turns it."""
        return float(np.linalg.norm(self.slew_ned_rad_s))

    @property
    def being_turned(self) -> bool:
        """Whether that is too fast for its reports to tell where a picture looks."""
        return self.slew_rad_s > MAX_SLEW_RAD_S


class CameraAttitudeModel:
    """Keeps what the gimbal reports and turns it into the camera's attitude."""

    def __init__(self, mount: Mount, gimbal: Gimbal) -> None:
        self._mount = mount
        self._gimbal = gimbal
        self._reports = AttitudeTrack()
        self._yaw_is_earth = True
        self.turn_rad = 0.0  # about the vertical, from headings as the vehicle has them to true ones

    def offer(self, sample: CameraAttitudeSample) -> None:
        """Take a report of the gimbal; a fixed camera ignores it."""
        if self._gimbal is not Gimbal.FIXED:
            self._yaw_is_earth = sample.yaw_is_earth
            self._reports.add(sample.t_us, sample.q_ned_from_gimbal)

    @property
    def lever_arm_frd_m(self) -> Float:
        """Position of the camera in body axes (3,)."""
        return self._mount.lever_arm_frd_m

    def at(self, t_us: int, q_ned_from_body: Float, boresight_rad: Float, *, turned: bool = True) -> CameraAttitude:
        """The camera's attitude at a time, with the estimated misalignment (3,) in the mount's axes applied.

        Where the gimbal reports a heading it is turned by ``turn_rad`` unless ``turned`` is False.
        """
        misalignment = matrix_from_q(q_from_rotvec(boresight_rad))
        if self._gimbal is Gimbal.FIXED:
            ned_from_body = matrix_from_q(q_ned_from_body)
            camera = ned_from_body @ misalignment @ self._mount.body_from_camera
            return CameraAttitude(camera, np.eye(3), ned_from_body)
        report = self._reports.at(t_us, max_extrapolation_us=1_000_000)
        level = level_yaw_matrix(q_ned_from_body)
        yaw_only = np.diag([0.0, 0.0, 1.0])
        if report is None:
            # no report: roll and pitch of the mount are relative to the horizon, its yaw to the body
            return CameraAttitude(level @ misalignment @ self._mount.body_from_camera, yaw_only, level)
        ned_from_gimbal = matrix_from_q(report)
        if not self._yaw_is_earth:
            ned_from_gimbal = level @ ned_from_gimbal
        elif turned and self.turn_rad != 0.0:
            ned_from_gimbal = matrix_from_q(q_from_rotvec(np.array([0.0, 0.0, self.turn_rad]))) @ ned_from_gimbal
        by_attitude = np.zeros((3, 3)) if self._yaw_is_earth else yaw_only
        camera = ned_from_gimbal @ misalignment @ GIMBAL_FROM_CAMERA
        # Nobody turns a stabilised camera; what its reports differ by is their own noise.
        slew = self._reports.turning_rad_s(t_us) if self._gimbal is Gimbal.PAN_TILT else np.zeros(3)
        return CameraAttitude(camera, by_attitude, ned_from_gimbal, ned_from_gimbal @ slew)


def camera_rotation_jacobian(attitude: CameraAttitude, eskf: ErrorStateFilter) -> Float:
    """Jacobian (3, n) of the camera's rotation error by the filter's error state."""
    return eskf.layout.jacobian(3, attitude=attitude.by_attitude, boresight=attitude.by_boresight)
