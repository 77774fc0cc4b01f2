"""The way home: segments to follow through some points, and the ground below them. Pure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np

from estimator.geometry.checks import check_vectors
from estimator.types import Float
from guidance.path import PathSegment
from guidance.plan_path import PlanPoint, curves_through

_SAME_M = 1.0
_PARALLEL = 1.0 - 1e-6


def route_through(points_ned_m: Float, cruise_m_s: float) -> tuple[PathSegment, ...]:
    """The segments through ``points_ned_m`` (n, 3), n >= 2, cruised at ``cruise_m_s``; it stops at the last point.

    They are those of a plan (``guidance.plan_path``): where the way turns back it stops too. Points closer than a metre
    to the one before are left out.

    Raises
    ------
    ValueError
        A number is not finite, or fewer than two points are left.
    """
    check_vectors(**{f"points_ned_m[{number}]": point for number, point in enumerate(points_ned_m)})
    kept = [np.asarray(points_ned_m[0], np.float64)]
    for point in points_ned_m[1:]:
        if float(np.linalg.norm(point - kept[-1])) >= _SAME_M:
            kept.append(np.asarray(point, np.float64))
    if len(kept) < 2:
        message = "a way leads through two points at least that are a metre apart"
        raise ValueError(message)
    curves = curves_through([PlanPoint(place, cruise_m_s) for place in kept])
    through = [_parallel(a.end_tangent_ned_m, b.start_tangent_ned_m) for a, b in itertools.pairwise(curves)]
    ends_m_s = [cruise_m_s if passed else 0.0 for passed in (*through, False)]
    return tuple(PathSegment(curve, cruise_m_s, end_m_s) for curve, end_m_s in zip(curves, ends_m_s, strict=True))


def highest_ground_amsl_m(
    points_ned_m: Float, alt_amsl_m: Callable[[Float, Float], Float], aside_m: float = 40.0, step_m: float = 10.0
) -> float:
    """The highest ground below legs between ``points_ned_m`` (n, 3) and ``aside_m`` beside them.

    ``alt_amsl_m`` gives the ground's height at arrays of north and east, NaN where it is unknown; NaN where it is
    unknown everywhere.
    """
    highest = math.nan
    for start, end in itertools.pairwise(points_ned_m):
        along = (end - start)[:2]
        length_m = float(np.hypot(*along))
        ahead = along / length_m if length_m > 0.0 else np.array((1.0, 0.0))
        across = np.array((-ahead[1], ahead[0]))
        s = np.linspace(-aside_m, length_m + aside_m, max(2, math.ceil((length_m + 2 * aside_m) / step_m) + 1))
        w = np.linspace(-aside_m, aside_m, max(3, math.ceil(2 * aside_m / step_m) + 1))
        ne = start[:2] + s[:, None, None] * ahead + w[None, :, None] * across
        heights = alt_amsl_m(ne[..., 0].ravel(), ne[..., 1].ravel())
        if np.any(np.isfinite(heights)):
            highest = float(np.fmax(highest, np.nanmax(heights)))
    return highest


def _parallel(one: Float, other: Float) -> bool:
    return float(one @ other) > _PARALLEL * float(np.linalg.norm(one) * np.linalg.norm(other))
