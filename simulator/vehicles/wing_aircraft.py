"""An aeroplane under its own autopilot: flown by a velocity and a heading, as the other aircraft are.

It cannot stop and flies at its own airspeed. Of a commanded velocity it takes the direction over ground, to which it
turns by ``guidance.line_of_sight`` with a bank of 35 degrees at most, and the rate of climb, within what a small
pitch allows; the heading follows from them. A velocity of nothing is flown as a right turn. Loops of roll, pitch and
speed are proportional with the integrals that trim needs, their gains by the airframe's own derivatives.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.geometry.local import LocalFrame
from estimator.types import Float
from guidance.line_of_sight import acceleration_right_m_s2
from simulator.vehicles.airframes import Airframe
from simulator.vehicles.fixed_wing import Controls, FixedWing
from simulator.vehicles.state import VehicleState

BANK_MAX_RAD = math.radians(35.0)
LOOK_AHEAD_S = 2.2
_HOLD_BANK_RAD, _BANK_RATE_RAD_S = math.radians(20.0), math.radians(60.0)
_CLIMB_SHARE, _PITCH_MAX_RAD = 0.12, math.radians(12.0)
_ROLL_PER_S, _PITCH_SHARE, _PITCH_INTEGRAL_PER_S = 3.0, 0.7, 1.5
_CLIMB_GAIN, _CLIMB_INTEGRAL_PER_S = 0.5, 0.4
_SPEED_PER_S, _SPEED_INTEGRAL_PER_S2, _YAW_PER_S = 0.8, 0.15, 2.0
_INTEGRAL_MAX_RAD = math.radians(8.0)
_G_M_S2 = 9.81


def turn_radius_m(airframe: Airframe) -> float:
    """Of a circle in still air that leaves a quarter of the turn to the wind."""
    return 1.25 * airframe.airspeed_m_s**2 / (_G_M_S2 * math.tan(BANK_MAX_RAD))


class WingAircraft:
    """A fixed wing with its loops; it starts in trimmed flight and does not stand on the ground."""

    on_ground = False

    def __init__(
        self, frame: LocalFrame, pos_ned_m: Float, yaw_rad: float, seed: int, wind_ned_m_s: Float, gust_std_m_s: float,
        airframe: Airframe,
    ) -> None:  # fmt: skip
        self._wing = FixedWing(frame, pos_ned_m, yaw_rad, seed, wind_ned_m_s, gust_std_m_s, airframe)
        self._bank_rad = self._climb = self._pitch = self._thrust_m_s2 = 0.0
        self._state: VehicleState | None = None

    def step(
        self, t_us: int, dt_s: float, vel_command_ned_m_s: Float, yaw_command_rad: float,  # noqa: ARG002
        floor_down_m: float = math.inf,
    ) -> VehicleState:  # fmt: skip
        """Advance by ``dt_s`` to the time ``t_us``; a floor is not known to it and must be none.

        Raises
        ------
        ValueError
            ``dt_s`` is not above 0 and at most 20 ms, or there is a floor.
        """
        if floor_down_m != math.inf:
            message = "the aeroplane has no wheels to stand on"
            raise ValueError(message)
        controls = self._wing.trim.controls
        if self._state is not None:
            controls = self._controls(dt_s, vel_command_ned_m_s, self._state)
        self._state = self._wing.step(t_us, dt_s, controls)
        return self._state

    def _controls(self, dt_s: float, vel_command_ned_m_s: Float, state: VehicleState) -> Controls:
        """Deflections and thrust for a velocity."""
        airframe, trim = self._wing.airframe, self._wing.trim
        airspeed_m_s = float(np.linalg.norm(state.vel_ned_m_s - state.wind_ned_m_s))
        wanted_rad = _HOLD_BANK_RAD
        if float(np.hypot(*vel_command_ned_m_s[:2])) > 0.0:
            right = acceleration_right_m_s2(state.vel_ned_m_s[:2], vel_command_ned_m_s[:2], LOOK_AHEAD_S)
            wanted_rad = _bounded(math.atan(right / _G_M_S2), BANK_MAX_RAD)
        self._bank_rad += _bounded(wanted_rad - self._bank_rad, _BANK_RATE_RAD_S * dt_s)
        climb = _bounded(-float(vel_command_ned_m_s[2]) / airframe.airspeed_m_s, _CLIMB_SHARE)
        p, q, r = self._wing.motion[10:13].tolist()
        roll_rad, pitch_rad = state.roll_rad, state.pitch_rad
        return Controls(
            aileron_rad=self._aileron_rad(airframe, self._bank_rad - roll_rad, p),
            elevator_rad=trim.controls.elevator_rad + self._elevator_rad(dt_s, climb, q, state),
            rudder_rad=_rudder_rad(airframe, roll_rad, pitch_rad, r, airspeed_m_s),
            thrust_n=trim.controls.thrust_n + self._thrust_n(dt_s, climb, airframe.airspeed_m_s - airspeed_m_s),
        )

    @staticmethod
    def _aileron_rad(airframe: Airframe, lacking_rad: float, roll_rate_rad_s: float) -> float:
        """By what holds a roll rate against its damping, and as much again for what the rate lacks."""
        wanted_rad_s = _ROLL_PER_S * lacking_rad
        damping, aileron = -airframe.roll_rad_s2[1], airframe.roll_rad_s2[3]
        return damping * (2.0 * wanted_rad_s - roll_rate_rad_s) / aileron

    def _elevator_rad(self, dt_s: float, climb: float, pitch_rate_rad_s: float, state: VehicleState) -> float:
        """Beyond trim: holds a pitch that holds the climb, with the incidence and the pitch rate of a banked turn."""
        airframe, trim = self._wing.airframe, self._wing.trim
        stiffness, damping, elevator = -airframe.pitch_rad_s2[0], -airframe.pitch_rad_s2[1], airframe.pitch_rad_s2[2]
        lacking = climb + float(state.vel_ned_m_s[2]) / airframe.airspeed_m_s
        self._climb = _bounded(self._climb + _CLIMB_INTEGRAL_PER_S * lacking * dt_s, _INTEGRAL_MAX_RAD)
        bank_rad = _bounded(state.roll_rad, BANK_MAX_RAD + math.radians(10.0))
        more_rad = airframe.lift_m_s2[0] / airframe.lift_m_s2[1] * (1.0 / math.cos(bank_rad) - 1.0)
        wanted_rad = trim.pitch_rad + _bounded(climb + _CLIMB_GAIN * lacking + self._climb, _PITCH_MAX_RAD)
        error_rad = wanted_rad + more_rad * math.cos(bank_rad) - state.pitch_rad
        self._pitch = _bounded(self._pitch + _PITCH_INTEGRAL_PER_S * error_rad * dt_s, _INTEGRAL_MAX_RAD)
        turn_rad_s = _G_M_S2 / airframe.airspeed_m_s * math.tan(bank_rad) * math.sin(bank_rad)
        alpha_rad = _PITCH_SHARE * (error_rad + self._pitch) + more_rad
        rate_rad_s = 0.5 * (pitch_rate_rad_s - turn_rad_s) - turn_rad_s
        return (stiffness * alpha_rad - damping * rate_rad_s) / elevator

    def _thrust_n(self, dt_s: float, climb: float, lacking_m_s: float) -> float:
        """Beyond trim."""
        more = _SPEED_INTEGRAL_PER_S2 * lacking_m_s * dt_s
        self._thrust_m_s2 = _bounded(self._thrust_m_s2 + more, 0.2 * _G_M_S2)
        wanted_m_s2 = _SPEED_PER_S * lacking_m_s + self._thrust_m_s2 + _G_M_S2 * climb
        return self._wing.airframe.mass_kg * wanted_m_s2


def _rudder_rad(
    airframe: Airframe, roll_rad: float, pitch_rad: float, yaw_rate_rad_s: float, airspeed_m_s: float
) -> float:
    """Damps yaw about a coordinated turn, where there is a rudder."""
    if airframe.yaw_rad_s2[4] == 0.0:
        return 0.0
    turn_rad_s = _G_M_S2 / airspeed_m_s * math.sin(roll_rad) * math.cos(pitch_rad)
    return _YAW_PER_S * (turn_rad_s - yaw_rate_rad_s) / airframe.yaw_rad_s2[4]


def _bounded(value: float, most: float) -> float:
    return min(max(value, -most), most)
