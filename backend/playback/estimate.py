"""A recorded or computed ``estimate.csv``: the state at any of its times."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backend.recorder.estimate import CAMERA_COLUMNS, GROUND_COLUMNS, NUMBER_COLUMNS, camera_pose, ground_bias
from estimator.geometry.camera import Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q, q_from_euler, q_from_matrix
from estimator.measurements.camera_attitude import CameraAttitudeModel, Gimbal
from estimator.ports import GroundModel
from estimator.types import CameraAttitudeSample, Float, Mode, NavigationState

MAX_GAP_US = 1_000_000
HOLD_US = 300_000  # the last line stands for the pictures just after it
# For tables that do not tell their attitude's errors: an autopilot's attitude is about as good. Targets say so.
ASSUMED_ATTITUDE_STD_DEG = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class EstimateTable:
    """Times (n,), ascending; ``values`` (n, 13) in the order of ``NUMBER_COLUMNS``; modes (n,).

    ``q_ned_from_camera`` (n, 4), ``cov_camera_pose`` (n, 6, 6), ``ground_bias_m`` (n,) and ``cov_ground_bias`` (n, 7)
    are NaN in lines that do not tell them.
    """

    t_us: np.ndarray
    values: Float
    modes: tuple[Mode, ...]
    q_ned_from_camera: Float
    cov_camera_pose: Float
    ground_bias_m: Float
    cov_ground_bias: Float

    @classmethod
    def read(cls, path: Path) -> EstimateTable:
        """Read a table; lines that are cut off or make no sense are left out. OSError when there is none."""
        times: list[int] = []
        rows: list[list[float]] = []
        modes: list[Mode] = []
        poses: list[tuple[Float, Float]] = []
        grounds: list[tuple[float, Float]] = []
        unknown = (np.full(4, np.nan), np.full((6, 6), np.nan))
        with path.open(newline="", encoding="utf-8", errors="replace") as file:
            for row in csv.DictReader(file):
                try:
                    t_us, mode = int(row["time_us"]), Mode(row["mode"])
                    numbers = [float(row[name] or "nan") for name in NUMBER_COLUMNS]
                except (KeyError, TypeError, ValueError):
                    continue
                if math.isfinite(numbers[0] + numbers[1]) and (not times or t_us > times[-1]):
                    times.append(t_us)
                    rows.append(numbers)
                    modes.append(mode)
                    poses.append(camera_pose(*(row.get(name) for name in CAMERA_COLUMNS)) or unknown)
                    ground = ground_bias(*(row.get(name) for name in GROUND_COLUMNS))
                    grounds.append(ground or (np.nan, np.full(7, np.nan)))
        values = np.array(rows, dtype=np.float64).reshape(-1, len(NUMBER_COLUMNS))
        q = np.array([pose[0] for pose in poses]).reshape(-1, 4)
        cov = np.array([pose[1] for pose in poses]).reshape(-1, 6, 6)
        bias, cov_bias = np.array([g[0] for g in grounds]), np.array([g[1] for g in grounds]).reshape(-1, 7)
        return cls(np.array(times, dtype=np.int64), values, tuple(modes), q, cov, bias, cov_bias)

    def index_at(self, t_us: int) -> int:
        """The last line at or before a time, -1 before the first."""
        return int(np.searchsorted(self.t_us, t_us, side="right")) - 1

    def at(self, t_us: int) -> tuple[Float, Mode] | None:
        """The line's numbers at a time, interpolated; None outside the table and in its gaps."""
        found = self._between(t_us)
        if found is None:
            return None
        index, part = found
        if part == 0.0:
            return self.values[index], self.modes[index]
        step = self.values[index + 1] - self.values[index]
        step[3:6] = (step[3:6] + 180.0) % 360.0 - 180.0  # angles go the short way round
        step[1] = (step[1] + 180.0) % 360.0 - 180.0
        return self.values[index] + part * step, self.modes[index]

    def camera_pose_at(self, t_us: int) -> tuple[Float, Float] | None:
        """``q_ned_from_camera`` and ``cov_camera_pose`` at a time, interpolated; None where the table has none."""
        found = self._between(t_us)
        if found is None:
            return None
        index, part = found
        after = index + 1 if part > 0.0 else index
        before_q, after_q = self.q_ned_from_camera[index], self.q_ned_from_camera[after]
        # A quaternion and its negative are one rotation; over 0.1 s the chord is as good as the arc.
        q = before_q + part * (np.copysign(1.0, before_q @ after_q) * after_q - before_q)
        cov = self.cov_camera_pose[index] + part * (self.cov_camera_pose[after] - self.cov_camera_pose[index])
        return (q / np.linalg.norm(q), cov) if np.isfinite(q).all() and np.isfinite(cov).all() else None

    def ground_bias_at(self, t_us: int) -> tuple[float, Float] | None:
        """``ground_bias_m`` and ``cov_ground_bias`` at a time, interpolated; None where the table has none."""
        found = self._between(t_us)
        if found is None:
            return None
        index, part = found
        after = index + 1 if part > 0.0 else index
        bias, cov = (
            values[index] + part * (values[after] - values[index])
            for values in (self.ground_bias_m, self.cov_ground_bias)
        )
        return (float(bias), cov) if np.isfinite(bias) and np.isfinite(cov).all() else None

    def _between(self, t_us: int) -> tuple[int, float] | None:
        """The line before a time, and the part of the way from it to the next; None outside and in gaps."""
        index = self.index_at(t_us)
        if index < 0:
            return None
        before_us = int(self.t_us[index])
        if index + 1 >= len(self.t_us):
            return (index, 0.0) if t_us - before_us <= HOLD_US else None
        after_us = int(self.t_us[index + 1])
        if after_us - before_us > MAX_GAP_US:
            return (index, 0.0) if t_us == before_us else None
        return index, (t_us - before_us) / (after_us - before_us)


