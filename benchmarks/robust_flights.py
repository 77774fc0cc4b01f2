"""Flights of the simulated Osprey under two robust-inversion laws, for ``benchmarks.robust_control``.

One law has pitch rate and speed, the other roll and yaw rate, as in chapter 3 of Kaiser's thesis (2008). Above them a
proportional loop holds pitch and roll, so that an aeroplane in gusts stays where its models hold: the commanded rates
are its outputs. The commands are steps of roll (25 degrees to either side), pitch (4 degrees) and airspeed (2 m/s),
some of each in 20 s, with a rate of yaw for a coordinated turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q
from estimator.types import Float
from guidance.linear_plant import (
    OSPREY_LATERAL,
    OSPREY_LONGITUDINAL,
    PUBLISHED_REFERENCE,
)
from guidance.robust_inversion import RobustInversion, RobustInversionConfig, as_published, baseline
from simulator.random_streams import rng_for
from simulator.vehicles.airframes import OSPREY, Airframe
from simulator.vehicles.fixed_wing import Controls, FixedWing
from simulator.vehicles.state import VehicleState

DT_S, FLIGHT_S = 0.01, 20.0
CHANNELS = ("q", "V", "p", "r")
_FRAME = LocalFrame(math.radians(58.49), math.radians(15.1), 60.0)
_ATTITUDE_PER_S = 1.2
_ROLL_MAX_RAD, _PITCH_MAX_RAD = math.radians(25.0), math.radians(4.0)
_FASTER_M_S = 2.0
# Table 3-1 and (3-11): noise within these bounds; H, U_ds.
_RATE_NOISE_RAD_S, _SPEED_NOISE_M_S = math.radians(1.7), 0.4
_GUST_LENGTH_M, _GUST_M_S = 15.24, 10.12
_FRAME_STEPS, _FILTER_RAD_S, _FOCAL_PX = 3, 4.0, 1333.0
_HEIGHT_M = 60.0


@dataclass(frozen=True, slots=True)
class Condition:
    """What a flight meets.

    ``gust_std_m_s`` of gusts that wander, ``discrete`` for two gusts of (3-11), one from below and one from the side;
    ``parameter_error`` is the share by which each derivative of the aeroplane is off what the law was made for, at
    most; ``sensors`` adds the noise of table 3-1, ``camera`` takes attitude and speed from pictures (section 4.2.4).
    """

    name: str
    gust_std_m_s: float = 0.0
    discrete: bool = False
    parameter_error: float = 0.0
    sensors: bool = False
    camera: bool = False


@dataclass(frozen=True, slots=True)
class Law:
    """Configurations of the two loops."""

    longitudinal: RobustInversionConfig
    lateral: RobustInversionConfig


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Errors (n, 4) of q, V, p, r from the reference model, rad/s and m/s.

    ``activity_rad_s`` is the root mean square rate of the surfaces; ``held`` is whether it never rolled over.
    """

    error: Float
    activity_rad_s: float
    held: bool


def _law(change: Callable[[RobustInversionConfig], RobustInversionConfig]) -> Law:
    return Law(change(_LONGITUDINAL), change(_LATERAL))


_LONGITUDINAL = RobustInversionConfig(
    input_estimate=OSPREY_LONGITUDINAL.input_matrix,
    feedback_per_s=np.array((10.0, 1.0)),
    alpha_per_s=np.array((8.0, 1.5)),
    robust=np.array((8.0, 2.0)),
    boundary=np.array((0.5, 1.0)),
    input_min=np.array((-OSPREY.surface_max_rad, -31.0)),
    input_max=np.array((OSPREY.surface_max_rad, 160.0)),
    model=OSPREY_LONGITUDINAL,
)
_LATERAL = RobustInversionConfig(
    input_estimate=OSPREY_LATERAL.input_matrix,
    feedback_per_s=np.array((10.0, 6.0)),
    alpha_per_s=np.array((8.0, 5.0)),
    robust=np.array((8.0, 4.0)),
    boundary=np.array((0.5, 0.5)),
    input_min=np.full(2, -OSPREY.surface_max_rad),
    input_max=np.full(2, OSPREY.surface_max_rad),
    model=OSPREY_LATERAL,
)

