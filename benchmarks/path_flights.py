"""Flights along paths with the simulated RMAX, and how far they were off: for ``benchmarks.path_following``.

The paths are those of table 4.1 of Conte's thesis (2009) as far as it describes them: complete turns to the right or
left, level, from 40 down to 10 m or back up, and straight lines of 170 m. Radii are not printed: 45 m here, at 10 m/s
a bank of 12.8 degrees of the 15 allowed. Each flight begins in a hover at the path's start and ends in one at its end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import wrap_pi
from estimator.types import Float
from guidance.outer_loop import FlightState, OuterLoop, OuterLoopConfig
from guidance.path import CubicSegment, as_path, helix, straight
from guidance.path_following import PathFollower, PathFollowingConfig
from simulator.random_streams import rng_for
from simulator.vehicles.gauss_markov import GaussMarkov
from simulator.vehicles.rmax import Rmax, RmaxConfig, yacs_input
from simulator.vehicles.state import VehicleState

DT_S = 0.02
RADIUS_M, QUICK_RADIUS_M = 45.0, 45.0
_RUN_IN_M, _RUN_OUT_M, _LINE_M, _BETWEEN_M = 60.0, 60.0, 170.0, 10.0
_LOW_M, _HIGH_M = 10.0, 40.0
_FRAME = LocalFrame(math.radians(58.49), math.radians(15.1), 60.0)
_LONGEST_S, _TRIM_STD_RAD = 300.0, math.radians(0.5)
_GUST_SHARE, _CALM_GUST_M_S = 0.25, 0.1
_ARRIVED_M, _STILL_M_S = 1.0, 0.3
_SPACING_M, _WINDOW_M = 0.05, 10.0


@dataclass(frozen=True, slots=True)
class NavigationErrors:
    """What the control is told wrong; standard deviations of errors that wander, and of noise from step to step.

    Of INS and RTK GPS, which the thesis calls sub-metre (section 5.9) and of centimetres (chapter 6, results): a
    decimetre. The attitude sensor is good to about 2 degrees (there), taken for two sigma. The rest is assumed.
    """

    position_m: float = 0.10
    height_m: float = 0.15
    position_time_s: float = 30.0
    velocity_m_s: float = 0.06
    velocity_time_s: float = 2.0
    attitude_rad: float = math.radians(1.0)
    attitude_noise_rad: float = math.radians(0.2)
    heading_rad: float = math.radians(1.0)


class Navigation:
    """The state as an INS with GPS would say it, from the true one."""

    def __init__(self, seed: int, errors: NavigationErrors) -> None:
        self._errors = errors
        self._position = GaussMarkov(rng_for(seed, "ins", "position"), 1.0, errors.position_time_s, 3)
        self._velocity = GaussMarkov(rng_for(seed, "ins", "velocity"), errors.velocity_m_s, errors.velocity_time_s, 3)
        self._noise = rng_for(seed, "ins", "attitude")
        self._tilt_rad = errors.attitude_rad * self._noise.standard_normal(2)
        self._yaw_rad = errors.heading_rad * float(self._noise.standard_normal())

    def of(self, state: VehicleState, dt_s: float) -> FlightState:
        """What is known of a state ``dt_s`` after the last."""
        e = self._errors
        roll, pitch, yaw = (e.attitude_noise_rad * self._noise.standard_normal(3)).tolist()
        return FlightState(
            state.pos_ned_m + self._position.step(dt_s) * (e.position_m, e.position_m, e.height_m),
            state.vel_ned_m_s + self._velocity.step(dt_s),
            state.roll_rad + float(self._tilt_rad[0]) + roll,
            state.pitch_rad + float(self._tilt_rad[1]) + pitch,
            wrap_pi(state.yaw_rad + self._yaw_rad + yaw),
        )


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """A row of the table: its path, the speed to cruise at and the wind's mean."""

    name: str
    cruise_m_s: float
    wind_m_s: float
    curves: tuple[CubicSegment, ...]


