"""Cubic segments in space, out of which a path is put together. Pure.

Conte's thesis (2009), section 4.3.1: a segment is a cubic (4.1) given by both ends and the derivatives there (4.2);
its derivatives are (4.3) and (4.4), its curvature vector is (4.5). The parameter runs from 0 to 1 and is no length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from estimator.geometry.checks import check_vectors
from estimator.types import Float

_CUBIC: Float = np.array(((2.0, -2.0, 1.0, 1.0), (-3.0, 3.0, -2.0, -1.0), (0.0, 0.0, 1.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
"""Of (4.2): coefficients of s^3, s^2, s and 1 from the four boundary vectors."""
_SAMPLES = 65
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_SMALLEST_M = 1e-3
"""Ends and derivatives shorter than a millimetre give a segment no direction."""


@dataclass(frozen=True, slots=True, eq=False)
class LengthTable:
    """Arc length from the start, (n,), at evenly spaced parameters, (n,), from 0 to 1."""

    s: Float
    length_m: Float


@dataclass(frozen=True, eq=False)
class CubicSegment:
    """A cubic from ``start_ned_m`` to ``end_ned_m`` (3,) with the derivatives by the parameter there (3,), in metres.

    Raises
    ------
    ValueError
        A vector is not three finite numbers, the ends are the same point, or a derivative vanishes on the segment, so
        that it has no direction there (a cusp).
    """

    start_ned_m: Float
    end_ned_m: Float
    start_tangent_ned_m: Float
    end_tangent_ned_m: Float
    _coefficients: Float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        names = ("start_ned_m", "end_ned_m", "start_tangent_ned_m", "end_tangent_ned_m")
        for name in names:
            vector = np.array(getattr(self, name), np.float64)
            check_vectors(**{name: vector})
            vector.setflags(write=False)
            object.__setattr__(self, name, vector)
        if float(np.linalg.norm(self.end_ned_m - self.start_ned_m)) < _SMALLEST_M:
            message = "a segment must lead from one point to another; both ends are the same"
            raise ValueError(message)
        boundary = np.stack([getattr(self, name) for name in names])
        object.__setattr__(self, "_coefficients", _CUBIC @ boundary)
        tangent = self.tangent(np.linspace(0.0, 1.0, 2 * _SAMPLES - 1))
        # Between two samples a derivative that passes through zero turns about.
        about = np.sum(tangent[1:] * tangent[:-1], axis=-1) <= 0.0
        if float(np.linalg.norm(tangent, axis=-1).min()) < _SMALLEST_M or bool(about.any()):
            message = "the segment's derivative vanishes on its way: it has no direction there"
            raise ValueError(message)

    def point(self, s: ArrayLike) -> Float:
        """Positions (..., 3) at parameters (...), equation (4.2)."""
        s, (a, b, c, d) = np.asarray(s, np.float64)[..., None], self._coefficients
        place: Float = ((a * s + b) * s + c) * s + d
        return place

    def tangent(self, s: ArrayLike) -> Float:
        """Derivatives (..., 3) by the parameter, in metres, equation (4.3)."""
        s, (a, b, c, _) = np.asarray(s, np.float64)[..., None], self._coefficients
        tangent: Float = (3.0 * a * s + 2.0 * b) * s + c
        return tangent

    def second_derivative(self, s: ArrayLike) -> Float:
        """Second derivatives (..., 3) by the parameter, in metres, equation (4.4)."""
        s, (a, b, _, _) = np.asarray(s, np.float64)[..., None], self._coefficients
        second: Float = 6.0 * a * s + 2.0 * b
        return second

    def curvature(self, s: ArrayLike) -> Float:
        """Curvature vectors (..., 3) towards the centre of the turn, 1/m.

        Equation (4.5), in which (t x q) x t is q (t t) - t (t q).
        """
        t, q = self.tangent(s), self.second_derivative(s)
        size = np.sum(t * t, axis=-1, keepdims=True)
        k: Float = (q - t * (np.sum(t * q, axis=-1, keepdims=True) / size)) / size
        return k

    def turn_curvature(self, s: ArrayLike) -> Float:
        """Curvature (...) of the track over ground, 1/m, positive to the right: 1 / R_y of (4.14).

        Where the segment leads straight up or down there is no track, and it is zero.
        """
        t, q = self.tangent(s), self.second_derivative(s)
        level = np.hypot(t[..., 0], t[..., 1])
        cross = t[..., 0] * q[..., 1] - t[..., 1] * q[..., 0]
        steep = level < 1e-3 * np.linalg.norm(t, axis=-1)
        k: Float = np.where(steep, 0.0, cross / np.where(steep, 1.0, level) ** 3)
        return k

    @property
    def length_m(self) -> float:
        """Length of the whole segment."""
        return float(self.lengths.length_m[-1])

    @cached_property
    def lengths(self) -> LengthTable:
        """Arc lengths by Gauss-Legendre quadrature of the derivative's size."""
        s = np.linspace(0.0, 1.0, _SAMPLES)
        half = 0.5 * (s[1] - s[0])
        nodes = s[:-1, None] + half * (1.0 + _NODES)
        pieces = half * np.linalg.norm(self.tangent(nodes), axis=-1) @ _WEIGHTS
        return LengthTable(s, np.concatenate(((0.0,), np.cumsum(pieces))))

    def length_at_m(self, s: float) -> float:
        """Arc length from the start to ``s``."""
        return float(np.interp(s, self.lengths.s, self.lengths.length_m))

    def s_at(self, length_m: float) -> float:
        """The parameter at an arc length from the start, held within 0 and 1."""
        return float(np.interp(length_m, self.lengths.length_m, self.lengths.s))