BASELINE, PUBLISHED, NO_SIGN, ROBUST = "inversion", "(3-26)", "robust, no sign", "robust"
PROPORTIONAL = "(3-26), no sign"
LAWS = {
    BASELINE: _law(baseline),
    PROPORTIONAL: _law(lambda one: replace(as_published(one), robust=np.zeros(2))),
    PUBLISHED: _law(as_published),
    NO_SIGN: _law(lambda one: replace(one, robust=np.zeros(2))),
    ROBUST: _law(lambda one: one),
}
CONDITIONS = (
    Condition("calm"),
    Condition("gusts", 1.5, True),
    Condition("parameters", parameter_error=0.4),
    Condition("gusts, parameters", 1.5, True, 0.4),
    Condition("gusts, parameters, sensors", 1.5, True, 0.4, sensors=True),
    Condition("gusts, parameters, camera", 1.5, True, 0.4, sensors=True, camera=True),
)


def wrong(airframe: Airframe, seed: int, most: float) -> Airframe:
    """An airframe of which each derivative is off by a share of up to ``most``; lift and drag in trim stay."""
    rng = rng_for(seed, "airframe")

    def off(values: tuple[float, ...], kept: int = 0) -> list[float]:
        share = 1.0 + rng.uniform(-most, most, len(values))
        share[:kept] = 1.0
        return [one * float(by) for one, by in zip(values, share, strict=True)]

    lift_0, lift_a, lift_q, lift_e = off(airframe.lift_m_s2, 1)
    drag_0, drag_1, drag_2 = off(airframe.drag_m_s2, 1)
    pitch_a, pitch_q, pitch_e = off(airframe.pitch_rad_s2)

    def sideways(values: tuple[float, ...]) -> tuple[float, float, float, float, float]:
        beta, roll, yaw, aileron, rudder = off(values)
        return beta, roll, yaw, aileron, rudder

    return replace(
        airframe, lift_m_s2=(lift_0, lift_a, lift_q, lift_e), drag_m_s2=(drag_0, drag_1, drag_2),
        side_m_s2=sideways(airframe.side_m_s2), roll_rad_s2=sideways(airframe.roll_rad_s2),
        pitch_rad_s2=(pitch_a, pitch_q, pitch_e), yaw_rad_s2=sideways(airframe.yaw_rad_s2),
        mass_kg=airframe.mass_kg / off((1.0,))[0],
    )  # fmt: skip


def discrete_gust_m_s(since_s: float, airspeed_m_s: float) -> float:
    """(3-11) without the derivatives it is multiplied by: U_ds / 2 (1 - cos(pi s / H)) over 2 H of way."""
    way_m = since_s * airspeed_m_s
    if not 0.0 <= way_m <= 2.0 * _GUST_LENGTH_M:
        return 0.0
    return 0.5 * _GUST_M_S * (1.0 - math.cos(math.pi * way_m / _GUST_LENGTH_M))


@dataclass(slots=True)
class Seen:
    """What the control is told: forward speed, alpha, beta, rates (3,), roll, pitch.

    The speed is the body's own along x, over ground in still air and in gusts, as a camera has it and as V of (2-13).
    """

    speed_m_s: float
    alpha_rad: float
    beta_rad: float
    rate_rad_s: Float
    roll_rad: float
    pitch_rad: float


