"""A recorded or computed ``estimate.csv``: the state at any of its times."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.geometry.camera import Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_euler, q_from_matrix
from estimator.measurements.camera_attitude import CameraAttitudeModel, Gimbal
from estimator.ports import GroundModel
from estimator.types import CameraAttitudeSample, Float, Mode, NavigationState

MAX_GAP_US = 1_000_000
HOLD_US = 300_000  # the last line stands for the pictures just after it
# The table holds no attitude errors; these are what the estimator typically reaches.
ATTITUDE_STD_RAD = math.radians(1.0)
NUMBERS = (
    "lat_deg", "lon_deg", "alt_amsl_m", "roll_deg", "pitch_deg", "yaw_deg", "vn_mps", "ve_mps", "vd_mps",
    "std_n_m", "std_e_m", "std_d_m", "cov_ne_m2",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class EstimateTable:
    """Times (n,), ascending; ``values`` (n, 13) in the order of ``NUMBERS``; modes (n,)."""

    t_us: np.ndarray
    values: Float
    modes: tuple[Mode, ...]

    @classmethod
    def read(cls, path: Path) -> EstimateTable:
        """Read a table; lines that are cut off or make no sense are left out. OSError when there is none."""
        times: list[int] = []
        rows: list[list[float]] = []
        modes: list[Mode] = []
        with path.open(newline="", encoding="utf-8", errors="replace") as file:
            for row in csv.DictReader(file):
                try:
                    t_us, mode = int(row["time_us"]), Mode(row["mode"])
                    numbers = [float(row[name] or "nan") for name in NUMBERS]
                except (KeyError, TypeError, ValueError):
                    continue
                if math.isfinite(numbers[0] + numbers[1]) and (not times or t_us > times[-1]):
                    times.append(t_us)
                    rows.append(numbers)
                    modes.append(mode)
        values = np.array(rows, dtype=np.float64).reshape(-1, len(NUMBERS))
        return cls(np.array(times, dtype=np.int64), values, tuple(modes))

    def index_at(self, t_us: int) -> int:
        """The last line at or before a time, -1 before the first."""
        return int(np.searchsorted(self.t_us, t_us, side="right")) - 1

    def at(self, t_us: int) -> tuple[Float, Mode] | None:
        """The line's numbers at a time, interpolated; None outside the table and in its gaps."""
        index = self.index_at(t_us)
        if index < 0:
            return None
        before_us = int(self.t_us[index])
        if index + 1 >= len(self.t_us):
            return (self.values[index], self.modes[index]) if t_us - before_us <= HOLD_US else None
        after_us = int(self.t_us[index + 1])
        if after_us - before_us > MAX_GAP_US:
            return (self.values[index], self.modes[index]) if t_us == before_us else None
        part = (t_us - before_us) / (after_us - before_us)
        step = self.values[index + 1] - self.values[index]
        step[3:6] = (step[3:6] + 180.0) % 360.0 - 180.0  # angles go the short way round
        step[1] = (step[1] + 180.0) % 360.0 - 180.0
        return self.values[index] + part * step, self.modes[index]


@dataclass(slots=True, eq=False)
class RecordedStates:
    """Navigation states from a table, with the camera's attitude as the mount or the gimbal's reports have it."""

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
        camera = CameraAttitudeModel(self.mount, Gimbal(self.gimbal))
        for report in self._reports_near(t_us):
            camera.offer(report)
        cov = np.array([[std_n**2, cov_ne, 0.0], [cov_ne, std_e**2, 0.0], [0.0, 0.0, std_d**2]])
        pose = np.zeros((6, 6))
        pose[:3, :3] = cov
        pose[3:, 3:] = np.eye(3) * ATTITUDE_STD_RAD**2
        ground = float(np.atleast_1d(self.ground.alt_amsl_m(pos[0:1], pos[1:2]))[0])
        ned_from_camera = camera.at(t_us, q_ned_from_body, np.zeros(3)).ned_from_camera
        return NavigationState(
            t_us=t_us, mode=mode, process_model="recorded", lat_rad=lat_rad, lon_rad=lon_rad, alt_amsl_m=alt_m,
            alt_agl_m=alt_m - ground, pos_ned_m=pos, vel_ned_m_s=np.array([vn, ve, vd]),
            q_ned_from_body=q_ned_from_body, q_ned_from_camera=q_from_matrix(ned_from_camera), cov_pos_ned_m2=cov,
            cov_vel_ned_m2_s2=np.full((3, 3), np.nan), cov_attitude_rad2=np.eye(3) * ATTITUDE_STD_RAD**2,
            cov_camera_pose=pose, last_fix_age_s=math.inf,
        )  # fmt: skip

    def _reports_near(self, t_us: int) -> list[CameraAttitudeSample]:
        return [report for report in self.gimbal_reports if abs(report.t_us - t_us) < 2_000_000]