@dataclass(frozen=True, slots=True)
class Control:
    """How a flight is controlled."""

    following: PathFollowingConfig
    outer: OuterLoopConfig


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Errors are distances from the path (n,), every 20 ms: of the true position, and of the one that was navigated by.

    ``level_error_m`` (n,) is the true one seen from above, against the path seen from above.
    ``track_ned_m`` (n, 3) is the true one, ``speed_m_s`` (n,) over ground, ``path_ned_m`` (m, 3) the path.
    """

    error_m: Float
    seen_error_m: Float
    level_error_m: Float
    track_ned_m: Float
    speed_m_s: Float
    path_ned_m: Float
    arrived: bool


def turn(climb_m: float, right: bool) -> tuple[CubicSegment, ...]:
    """A run-in, a complete turn that climbs, a run-out."""
    down = -(_HIGH_M if climb_m < 0.0 else _LOW_M)
    begin = np.array((_RUN_IN_M, 0.0, down))
    turned = helix(begin, 0.0, RADIUS_M, 2.0 * math.pi if right else -2.0 * math.pi, climb_m, 8)
    climb_share = climb_m / (2.0 * math.pi * RADIUS_M)
    after = turned[-1].end_ned_m
    first = straight((0.0, 0.0, down + climb_share * _RUN_IN_M), begin)
    last = straight(after, after + np.array((_RUN_OUT_M, 0.0, -climb_share * _RUN_OUT_M)))
    return (first, *turned, last)


def line() -> tuple[CubicSegment, ...]:
    """A level straight line of 170 m."""
    return (straight((0.0, 0.0, -_HIGH_M), (_LINE_M, 0.0, -_HIGH_M)),)


def quick_bends() -> tuple[CubicSegment, ...]:
    """Eighth and quarter turns to either side with a second of straight flight between, for figure 4.12.

    Its path is drawn there without numbers. The curvature jumps at each joint; turns that followed each other at once
    would ask for more roll than the inputs' limits leave, with any law.
    """
    curves = [straight((0.0, 0.0, -_HIGH_M), (100.0, 0.0, -_HIGH_M))]
    heading = 0.0
    for angle in (-0.25, 0.5, -0.5, 0.5, -0.25):
        turned = angle * math.pi
        curves += helix(curves[-1].end_ned_m, heading, QUICK_RADIUS_M, turned, 0.0, 2)
        heading += turned
        end = curves[-1].end_ned_m
        on = np.array((math.cos(heading), math.sin(heading), 0.0))
        curves.append(straight(end, end + _BETWEEN_M * on))
    end = curves[-1].end_ned_m
    return (*curves, straight(end, end + _RUN_OUT_M * on))


def fly(manoeuvre: Manoeuvre, control: Control, seed: int, errors: NavigationErrors | None = None) -> Flight:
    """Fly it once; the wind's direction, gusts, trim and the errors of navigation come from the seed."""
    direction = rng_for(seed, "air", "direction").uniform(0.0, 2.0 * math.pi)
    wind = manoeuvre.wind_m_s * np.array((math.cos(direction), math.sin(direction), 0.0))
    gusts_m_s = max(_GUST_SHARE * manoeuvre.wind_m_s, _CALM_GUST_M_S)
    follower, loop = PathFollower(control.following), OuterLoop(control.outer)
    segments = as_path(manoeuvre.curves, manoeuvre.cruise_m_s)
    for segment in segments:
        follower.add(segment)
    start = segments[0].curve
    tangent = start.start_tangent_ned_m
    vehicle = Rmax(
        _FRAME, start.start_ned_m, math.atan2(tangent[1], tangent[0]), seed, wind, gusts_m_s,
        RmaxConfig(trim_std_rad=_TRIM_STD_RAD),
    )  # fmt: skip
    navigation = Navigation(seed, errors or NavigationErrors())
    state = vehicle.step(0, DT_S, yacs_input(0.0, 0.0, 0.0, 0.0))
    true, seen, speed = [], [], []
    arrived = False
    for k in range(1, round(_LONGEST_S / DT_S)):
        known = navigation.of(state, DT_S)
        reference = follower.step(DT_S, known.pos_ned_m, known.vel_ned_m_s, known.yaw_rad)
        command = loop.step(DT_S, reference, known)
        true.append(state.pos_ned_m)
        seen.append(known.pos_ned_m)
        speed.append(float(np.linalg.norm(state.vel_ned_m_s)))
        arrived = reference.remaining_m < _ARRIVED_M and speed[-1] < _STILL_M_S
        if arrived:
            break
        state = vehicle.step(
            round(k * DT_S * 1e6), DT_S,
            yacs_input(command.roll_rad, command.pitch_rad, command.yaw_rate_rad_s, command.climb_m_s),
        )  # fmt: skip
    path, track = dense(manoeuvre.curves), np.array(true)
    return Flight(
        error_m=distances_m(path, track),
        seen_error_m=distances_m(path, np.array(seen)),
        level_error_m=distances_m(path[:, :2], track[:, :2]),
        track_ned_m=track,
        speed_m_s=np.array(speed),
        path_ned_m=path,
        arrived=arrived,
    )


def dense(curves: Sequence[CubicSegment]) -> Float:
    """Points (n, 3) of a path, 5 cm apart."""
    pieces = [curve.point(np.linspace(0.0, 1.0, math.ceil(curve.length_m / _SPACING_M) + 1)) for curve in curves]
    return np.concatenate(pieces)


def distances_m(path_ned_m: Float, track_ned_m: Float) -> Float:
    """Distance (n,) of each position (n, 2 or 3), in order, from the points of a path (m, 2 or 3).

    Nearest within 10 m of path around where the last was nearest: a path that crosses itself is not to flatter. It
    shares nothing with the control point of the follower.
    """
    window, at, found = round(_WINDOW_M / _SPACING_M), 0, np.empty(len(track_ned_m))
    for k, place in enumerate(track_ned_m):
        low = max(at - window, 0)
        off = np.linalg.norm(path_ned_m[low : at + window + 1] - place, axis=1)
        best = int(np.argmin(off))
        at, found[k] = low + best, off[best]
    return found
