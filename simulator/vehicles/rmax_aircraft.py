"""The RMAX under its own autopilot: flown by a velocity and a heading, as the other aircraft are.

The outer loop is the one of ``guidance.outer_loop`` (Conte 2009, (4.25)): the velocity that is wanted is integrated to
a place that is to be held, never further off than a few metres, so that its position terms take out wind and trim.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.geometry.local import LocalFrame
from estimator.types import Float
from guidance.outer_loop import FlightState, OuterLoop
from guidance.path_following import PathReference
from guidance.velocity_profile import SpeedPhase, TargetSpeed
from simulator.vehicles.rmax import Rmax, RmaxConfig, yacs_input
from simulator.vehicles.state import VehicleState

_LEASH_M = 2.0
_CONTROL_S = 0.02
_TRIM_STD_RAD = math.radians(0.5)


class RmaxAircraft:
    """An RMAX whose inputs are renewed at 50 Hz; it does not stand on the ground."""

    on_ground = False

    def __init__(
        self, frame: LocalFrame, pos_ned_m: Float, yaw_rad: float, seed: int, wind_ned_m_s: Float, gust_std_m_s: float
    ) -> None:
        config = RmaxConfig(trim_std_rad=_TRIM_STD_RAD)
        self._rmax = Rmax(frame, pos_ned_m, yaw_rad, seed, wind_ned_m_s, gust_std_m_s, config)
        self._outer = OuterLoop()
        self._place: Float = np.array(pos_ned_m, np.float64)
        self._state = FlightState(self._place, np.zeros(3), 0.0, 0.0, yaw_rad)
        self._input = yacs_input(0.0, 0.0, 0.0, 0.0)
        self._since_s = _CONTROL_S

    def step(
        self, t_us: int, dt_s: float, vel_command_ned_m_s: Float, yaw_command_rad: float,
        floor_down_m: float = math.inf,
    ) -> VehicleState:  # fmt: skip
        """Advance by ``dt_s`` to the time ``t_us``; a floor is not known to it and must be none.

        Raises
        ------
        ValueError
            ``dt_s`` is not above 0 and at most 0.1 s, or there is a floor.
        """
        if floor_down_m != math.inf:
            message = "the RMAX has no skids to stand on"
            raise ValueError(message)
        self._since_s += dt_s
        if self._since_s >= _CONTROL_S - 1e-9:
            self._control(self._since_s, vel_command_ned_m_s, yaw_command_rad)
            self._since_s = 0.0
        state = self._rmax.step(t_us, dt_s, self._input)
        self._state = FlightState(
            state.pos_ned_m, state.vel_ned_m_s, state.roll_rad, state.pitch_rad, state.yaw_rad
        )  # fmt: skip
        return state

    def _control(self, dt_s: float, vel_command_ned_m_s: Float, yaw_command_rad: float) -> None:
        off = self._place + vel_command_ned_m_s * dt_s - self._state.pos_ned_m
        far_m = float(np.linalg.norm(off))
        self._place = self._state.pos_ned_m + off * min(1.0, _LEASH_M / max(far_m, 1e-9))
        speed_m_s = float(np.linalg.norm(vel_command_ned_m_s))
        reference = PathReference(
            pos_ned_m=self._place, vel_ned_m_s=vel_command_ned_m_s, yaw_rad=yaw_command_rad, yaw_rate_rad_s=0.0,
            roll_rad=0.0, target=TargetSpeed(speed_m_s, speed_m_s, speed_m_s, SpeedPhase.CRUISE), segment=0,
            s=0.0, remaining_m=math.inf,
        )  # fmt: skip
        wanted = self._outer.step(dt_s, reference, self._state)
        self._input = yacs_input(wanted.roll_rad, wanted.pitch_rad, wanted.yaw_rate_rad_s, wanted.climb_m_s)
