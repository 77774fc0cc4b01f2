"""Errors of an estimate against truth: horizontal, vertical, consistency with the stated covariance."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from estimator.types import Float

CHI2_95_2DOF = 5.991464547107979
"""The 95 % quantile of a chi-square with two degrees of freedom, -2 ln 0.05."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Root mean square, median, 95th percentile and largest of absolute errors."""

    rms: float
    p50: float
    p95: float
    largest: float

    @classmethod
    def of(cls, errors: Float) -> Spread:
        """Of errors (n,), signed or not; raises ValueError where there are none."""
        if len(errors) == 0:
            message = "no errors to summarise"
            raise ValueError(message)
        size = np.abs(errors)
        return cls(
            float(np.sqrt((size**2).mean())), float(np.median(size)), float(np.percentile(size, 95)), float(size.max())
        )


@dataclass(frozen=True, slots=True)
class Evaluation:
    """An estimate's errors over the scored times, in metres unless said."""

    rows: int
    horizontal_m: Spread
    vertical_m: Spread
    final_horizontal_m: float
    nees_2d_mean: float
    inside_95_ellipse: float
    longest_gap_s: float

    def as_dict(self) -> dict[str, object]:
        """Nested plain values, for a report."""
        return asdict(self)


def evaluate(t_us: Float, error_ned_m: Float, cov_ne_m2: Float, spans_us: list[tuple[int, int]]) -> Evaluation | None:
    """Summarise errors (n, 3) with covariances (n, 2, 2) at times (n,) inside the spans; None where no time falls in.

    Errors are unaligned: the estimate as it was, against truth interpolated to its times.
    """
    scored = np.zeros(len(t_us), dtype=bool)
    longest_gap_us = 0.0
    for start, end in spans_us:
        inside = (t_us >= start) & (t_us <= end)
        scored |= inside
        marks = np.concatenate(([start], t_us[inside], [end]))
        longest_gap_us = max(longest_gap_us, float(np.diff(marks).max()))
    if not scored.any():
        return None
    error = error_ned_m[scored]
    horizontal = np.hypot(error[:, 0], error[:, 1])
    nees = np.einsum("ni,nij,nj->n", error[:, :2], np.linalg.inv(cov_ne_m2[scored]), error[:, :2])
    return Evaluation(
        rows=int(scored.sum()),
        horizontal_m=Spread.of(horizontal),
        vertical_m=Spread.of(error[:, 2]),
        final_horizontal_m=float(horizontal[-1]),
        nees_2d_mean=float(nees.mean()),
        inside_95_ellipse=float((nees <= CHI2_95_2DOF).mean()),
        longest_gap_s=longest_gap_us / 1e6,
    )
