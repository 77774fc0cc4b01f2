"""The path through the points of a plan as it would be flown, and how fast. Pure.

Legs are cubics (``guidance.path``). At a point that is passed the direction is that of the parabola through it and its
neighbours (Catmull and Rom 1974, by chord lengths); at one where the vehicle stops each leg is straight. Speeds are
those of ``guidance.velocity_profile``: cruise, bends, descents, and what can be braked and accelerated between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from guidance.path import CubicSegment, straight
from guidance.velocity_profile import (
    FlightEnvelope,
    allowed_ahead_m_s,
    descent_speed_m_s,
    turn_speeds,
    turning_speed_m_s,
)

Int = NDArray[np.int64]
_LEAST_SAMPLES = 8
_MOST_SAMPLES = 20_000
_SAME_PLACE_M = 0.01
_LEAST_SPEED_M_S = 0.05
# A leg steeper than this has no heading to carry into the next, and a turn beyond that is made standing.
_STEEP_LEG_RAD, _ABOUT_RAD = math.radians(60.0), math.radians(150.0)


@dataclass(frozen=True, slots=True)
class PathLimits:
    """What a vehicle is asked for along a plan; ValueError where a limit is not positive and finite.

    ``slowest_turn_m_s`` is the slowest that a bend is worth flying: a tighter one is a problem. A vehicle that does not
    hover neither stops nor slows down.
    """

    envelope: FlightEnvelope = field(default_factory=FlightEnvelope)
    climb_m_s: float = 2.5
    slowest_turn_m_s: float = 1.5
    climb_max_rad: float = math.radians(45.0)
    descent_max_rad: float = math.radians(30.0)
    hovers: bool = True

    def __post_init__(self) -> None:
        for name in ("climb_m_s", "slowest_turn_m_s", "climb_max_rad", "descent_max_rad"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                message = f"{name} must be positive, not {value}"
                raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class PlanPoint:
    """A place (3,) of a plan: whether the vehicle stops there, for how long, and its cruising speed from there on."""

    pos_ned_m: Float
    cruise_m_s: float
    stops: bool = False
    stay_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PlannedPath:
    """Samples along a path, each array (k,) or (k, 3).

    ``leg`` is the leg that leads to the sample, from 0. ``turn_radius_m`` is infinite where nothing is turned.
    ``allowed_turn_m_s`` is the fastest that the bend may be flown; ``climb_rad`` is positive upwards. ``arrivals`` (n,)
    is the sample at which each point is reached. ``time_s`` counts from the start and holds the stays.
    """

    pos_ned_m: Float
    length_m: Float
    speed_m_s: Float
    turn_radius_m: Float
    allowed_turn_m_s: Float
    climb_rad: Float
    time_s: Float
    leg: Int
    arrivals: Int


def curves_through(points: Sequence[PlanPoint]) -> list[CubicSegment]:
    """One cubic a leg through two points or more; ValueError where neighbours are at the same place."""
    places = np.array([point.pos_ned_m for point in points])
    chords = np.diff(places, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    if len(points) < 2 or lengths.min() < _SAME_PLACE_M:
        message = "a path needs two points or more, and none at the place of the one before"
        raise ValueError(message)
    units = chords / lengths[:, None]
    stands = _stands(points, units)
    curves: list[CubicSegment] = []
    for k, unit in enumerate(units):
        ends = [unit if stands[i] else _direction(units, lengths, i) for i in (k, k + 1)]
        try:
            curves.append(CubicSegment(places[k], places[k + 1], lengths[k] * ends[0], lengths[k] * ends[1]))
        except ValueError:  # it would turn about on its way
            curves.append(straight(places[k], places[k + 1]))
    return curves


def planned_path(points: Sequence[PlanPoint], limits: PathLimits, spacing_m: float = 2.0) -> PlannedPath:
    """Fly through points, of which no two neighbours are at the same place; samples are at most ``spacing_m`` apart.

    A path of more than some forty kilometres gets wider samples. ValueError as ``curves_through``.
    """
    curves = curves_through(points)
    stands = _stands(points, np.array([curve.end_ned_m - curve.start_ned_m for curve in curves]), scaled=False)
    total_m = sum(curve.length_m for curve in curves)
    spacing_m = max(spacing_m, total_m / _MOST_SAMPLES)
    pieces = [_sampled(curve, spacing_m) for curve in curves]
    arrivals = np.concatenate(((0,), np.cumsum([len(piece.along_m) - 1 for piece in pieces])))
    start_m = np.concatenate(((0.0,), np.cumsum([curve.length_m for curve in curves])))
    length_m = _joined([piece.along_m + begin for piece, begin in zip(pieces, start_m[:-1], strict=True)])
    curvature = _joined([piece.curvature for piece in pieces])
    for k, (before, after) in enumerate(pairwise(pieces), 1):
        # The second derivative jumps where two cubics meet: the tighter side counts.
        sides = (before.curvature[-1], after.curvature[0])
        curvature[arrivals[k]] = 0.0 if stands[k] else max(sides, key=abs)
    direction = _joined([piece.direction for piece in pieces])
    leg = np.repeat(np.arange(len(curves)), [len(p.along_m) - 1 for p in pieces])
    leg = np.concatenate(((0,), leg))
    cruise = np.array([point.cruise_m_s for point in points])[leg]
    speed = _speeds(length_m, direction, curvature, cruise, arrivals[stands], limits)
    with np.errstate(divide="ignore"):
        radius_m = 1.0 / np.abs(curvature)
    return PlannedPath(
        _joined([piece.pos_ned_m for piece in pieces]), length_m, speed, radius_m,
        turn_speeds(curvature, limits.envelope).least_m_s, -np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)),
        _times(length_m, speed, arrivals, [point.stay_s for point in points]), leg, arrivals,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    pos_ned_m: Float
    along_m: Float
    curvature: Float
    direction: Float


def _sampled(curve: CubicSegment, spacing_m: float) -> _Piece:
    count = max(_LEAST_SAMPLES, math.ceil(curve.length_m / spacing_m))
    along_m = np.linspace(0.0, curve.length_m, count + 1)
    s = np.interp(along_m, curve.lengths.length_m, curve.lengths.s)
    tangent = curve.tangent(s)
    unit = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
    return _Piece(curve.point(s), along_m, curve.turn_curvature(s), unit)


def _joined(parts: Sequence[Float]) -> Float:
    """Samples of all legs, of which each begins where the one before ends."""
    joined: Float = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    return joined


def _stands(points: Sequence[PlanPoint], chords: Float, *, scaled: bool = True) -> list[bool]:
    """At which points (n,) the vehicle stands, by the directions (n - 1, 3) between them."""
    units = chords if scaled else chords / np.linalg.norm(chords, axis=1, keepdims=True)
    steep = np.abs(units[:, 2]) > math.sin(_STEEP_LEG_RAD)
    inner = [
        bool(points[i].stops or steep[i - 1] or steep[i] or units[i - 1] @ units[i] < math.cos(_ABOUT_RAD))
        for i in range(1, len(units))
    ]
    return [True, *inner, True]


def _direction(units: Float, lengths: Float, i: int) -> Float:
    """Of the path at point ``i``: the nearer neighbour counts more. At a highest or lowest point it is level."""
    mean = units[i - 1] * lengths[i] + units[i] * lengths[i - 1]
    if units[i - 1, 2] * units[i, 2] <= 0.0:
        mean[2] = 0.0
    direction: Float = mean / np.linalg.norm(mean)
    return direction


def _speeds(
    length_m: Float, direction: Float, curvature: Float, cruise: Float, stops: Int, limits: PathLimits
) -> Float:
    if not limits.hovers:
        return cruise
    envelope = limits.envelope
    rise = -direction[:, 2]
    climb = np.where(rise > 0.0, limits.climb_m_s / np.where(rise > 0.0, rise, 1.0), np.inf)
    turning = turning_speed_m_s(direction, curvature, envelope)
    least = np.minimum.reduce([cruise, turning, descent_speed_m_s(direction, envelope), climb])
    least[stops] = 0.0
    braked = allowed_ahead_m_s(length_m, least, envelope)
    # Accelerating is braking seen backwards.
    backwards = replace(envelope, braking_m_s2=envelope.acceleration_m_s2)
    risen = allowed_ahead_m_s(length_m[-1] - length_m[::-1], braked[::-1], backwards)[::-1]
    speed: Float = np.ascontiguousarray(risen)
    return speed


def _times(length_m: Float, speed: Float, arrivals: Int, stays_s: Sequence[float]) -> Float:
    mean = 0.5 * (speed[1:] + speed[:-1])
    steps_s = np.diff(length_m) / np.maximum(mean, _LEAST_SPEED_M_S)
    waited_s = np.zeros(len(length_m))
    for at, stay_s in zip(arrivals[:-1], stays_s[:-1], strict=True):
        # It has arrived before it stays: the time goes by on the way to the next sample.
        waited_s[at + 1 :] += stay_s
    time_s: Float = np.concatenate(((0.0,), np.cumsum(steps_s))) + waited_s
    return time_s