@dataclass(frozen=True, slots=True, eq=False)
class PathSegment:
    """A segment as a planner sends it: the curve, the speed to cruise at, and the speed to have at its end.

    ``cruise_m_s`` and ``end_m_s`` are along the path (v_cruise, v_end of section 4.3.3).
    """

    curve: CubicSegment
    cruise_m_s: float
    end_m_s: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cruise_m_s) and self.cruise_m_s > 0.0):
            message = f"cruise_m_s must be positive, not {self.cruise_m_s}"
            raise ValueError(message)
        if not (math.isfinite(self.end_m_s) and self.end_m_s >= 0.0):
            message = f"end_m_s must not be negative, not {self.end_m_s}"
            raise ValueError(message)


def straight(start_ned_m: ArrayLike, end_ned_m: ArrayLike) -> CubicSegment:
    """A straight segment between two points (3,), passed at an even pace of its parameter."""
    start, end = np.asarray(start_ned_m, np.float64), np.asarray(end_ned_m, np.float64)
    return CubicSegment(start, end, end - start, end - start)


def helix(
    start_ned_m: ArrayLike, heading_rad: float, radius_m: float, turn_rad: float, climb_m: float, pieces: int
) -> list[CubicSegment]:
    """A turn of constant radius that climbs evenly, in equal pieces; positive ``turn_rad`` is to the right.

    The derivatives of a piece that turns by b are 4 tan(b / 4) radii long: a cubic's middle then lies on the circle,
    and with pieces of 45 degrees it is nowhere further off than 5e-6 radii.

    Raises
    ------
    ValueError
        ``radius_m`` is not positive, nothing is turned, or a piece turns by more than 90 degrees.
    """
    numbers = (heading_rad, radius_m, turn_rad, climb_m)
    if not (all(map(math.isfinite, numbers)) and radius_m > 0.0 and turn_rad != 0.0 and pieces > 0):
        message = f"a helix needs a positive radius, a turn and a number of pieces, not {numbers} in {pieces}"
        raise ValueError(message)
    each = turn_rad / pieces
    if abs(each) > math.pi / 2 + 1e-9:
        message = f"{pieces} pieces are too few for a turn of {math.degrees(turn_rad):g} degrees: 90 each at most"
        raise ValueError(message)
    side = math.copysign(radius_m, turn_rad)
    heading = heading_rad + each * np.arange(pieces + 1)
    centre = np.asarray(start_ned_m, np.float64) + side * np.array((-math.sin(heading_rad), math.cos(heading_rad), 0.0))
    down = -climb_m * np.arange(pieces + 1) / pieces
    points = centre + np.column_stack((side * np.sin(heading), -side * np.cos(heading), down))
    long = 4.0 * math.tan(abs(each) / 4.0) * radius_m
    tangents = np.column_stack((long * np.cos(heading), long * np.sin(heading), np.full(pieces + 1, -climb_m / pieces)))
    return [CubicSegment(points[k], points[k + 1], tangents[k], tangents[k + 1]) for k in range(pieces)]


def as_path(curves: Sequence[CubicSegment], cruise_m_s: float) -> list[PathSegment]:
    """Curves flown at one speed, with a stop at the end of the last."""
    last = len(curves) - 1
    return [PathSegment(curve, cruise_m_s, 0.0 if k == last else cruise_m_s) for k, curve in enumerate(curves)]
