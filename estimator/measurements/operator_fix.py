"""A position that an operator gave by laying a picture on the map."""

from __future__ import annotations

import math

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.history import StateHistory
from estimator.measurements.innovation import Innovation
from estimator.types import AlignmentSample, FixReport, Float

KIND = "operator"
STEP_US = 100_000
NEWEST_US = 500_000
# Beyond it the estimate was surer of itself than it should have been: whoever looked at the picture is right.
CONTRADICTION_SIGMAS = 3.0
GATE_SIGMAS = 5.0


def position(eskf: ErrorStateFilter, pos_ne_m: Float, cov_ne_m2: Float) -> Innovation:
    """Innovation of a place (2,) read off the reference imagery, which may itself be displaced."""
    nominal, place = eskf.nominal, np.eye(3)[:2]
    z = pos_ne_m - nominal.motion.pos_ned_m[:2] - nominal.map_displacement_ne_m
    H = eskf.layout.jacobian(2, position=place, map_bias=np.eye(2), map_region=np.eye(2), map_offset=np.eye(2))
    return Innovation(z, H, cov_ne_m2)


def fuse(eskf: ErrorStateFilter, sample: AlignmentSample, history: StateHistory) -> FixReport:
    """Correct the filter, which stands at ``sample.t_us``, by what an operator said of a frame of before.

    The way since that frame comes from the velocities of the states on it, not from their places: those jump with
    every fix, right or wrong. Its error is that of the velocity for as long. An estimate that contradicts the operator
    is widened first, so that it gives way.

    Returns
    -------
    FixReport
        Of kind ``operator``; refused where the history does not reach back to the frame.
    """
    way = _way_since(sample, history, eskf.nominal.motion.vel_ned_m_s)
    if way is None:
        nowhere = np.full(2, np.nan)
        return _report(sample, nowhere, np.full((2, 2), np.nan), "the estimate does not reach back to that frame")
    moved_ne_m, cov_way_m2 = way
    pos_ne_m, cov_ne_m2 = sample.pos_ne_m + moved_ne_m, sample.cov_ne_m2 + cov_way_m2
    measured = position(eskf, pos_ne_m, cov_ne_m2)
    spread = measured.H @ eskf.P @ measured.H.T + measured.R
    sigmas = math.sqrt(float(measured.z @ np.linalg.solve(spread, measured.z)))
    if sigmas > CONTRADICTION_SIGMAS:
        eskf.doubt_place(np.outer(measured.z, measured.z))
    accepted, _ = eskf.update(measured.z, measured.H, measured.R, GATE_SIGMAS**2 * 2, KIND)
    reason = "" if accepted else f"it lies {sigmas:.0f} sigma from the estimate"
    return _report(sample, pos_ne_m, cov_ne_m2, reason)


def _way_since(sample: AlignmentSample, history: StateHistory, vel_now_ned_m_s: Float) -> tuple[Float, Float] | None:
    """Way north and east (2,) from the frame to the sample's time, and its covariance (2, 2)."""
    # A frame may be newer than the newest state that is kept.
    first = history.at(sample.t_frame_us) or history.at(sample.t_frame_us - NEWEST_US)
    span_us = sample.t_us - sample.t_frame_us
    if first is None or span_us < 0:
        return None
    times_us = np.linspace(sample.t_frame_us, sample.t_us, max(span_us // STEP_US, 1) + 1)
    # The newest state may be a little older than the filter.
    states = [history.at(int(t_us)) for t_us in times_us[:-1]]
    speeds = np.array([vel_now_ned_m_s if state is None else state.vel_ned_m_s for state in states])
    speeds = np.vstack((speeds, vel_now_ned_m_s))[:, :2]
    seconds = times_us / 1e6 - times_us[0] / 1e6
    moved: Float = np.trapezoid(speeds, seconds, axis=0)
    cov: Float = first.cov_vel_ned_m2_s2[:2, :2] * (span_us / 1e6) ** 2
    return moved, cov


def _report(sample: AlignmentSample, pos_ne_m: Float, cov_ne_m2: Float, reason: str) -> FixReport:
    return FixReport(
        sample.t_us, sample.frame_id, KIND, reason == "", reason, float(pos_ne_m[0]), float(pos_ne_m[1]), cov_ne_m2,
        score=math.nan, outlier_probability=math.nan, heading_correction_rad=0.0, scale_correction=0.0, elapsed_ms=0.0,
    )  # fmt: skip
