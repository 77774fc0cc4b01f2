"""The vehicles that a scenario can name: what flies, what pilots it, and what it is called on the wire and in files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.local import LocalFrame
from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.scenario import VehicleSection
from simulator.vehicles.airframes import OSPREY, PING_WING
from simulator.vehicles.helicopter import Helicopter
from simulator.vehicles.multirotor import Multirotor
from simulator.vehicles.pilot import FlightMode
from simulator.vehicles.rmax_aircraft import RmaxAircraft
from simulator.vehicles.state import VehicleState
from simulator.vehicles.wing_aircraft import WingAircraft

AIRFRAMES = {"osprey": OSPREY, "ping_wing": PING_WING}


class Aircraft(Protocol):
    """What is flown by a velocity and a heading."""

    on_ground: bool

    def step(
        self, t_us: int, dt_s: float, vel_command_ned_m_s: Float, yaw_command_rad: float, floor_down_m: float = math.inf
    ) -> VehicleState:
        """Advance by ``dt_s`` to the time ``t_us``; nothing gets below ``floor_down_m``, where it stands."""
        ...


_NOT_ASKED_FOR = (FlightMode.STABILIZE, FlightMode.CIRCLE)


@dataclass(frozen=True, slots=True)
class VehicleKind:
    """A kind of vehicle for the others: ``mav_type``, ``type`` of flight.json, ArduPilot's numbers of its modes.

    One that cannot ``stand`` has nothing to stand on, and meets no ground.
    """

    said: str
    mav_type: int
    flight_type: Literal["helicopter", "multirotor", "fixed_wing"]
    modes: dict[FlightMode, int]
    stands: bool = True

    def mode(self, number: float) -> FlightMode | None:
        """The mode of one of its numbers that can be asked for, None for any other."""
        known = (mode for mode, own in self.modes.items() if own == number and mode not in _NOT_ASKED_FOR)
        return next(known, None)

    @property
    def hovers(self) -> bool:
        """Whether it can stand still in the air."""
        return FlightMode.LAND in self.modes


_COPTER_MODES = {mode: int(mode) for mode in FlightMode}
_PLANE_MODES = {
    FlightMode.STABILIZE: mavlink.PLANE_MODE_STABILIZE,
    FlightMode.AUTO: mavlink.PLANE_MODE_AUTO,
    FlightMode.GUIDED: mavlink.PLANE_MODE_GUIDED,
    FlightMode.LOITER: mavlink.PLANE_MODE_LOITER,
    FlightMode.RTL: mavlink.PLANE_MODE_RTL,
}

VEHICLES = {
    "helicopter": VehicleKind("helicopter", mavlink.MAV_TYPE_HELICOPTER, "helicopter", _COPTER_MODES),
    "multirotor": VehicleKind("multirotor", mavlink.MAV_TYPE_QUADROTOR, "multirotor", _COPTER_MODES),
    "fixed_wing": VehicleKind("fixed wing", mavlink.MAV_TYPE_FIXED_WING, "fixed_wing", _PLANE_MODES, stands=False),
    "rmax": VehicleKind("RMAX", mavlink.MAV_TYPE_HELICOPTER, "helicopter", _COPTER_MODES, stands=False),
}


def make_aircraft(
    section: VehicleSection, frame: LocalFrame, pos_ned_m: Float, yaw_rad: float, seed: int, wind_m_s: float,
    gust_std_m_s: float,
) -> Aircraft:  # fmt: skip
    """The aircraft of a scenario; the wind's direction comes from the seed and is the same for all kinds."""
    if section.type == "helicopter":
        return Helicopter(frame, pos_ned_m, yaw_rad, seed, wind_m_s, gust_std_m_s)
    towards_rad = rng_for(seed, "air").uniform(0, 2 * math.pi)
    wind = wind_m_s * np.array((math.cos(towards_rad), math.sin(towards_rad), 0.0))
    if section.type == "multirotor":
        return Multirotor(frame, pos_ned_m, yaw_rad, seed, wind, gust_std_m_s)
    if section.type == "rmax":
        return RmaxAircraft(frame, pos_ned_m, yaw_rad, seed, wind, gust_std_m_s)
    return WingAircraft(frame, pos_ned_m, yaw_rad, seed, wind, gust_std_m_s, AIRFRAMES[section.airframe])
