"""A line of ``estimate.csv``: the columns everybody knows (design, section 4), then for clicks the camera's pose and
how far the ground lies below the ground model.

A table that someone else made may lack the last four columns.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.geometry.rotation import euler_from_q
from estimator.types import Float, NavigationState

NUMBER_COLUMNS = (
    "lat_deg", "lon_deg", "alt_amsl_m", "roll_deg", "pitch_deg", "yaw_deg", "vn_mps", "ve_mps", "vd_mps",
    "std_n_m", "std_e_m", "std_d_m", "cov_ne_m2",
)  # fmt: skip
CAMERA_COLUMNS = ("q_ned_from_camera", "cov_camera_pose")
GROUND_COLUMNS = ("ground_bias_m", "cov_ground_bias")
ESTIMATE_COLUMNS = ("time_us", *NUMBER_COLUMNS, "mode", *CAMERA_COLUMNS, *GROUND_COLUMNS)
_UPPER = np.triu_indices(6)


def estimate_cells(state: NavigationState) -> tuple[int | float | str | None, ...]:
    """The cells of one line."""
    roll, pitch, yaw = (math.degrees(float(angle)) for angle in euler_from_q(state.q_ned_from_body))
    vn, ve, vd = (round(float(value), 4) for value in state.vel_ned_m_s)
    std_n, std_e, std_d = (round(float(v), 4) for v in np.sqrt(np.maximum(np.diag(state.cov_pos_ned_m2), 0.0)))
    return (
        state.t_us, f"{math.degrees(state.lat_rad):.9f}", f"{math.degrees(state.lon_rad):.9f}",
        round(state.alt_amsl_m, 3), round(roll, 4), round(pitch, 4), round(yaw % 360.0, 4), vn, ve, vd,
        std_n, std_e, std_d, round(float(state.cov_pos_ned_m2[0, 1]), 6), str(state.mode),
        _packed(state.q_ned_from_camera), _packed(state.cov_camera_pose[_UPPER]), *_ground_cells(state),
    )  # fmt: skip


def camera_pose(q_cell: str | None, cov_cell: str | None) -> tuple[Float, Float] | None:
    """``q_ned_from_camera`` (4,) and ``cov_camera_pose`` (6, 6) of a line; None where they are missing or broken."""
    q, upper = _unpacked(q_cell, 4), _unpacked(cov_cell, len(_UPPER[0]))
    if q is None or upper is None or not 0.5 < float(np.linalg.norm(q)) < 2.0:
        return None
    cov = np.zeros((6, 6))
    cov[_UPPER] = upper
    cov = cov + cov.T - np.diag(np.diag(cov))
    if np.any(np.diag(cov) < 0.0):
        return None
    return q / np.linalg.norm(q), cov


def ground_bias(bias_cell: str | None, cov_cell: str | None) -> tuple[float, Float] | None:
    """``ground_bias_m`` and ``cov_ground_bias`` (7,) of a line; None where they are missing or broken."""
    bias, cov = _unpacked(bias_cell, 1), _unpacked(cov_cell, 7)
    return None if bias is None or cov is None or cov[6] < 0.0 else (float(bias[0]), cov)


def _ground_cells(state: NavigationState) -> tuple[str | None, str | None]:
    """Empty where no bias was estimated."""
    if state.cov_ground_bias is None:
        return None, None
    return f"{state.ground_bias_m:.4f}", _packed(state.cov_ground_bias)


def _packed(numbers: Float) -> str:
    return " ".join(f"{float(number):.8g}" for number in numbers)


def _unpacked(cell: str | None, count: int) -> Float | None:
    try:
        numbers = np.array([float(part) for part in (cell or "").split()])
    except ValueError:
        return None
    return numbers if len(numbers) == count and bool(np.isfinite(numbers).all()) else None