class Sensors:
    """Errors of what is measured: rates by gyroscopes, flow angles by vanes, speed and attitude by them or by pictures.

    Pictures: 30 a second (33 here, every third step), whose corners are rounded to pixels of a 10 mm lens on 480 lines
    (a third of an inch, assumed: 1333 pixels), from 60 m; height and so speed 5 % wrong, to either side; attitude and
    speed through filters of 4 rad/s. A rounded pixel errs by 0.29, and four points determine the pose: noise of a pose
    is taken to be that of one point.
    """

    def __init__(self, seed: int, condition: Condition) -> None:
        self._rng = rng_for(seed, "sensors")
        self._condition = condition
        self._scale = 1.0 + 0.05 * (1.0 if self._rng.random() < 0.5 else -1.0) if condition.camera else 1.0
        self._shake_rad = 0.29 / _FOCAL_PX
        self._steps = 0
        self._moved_m = 0.0
        self._picture: Float | None = None
        self._filtered: Float | None = None

    def of(self, true: Seen) -> Seen:
        """What is told of the truth, one step after the last."""
        if not self._condition.sensors:
            return true
        noise = self._rng.uniform(-1.0, 1.0, 6)
        angle_rad = _RATE_NOISE_RAD_S * noise[:2]
        seen = Seen(
            true.speed_m_s + _SPEED_NOISE_M_S * float(noise[5]), true.alpha_rad + float(angle_rad[0]),
            true.beta_rad + float(angle_rad[1]), true.rate_rad_s + _RATE_NOISE_RAD_S * noise[2:5],
            true.roll_rad, true.pitch_rad,
        )  # fmt: skip
        if self._condition.camera:
            seen.speed_m_s, seen.roll_rad, seen.pitch_rad = self._from_pictures(true).tolist()
        return seen

    def _from_pictures(self, true: Seen) -> Float:
        """Speed, roll and pitch, held between pictures and filtered."""
        if self._steps % _FRAME_STEPS == 0 or self._picture is None:
            shake = self._shake_rad * self._rng.standard_normal(3)
            moved_m, self._moved_m = _HEIGHT_M * float(shake[0]) - self._moved_m, _HEIGHT_M * float(shake[0])
            speed_m_s = self._scale * (true.speed_m_s + moved_m / (_FRAME_STEPS * DT_S))
            self._picture = np.array((speed_m_s, true.roll_rad + shake[1], true.pitch_rad + shake[2]))
        self._steps += 1
        before = self._picture if self._filtered is None else self._filtered
        self._filtered = before + (1.0 - math.exp(-DT_S * _FILTER_RAD_S)) * (self._picture - before)
        return self._filtered


