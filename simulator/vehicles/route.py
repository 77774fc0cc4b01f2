"""A closed, smooth route over varied ground, with places to hover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.types import Float
from simulator.errors import SimulatorError
from simulator.random_streams import rng_for
from simulator.world.terrain import Terrain

_STEP_M = 2.0
_MOST_ROUNDS = 400


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Points (n, 3) in the world's frame, about 2 m apart, the last followed by the first; ``hover_at`` are indices."""

    pos_ned_m: Float
    tangent_ne: Float
    curvature_per_m: Float
    hover_at: tuple[int, ...]

    @property
    def start_ned_m(self) -> Float:
        """Where it begins and ends, (3,)."""
        start: Float = self.pos_ned_m[0]
        return start


def make_route(
    seed: int,
    terrain: Terrain,
    half_size_m: float,
    waypoints: int,
    height_agl_m: tuple[float, float],
    hover_stops: int,
) -> Route:
    """A loop of which the camera never sees past the world's edge; one wide turn and one narrow."""
    rng = rng_for(seed, "route")
    # Two turns, a wide one and a narrow one inside: no leg doubles back on the one before.
    wide = max(3, round(0.6 * waypoints))
    turns = (wide, max(waypoints - wide, 1))
    angle = np.concatenate([np.arange(count) * 2 * np.pi / count for count in turns])
    angle = angle + rng.normal(0, 0.10, len(angle)) + rng.uniform(0, 2 * np.pi)
    # At the greatest height and tilt the picture reaches 0.95 of the height to the side.
    far = max(half_size_m - 0.95 * height_agl_m[1] - 40.0, 0.25 * half_size_m)
    radius = far * np.concatenate([rng.uniform(0.8, 1.0, turns[0]), rng.uniform(0.28, 0.55, turns[1])])
    north, east = radius * np.cos(angle), radius * np.sin(angle)
    height = terrain.at(north, east) + rng.uniform(*height_agl_m, len(angle))
    nodes = np.stack([north, east, -height], axis=1)
    points = _resampled(_rounded(_resampled(_closed_spline(nodes))))
    stops = np.linspace(0, len(points), hover_stops, endpoint=False).astype(int) + len(points) // 7
    return _route(points, tuple(int(stop) % len(points) for stop in stops))


def widened(route: Route, radius_m: float) -> Route:
    """The route smoothed until no bend is narrower than ``radius_m``, for what cannot turn as a helicopter does.

    Raises
    ------
    SimulatorError
        It is too short for such bends.
    """
    wider = route
    for _ in range(_MOST_ROUNDS):
        if float(wider.curvature_per_m.max()) * radius_m <= 1.0:
            return wider
        points = _resampled(_rounded(wider.pos_ned_m))
        share = len(points) / len(wider.pos_ned_m)
        wider = _route(points, tuple(int(stop * share) % len(points) for stop in wider.hover_at))
        if len(points) * _STEP_M < 2.0 * np.pi * radius_m:
            break
    message = (
        f"no route in this world has bends of {radius_m:.0f} m: set world.half_size_m higher or name another vehicle"
    )
    raise SimulatorError(message)


def pad_route(seed: int, pad_ned_m: Float, height_m: float, away_m: float, circle_m: float) -> Route:
    """A circle that sinks from 6 m more to ``height_m`` over the pad, and waits there, ``away_m`` beside it."""
    rng = rng_for(seed, "route")
    beside, inward = rng.uniform(0, 2 * np.pi, 2)
    stop = pad_ned_m[:2] + away_m * np.array([np.cos(beside), np.sin(beside)])
    count = max(12, round(2 * np.pi * circle_m / _STEP_M))
    # Begun opposite to where it waits.
    turn = 2 * np.pi * np.arange(count) / count
    out = inward + np.pi - turn
    middle = stop + circle_m * np.array([np.cos(inward), np.sin(inward)])
    place = middle - circle_m * np.stack([np.cos(out), np.sin(out)], axis=1)
    down = pad_ned_m[2] - height_m - 3.0 * (1 + np.cos(turn))
    tangent = -np.stack([np.sin(out), -np.cos(out)], axis=1)
    return Route(
        np.column_stack((place, down)), tangent, np.full(count, 1.0 / circle_m), (int(np.argmin(np.abs(turn - np.pi))),)
    )


def _route(points: Float, hover_at: tuple[int, ...]) -> Route:
    """Directions and curvatures of a closed line of points (n, 3)."""
    ahead, behind = np.roll(points, -1, axis=0), np.roll(points, 1, axis=0)
    tangent = (ahead - behind)[:, :2]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bend = np.linalg.norm(np.roll(tangent, -3, axis=0) - np.roll(tangent, 3, axis=0), axis=1) / (6 * _STEP_M)
    return Route(points, tangent, bend, hover_at)


def _closed_spline(nodes: Float) -> Float:
    """Centripetal Catmull-Rom through all nodes, closed."""
    pieces = []
    count = len(nodes)
    for index in range(count):
        p = [nodes[(index + k) % count] for k in (-1, 0, 1, 2)]
        knots = np.concatenate([[0.0], np.cumsum([np.sqrt(np.linalg.norm(p[k + 1] - p[k])) for k in range(3)])])
        t = np.linspace(knots[1], knots[2], 200, endpoint=False)[:, None]
        a = [_blend(t, knots[k], knots[k + 1], p[k], p[k + 1]) for k in range(3)]
        b = [_blend(t, knots[k], knots[k + 2], a[k], a[k + 1]) for k in range(2)]
        pieces.append(_blend(t, knots[1], knots[2], b[0], b[1]))
    return np.vstack(pieces)


def _blend(t: Float, start: float, stop: float, first: Float, second: Float) -> Float:
    blended: Float = ((stop - t) * first + (t - start) * second) / (stop - start)
    return blended


def _rounded(points: Float) -> Float:
    """Weighted mean over 80 m of the loop: takes the hairpins out of it."""
    window = np.hanning(41)[1:-1]
    window /= window.sum()
    shifts = range(-(len(window) // 2), len(window) // 2 + 1)
    mean: Float = np.zeros_like(points)
    for weight, shift in zip(window, shifts, strict=True):
        mean = mean + weight * np.roll(points, shift, axis=0)
    return mean


def _resampled(points: Float) -> Float:
    closed = np.vstack([points, points[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0, length[-1], int(length[-1] / _STEP_M), endpoint=False)
    return np.stack([np.interp(at, length, closed[:, axis]) for axis in range(3)], axis=1)
