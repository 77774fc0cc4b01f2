"""Errors of one replay as figures, and figures of many seeds as one row.

Horizontal errors are unaligned: the estimate as it was at the time, against truth. Consistency is told by the
normalised error squared e' P^-1 e: where the covariance is right its mean per degree of freedom is one, and the stated
regions hold their shares of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.types import Float

WITHIN_M = 10.0
WRONG_SIGMAS = 5.0
REGIONS = (0.5, 0.9, 0.95)
SEGMENT_STEP_M = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """The scored states of one replay: errors (n, 2), normalised squares (n,), declared valid (n,), heading (n,).

    ``by_vision`` (n,) is whether the mode says that a fix is recent.
    """

    error_ne_m: Float
    nees: Float
    valid: Float
    heading_error_rad: Float
    by_vision: Float


def scored(
    error_ne_m: Float, cov_ne_m2: Float, valid: Float, heading_error_rad: Float, by_vision: Float | None = None
) -> Scored:
    """Errors (n, 2) with their covariances (n, 2, 2); a singular covariance counts as infinitely sure.

    ``by_vision`` is as ``valid`` unless said.
    """
    nees = np.full(len(error_ne_m), np.inf)
    regular = np.linalg.det(cov_ne_m2) > 0.0
    error = error_ne_m[regular]
    nees[regular] = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov_ne_m2[regular]), error)
    valid = np.asarray(valid, dtype=np.float64)
    return Scored(error_ne_m, nees, valid, heading_error_rad, valid if by_vision is None else by_vision)


def navigation_figures(runs: Sequence[Scored]) -> dict[str, Any]:
    """Figures of all scored states of some replays together; raises ValueError where there are none."""
    if not runs:
        message = "no replay to take figures from"
        raise ValueError(message)
    error = np.hypot(*np.concatenate([run.error_ne_m for run in runs]).T)
    nees = np.concatenate([run.nees for run in runs])
    valid = np.concatenate([run.valid for run in runs]) > 0.5
    rms = [float(np.sqrt((run.error_ne_m**2).sum(axis=1).mean())) for run in runs]
    figures: dict[str, Any] = {
        "rms_m": float(np.sqrt((error**2).mean())),
        "p95_m": float(np.percentile(error, 95)),
        "largest_m": float(error.max()),
        "median_rms_m": float(np.median(rms)),
        "worst_rms_m": float(max(rms)),
        "availability": float((valid & (error <= WITHIN_M)).mean()),
        "declared_valid": float(valid.mean()),
        "by_vision": float(np.concatenate([run.by_vision for run in runs]).mean()),
        "wrong": float((np.sqrt(nees) > WRONG_SIGMAS).mean()),
        "nees_per_dof": float(nees.mean() / 2.0),
        "heading_rms_deg": _late_rms_deg(runs),
        "states": len(error),
    }
    # of two-dimensional Gaussians the share p lies within a normalised square of -2 ln(1 - p)
    inside = {f"inside_{round(100 * p)}": float((nees <= -2.0 * np.log(1.0 - p)).mean()) for p in REGIONS}
    return {**figures, **inside}


def _late_rms_deg(runs: Sequence[Scored]) -> float:
    """Heading error of the second half of each replay: what is left once there was time to find it."""
    late = np.concatenate([run.heading_error_rad[len(run.heading_error_rad) // 2 :] for run in runs])
    return float(np.degrees(np.sqrt(np.mean(np.square(late)))))


def drift(
    true_ne_m: Float, error_ne_m: Float, heading_error_rad: Float, lengths_m: Sequence[float],
    step_m: float = SEGMENT_STEP_M,
) -> dict[float, Float]:  # fmt: skip
    """Relative errors of an estimate over segments of a path, as shares of their lengths, for each length.

    Segments begin every ``step_m`` of the true path (n, 2), whose errors are (n, 2). As in the KITTI odometry benchmark
    (Geiger et al., CVPR 2012) a segment is taken relative to its beginning, position and heading: what the heading was
    wrong by there (n,) is no error of the odometer. Nothing is scaled.
    """
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(true_ne_m, axis=0).T))))
    found: dict[float, Float] = {}
    for length in lengths_m:
        starts = np.arange(0.0, along[-1] - length, step_m)
        first, last = np.searchsorted(along, starts), np.searchsorted(along, starts + length)
        moved = true_ne_m[last] - true_ne_m[first]
        estimated = moved + error_ne_m[last] - error_ne_m[first]
        cos, sin = np.cos(heading_error_rad[first]), np.sin(heading_error_rad[first])
        turned = np.stack(
            (cos * estimated[:, 0] + sin * estimated[:, 1], cos * estimated[:, 1] - sin * estimated[:, 0])
        )
        found[length] = np.hypot(*(turned.T - moved).T) / length
    return found


def drift_figures(runs: Sequence[dict[float, Float]]) -> dict[str, Any]:
    """Mean drift over all segments and over those of each length; a length that no path reached is left out."""
    figures: dict[str, Any] = {}
    together = [share for run in runs for share in run.values() if len(share)]
    if together:
        figures["drift"] = float(np.concatenate(together).mean())
    for length in sorted({length for run in runs for length in run}):
        shares = np.concatenate([run[length] for run in runs if length in run])
        if len(shares):
            figures[f"drift_{length:.0f}_m"] = float(shares.mean())
    return figures


def innovation_figures(runs: Sequence[dict[str, dict[str, float]]]) -> dict[str, Any]:
    """Mean normalised innovation squared per degree of freedom, of all measurements, of map fixes, and of each kind.

    ``runs`` are the ``innovations`` of replays' reports: ``numbers`` and ``nis_per_dof`` by kind.
    """
    numbers: dict[str, float] = {}
    sums: dict[str, float] = {}
    for run in runs:
        for what, tally in run.items():
            numbers[what] = numbers.get(what, 0.0) + tally["numbers"]
            sums[what] = sums.get(what, 0.0) + tally["numbers"] * tally["nis_per_dof"]
    if not numbers:
        return {}
    by_kind = {what: sums[what] / numbers[what] for what in sorted(numbers)}
    figures = {"nis_per_dof": sum(sums.values()) / sum(numbers.values()), "nis_per_dof_of": by_kind}
    return figures | ({"nis_of_fixes": by_kind["fix"]} if "fix" in by_kind else {})


def pooled(rows: Sequence[dict[str, float]]) -> dict[str, Any]:
    """Mean of each figure over the seeds that have it; where two or more do, its standard error as ``<name>_se``."""
    figures: dict[str, Any] = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        values = np.array([row[name] for row in rows if name in row])
        figures[name] = float(values.mean())
        if len(values) > 1:
            figures[f"{name}_se"] = float(values.std(ddof=1) / np.sqrt(len(values)))
    return figures
