"""How a frame of the telemetry turned: the angle it has run through, as a smooth function of time.

The integral of the rate along the frame's own axes, as an aircraft's rate sensor sums it up. Between two times a tenth
of a second apart its difference is the rotation vector but for coning, which is of third order in the time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly

from estimator.geometry.rotation import q_conjugate, q_multiply, rotvec_from_q
from estimator.robust import NORMAL_BY_MAD
from estimator.types import Float

MIN_KNOTS = 4


class TurnTrack:
    """Angles (3,) run through over time, smooth between the knots; a gap longer than ``max_gap_s`` is not bridged."""

    def __init__(self, angle: PPoly, max_gap_s: float) -> None:
        self._angle = angle
        self._rate = angle.derivative()
        self._knots_s: Float = np.asarray(angle.x, dtype=np.float64)
        self._gaps_before = np.concatenate(([0], np.cumsum(np.diff(self._knots_s) > max_gap_s)))

    @classmethod
    def from_rates(cls, t_s: Float, rate_rad_s: Float, max_gap_s: float) -> TurnTrack | None:
        """From rates (n, 3) at ascending times, interpolated by a cubic spline; None for too few."""
        if len(t_s) < MIN_KNOTS:
            return None
        return cls(CubicSpline(t_s, rate_rad_s).antiderivative(), max_gap_s)

    @classmethod
    def from_attitudes(cls, t_s: Float, q: Float, rate_rad_s: Float | None, max_gap_s: float) -> TurnTrack | None:
        """From attitudes (n, 4) at ascending times; rates (n, 3), where they are given, are its slope at the knots."""
        if len(t_s) < MIN_KNOTS:
            return None
        steps = rotvec_from_q(q_multiply(q_conjugate(q[:-1]), q[1:]))
        angle = np.vstack((np.zeros(3), np.cumsum(steps, axis=0)))
        if rate_rad_s is None:
            return cls(CubicSpline(t_s, angle), max_gap_s)
        return cls(CubicHermiteSpline(t_s, angle, rate_rad_s), max_gap_s)

    @property
    def interval_s(self) -> float:
        """Usual time between knots."""
        return float(np.median(np.diff(self._knots_s)))

    @property
    def rate_noise_rad_s(self) -> Float:
        """White noise (3,) of the rate at a knot, if the motion is smooth over four of them; an upper bound if not."""
        third = np.diff(self._rate(self._knots_s), n=3, axis=0)
        # 1 + 9 + 9 + 1 squares of binomial coefficients
        noise: Float = NORMAL_BY_MAD * np.median(np.abs(third), axis=0) / np.sqrt(20.0)
        return noise

    def covers(self, from_s: Float, to_s: Float) -> NDArray[np.bool_]:
        """Whether spans (n,) lie within the track and touch none of its gaps."""
        first = np.searchsorted(self._knots_s, from_s, side="right") - 1
        last = np.searchsorted(self._knots_s, to_s, side="left")
        inside = (first >= 0) & (last < len(self._knots_s))
        first, last = np.clip(first, 0, None), np.clip(last, None, len(self._knots_s) - 1)
        covered: NDArray[np.bool_] = inside & (self._gaps_before[last] == self._gaps_before[first])
        return covered

    def turned(self, from_s: Float, to_s: Float) -> Float:
        """Angles (n, 3) run through between two times (n,), radians."""
        turned: Float = self._angle(to_s) - self._angle(from_s)
        return turned

    def rate(self, t_s: Float) -> Float:
        """Rates (n, 3) at times (n,), rad/s."""
        rate: Float = self._rate(t_s)
        return rate