@dataclass(slots=True, eq=False)
class RecordedStates:
    """Navigation states from a table.

    The camera's attitude and the errors of its pose are the table's where it tells them, else the attitude is what the
    mount or the gimbal's reports make of the body's, and its error is assumed. The ground lies as the table tells, else
    where its model has it.
    """

    table: EstimateTable
    frame: LocalFrame
    ground: GroundModel
    mount: Mount
    gimbal: str
    gimbal_reports: list[CameraAttitudeSample]

    def at(self, t_us: int) -> NavigationState | None:
        """The state at a time; None where the table has none."""
        found = self.table.at(t_us)
        if found is None:
            return None
        values, mode = found
        lat_deg, lon_deg, alt_m, roll, pitch, yaw, vn, ve, vd, std_n, std_e, std_d, cov_ne = (float(v) for v in values)
        lat_rad, lon_rad = math.radians(lat_deg), math.radians(lon_deg)
        attitude = (math.radians(angle) if math.isfinite(angle) else 0.0 for angle in (roll, pitch, yaw))
        q_ned_from_body = q_from_euler(*attitude)
        pos = self.frame.ned_from_geodetic(lat_rad, lon_rad, alt_m)
        cov = np.array([[std_n**2, cov_ne, 0.0], [cov_ne, std_e**2, 0.0], [0.0, 0.0, std_d**2]])
        told = self.table.camera_pose_at(t_us)
        q_ned_from_camera, pose = told or self._assumed_pose(t_us, q_ned_from_body, cov)
        # Its covariances are with the pose of the same line: they go with no other.
        bias_m, cov_bias = (None if told is None else self.table.ground_bias_at(t_us)) or (0.0, None)
        ground = float(np.atleast_1d(self.ground.alt_amsl_m(pos[0:1], pos[1:2]))[0])
        return NavigationState(
            t_us=t_us, mode=mode, process_model="recorded", lat_rad=lat_rad, lon_rad=lon_rad, alt_amsl_m=alt_m,
            alt_agl_m=alt_m - ground + bias_m, pos_ned_m=pos, vel_ned_m_s=np.array([vn, ve, vd]),
            q_ned_from_body=q_ned_from_body, q_ned_from_camera=q_ned_from_camera, cov_pos_ned_m2=cov,
            cov_vel_ned_m2_s2=np.full((3, 3), np.nan), cov_attitude_rad2=pose[3:, 3:], cov_camera_pose=pose,
            last_fix_age_s=math.inf,
            lever_ned_m=matrix_from_q(q_ned_from_body) @ np.asarray(self.mount.lever_arm_frd_m, dtype=np.float64),
            ground_bias_m=bias_m, cov_ground_bias=cov_bias,
        )  # fmt: skip

    def assumption_at(self, t_us: int) -> str | None:
        """What is assumed for the camera's pose at a time; None where the table tells it."""
        if self.table.camera_pose_at(t_us) is not None:
            return None
        return f"attitude {ASSUMED_ATTITUDE_STD_DEG:g} deg assumed"

    def _assumed_pose(self, t_us: int, q_ned_from_body: Float, cov_pos_ned_m2: Float) -> tuple[Float, Float]:
        camera = CameraAttitudeModel(self.mount, Gimbal(self.gimbal))
        for report in self._reports_near(t_us):
            camera.offer(report)
        pose = np.zeros((6, 6))
        pose[:3, :3] = cov_pos_ned_m2
        pose[3:, 3:] = np.eye(3) * math.radians(ASSUMED_ATTITUDE_STD_DEG) ** 2
        return q_from_matrix(camera.at(t_us, q_ned_from_body, np.zeros(3)).ned_from_camera), pose

    def _reports_near(self, t_us: int) -> list[CameraAttitudeSample]:
        return [report for report in self.gimbal_reports if abs(report.t_us - t_us) < 2_000_000]
