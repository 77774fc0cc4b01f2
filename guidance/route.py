"""A path through some points: straight legs, and bends that are flown without stopping. Pure.

Each corner is cut by a cubic (``guidance.path``) that leaves one leg and joins the next in their directions, at most
``CORNER_M`` and half of a leg before it, so that the way is never farther from the corner than that.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np

from estimator.geometry.checks import check_vectors
from estimator.types import Float
from guidance.path import CubicSegment, PathSegment

CORNER_M = 40.0
"""So far before a corner a bend begins at most."""
_SAME_M = 1.0
_STRAIGHT_RAD = math.radians(3.0)
_BACK_RAD = math.radians(150.0)
"""A corner sharper than this is flown to, and left from, standing."""


def route_through(points_ned_m: Float, cruise_m_s: float, corner_m: float = CORNER_M) -> tuple[PathSegment, ...]:
    """The segments through ``points_ned_m`` (n, 3), n >= 2, cruised at ``cruise_m_s``; it stops at the last point.

    Points closer than a metre to the one before are left out.

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
    segments: list[PathSegment] = []
    at = kept[0]
    for before, corner, after in zip(kept, kept[1:], kept[2:], strict=False):
        leg, following = corner - before, after - corner
        turn_rad = _angle(leg, following)
        if turn_rad < _STRAIGHT_RAD or turn_rad > _BACK_RAD:
            end_m_s = cruise_m_s if turn_rad < _STRAIGHT_RAD else 0.0
            segments.append(_straight(at, corner, cruise_m_s, end_m_s))
            at = corner
            continue
        cut_m = min(corner_m, 0.5 * float(np.linalg.norm(leg)), 0.5 * float(np.linalg.norm(following)))
        enters, leaves = corner - cut_m * _unit(leg), corner + cut_m * _unit(following)
        if float(np.linalg.norm(enters - at)) >= _SAME_M:
            segments.append(_straight(at, enters, cruise_m_s, cruise_m_s))
        else:
            enters = at
        size_m = _bend_m(cut_m, turn_rad)
        curve = CubicSegment(enters, leaves, size_m * _unit(leg), size_m * _unit(following))
        segments.append(PathSegment(curve, cruise_m_s, cruise_m_s))
        at = leaves
    if float(np.linalg.norm(kept[-1] - at)) >= _SAME_M:
        segments.append(_straight(at, kept[-1], cruise_m_s, 0.0))
    return tuple(segments)


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


def _straight(start: Float, end: Float, cruise_m_s: float, end_m_s: float) -> PathSegment:
    return PathSegment(CubicSegment(start, end, end - start, end - start), cruise_m_s, end_m_s)


def _bend_m(cut_m: float, turn_rad: float) -> float:
    """Size of a bend's derivatives, so that its middle is as curved as a circle that touches both legs.

    The cubic is a Bezier curve with control points a third of these along the legs; a circle's is the well-known
    4/3 tan(turn / 4) of its radius, which here is cut / tan(turn / 2).
    """
    return 4.0 * math.tan(turn_rad / 4.0) * cut_m / math.tan(turn_rad / 2.0)


def _unit(vector: Float) -> Float:
    unit: Float = vector / np.linalg.norm(vector)
    return unit


def _angle(one: Float, other: Float) -> float:
    cosine = float(_unit(one) @ _unit(other))
    return math.acos(min(max(cosine, -1.0), 1.0))