def fly(condition: Condition, law: Law, seed: int) -> Flight:
    """One flight; the same seed meets every law with the same air, aeroplane and noise."""
    airframe = wrong(OSPREY, seed, condition.parameter_error)
    aircraft = FixedWing(
        _FRAME, np.array((0.0, 0.0, -_HEIGHT_M)), 0.0, seed, np.zeros(3), condition.gust_std_m_s, airframe
    )
    along = RobustInversion(law.longitudinal, PUBLISHED_REFERENCE)
    across = RobustInversion(law.lateral, PUBLISHED_REFERENCE)
    sensors, plan = Sensors(seed, condition), _Plan(seed)
    nominal = FixedWing(_FRAME, np.zeros(3), 0.0, seed, np.zeros(3), 0.0).trim
    true = Seen(nominal.airspeed_m_s, nominal.alpha_rad, 0.0, np.zeros(3), 0.0, nominal.pitch_rad)
    errors, surfaces = [], []
    for step in range(1, round(FLIGHT_S / DT_S) + 1):
        t_s = step * DT_S
        told, (roll_rad, pitch_rad, faster_m_s) = sensors.of(true), plan.at(t_s)
        p, q, r = told.rate_rad_s.tolist()
        speed_m_s = told.speed_m_s - nominal.airspeed_m_s
        turn_rad_s = 9.81 / nominal.airspeed_m_s * math.sin(told.roll_rad)
        pitch_rate = _ATTITUDE_PER_S * (pitch_rad - told.pitch_rad) + turn_rad_s * math.sin(told.roll_rad)
        roll_rate = _ATTITUDE_PER_S * (roll_rad - told.roll_rad)
        elevator, thrust = along.step(
            DT_S, np.array((pitch_rate, faster_m_s)), np.array((q, speed_m_s)),
            np.array((speed_m_s, told.alpha_rad, q, told.pitch_rad)),
        ).tolist()  # fmt: skip
        aileron, rudder = across.step(
            DT_S, np.array((roll_rate, turn_rad_s * math.cos(told.roll_rad))), np.array((p, r)),
            np.array((told.beta_rad, p, r, told.roll_rad)),
        ).tolist()  # fmt: skip
        command = Controls(
            aileron, elevator + nominal.controls.elevator_rad, rudder, thrust + nominal.controls.thrust_n
        )
        state = aircraft.step(step * 10_000, DT_S, command, plan.gust_ned_m_s(t_s, state_q=aircraft.motion[6:10])
                              if condition.discrete else None)  # fmt: skip
        true = _truth(state, aircraft.motion)
        reference = (along.reference.output, across.reference.output)
        errors.append((
            true.rate_rad_s[1] - reference[0][0], true.speed_m_s - nominal.airspeed_m_s - reference[0][1],
            true.rate_rad_s[0] - reference[1][0], true.rate_rad_s[2] - reference[1][1],
        ))  # fmt: skip
        at = aircraft.controls
        surfaces.append((at.aileron_rad, at.elevator_rad, at.rudder_rad))
        if not math.isfinite(true.speed_m_s) or abs(true.roll_rad) > math.radians(120.0):
            return Flight(np.array(errors), math.nan, held=False)
    activity = float(np.sqrt(np.mean((np.diff(np.array(surfaces), axis=0) / DT_S) ** 2)))
    return Flight(np.array(errors), activity, held=True)


class _Plan:
    """Steps of attitude and speed, and when the two discrete gusts come, of a seed."""

    def __init__(self, seed: int) -> None:
        rng = rng_for(seed, "plan")
        self._shift_s = float(rng.uniform(0.0, 1.0))
        self._side = float(np.sign(rng.uniform(-1.0, 1.0)))
        self._gusts_s = (float(rng.uniform(4.0, 10.0)), float(rng.uniform(13.0, 20.0)))
        self._from = np.sign(rng.uniform(-1.0, 1.0, 2))

    def at(self, t_s: float) -> tuple[float, float, float]:
        """Roll, pitch, and how much faster than trim."""
        t_s -= self._shift_s
        roll = self._side * (0.0, 1.0, 1.0, -1.0, -1.0, 0.0, 1.0, 0.0)[min(int(max(t_s, 0.0) / 3.0), 7)]
        pitch = (0.0, 1.0, 0.0, -1.0, 0.0, 1.0)[min(int(max(t_s, 0.0) / 4.0), 5)]
        faster = (0.0, 1.0, 0.0, -1.0)[min(int(max(t_s, 0.0) / 6.0), 3)]
        return roll * _ROLL_MAX_RAD, pitch * _PITCH_MAX_RAD, faster * _FASTER_M_S

    def gust_ned_m_s(self, t_s: float, state_q: Float) -> Float:
        """The discrete gusts, along and across the wings as they are."""
        below, aside = (discrete_gust_m_s(t_s - at_s, OSPREY.airspeed_m_s) for at_s in self._gusts_s)
        body = np.array((0.0, self._from[1] * aside, self._from[0] * below))
        gust: Float = matrix_from_q(state_q) @ body
        return gust


def _truth(state: VehicleState, motion: Float) -> Seen:
    air = motion[3:6] - matrix_from_q(motion[6:10]).T @ state.wind_ned_m_s
    alpha_rad, beta_rad = math.atan2(air[2], air[0]), math.asin(float(air[1]) / float(np.linalg.norm(air)))
    return Seen(float(motion[3]), alpha_rad, beta_rad, motion[10:13], state.roll_rad, state.pitch_rad)
