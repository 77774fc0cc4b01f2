"""The landings that the station flies: who may begin one, what goes to the vehicle, and what the operator is told."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from backend.clock import mono_us, unix_us
from backend.errors import CommandRefusedError, ConflictError, StationError
from backend.fleet.commands import take_over
from backend.fleet.links import LinkEndpoint
from backend.fleet.vehicle import LiveVehicle
from backend.landing.descent import MODE_WORDS, Descent, Moving, Order, Orders
from backend.landing.messages import worst_std
from backend.link.events import VehicleType
from backend.link.landing_target import velocity_set_point
from backend.schemas.vehicles import CommandBody
from estimator.types import NavigationState
from guidance.landing import LandingConfig, LandingPhase

HOVERS = (VehicleType.MULTIROTOR, VehicleType.HELICOPTER)
STEERS = frozenset({"disarm", "takeoff", "goto", "orbit", "hold", "return", "land", "start_mission"})
COMMANDS: dict[Order, Literal["hold", "land"]] = {Order.HOLD: "hold", Order.LAND: "land"}
FAREWELL_S = 3.0


@dataclass(frozen=True, slots=True)
class Wires:
    """What the pilot speaks through: a vehicle's link, a command to it, and words to the operator (code, text)."""

    link_of: Callable[[LiveVehicle], LinkEndpoint | None]
    command: Callable[[LiveVehicle, CommandBody], str]
    tell: Callable[[LiveVehicle, str, str], None]


class LandingPilot:
    """At most one landing of each vehicle. Lives on the event loop."""

    def __init__(self, wires: Wires, config: LandingConfig) -> None:
        self._wires = wires
        self._config = config
        self._descents: dict[str, Descent] = {}
        self._told: dict[str, LandingPhase] = {}

    def begin(self, vehicle: LiveVehicle, page: str) -> None:
        """Land a vehicle for an operator's page; the errors say why that cannot be."""
        before = self._descents.get(vehicle.id)
        if before is not None and before.active and before.phase is not LandingPhase.HOLD:
            raise ConflictError(f"vehicle '{vehicle.id}' is landing already: abort that first")
        link = self._wires.link_of(vehicle)
        if link is None or not vehicle.connected:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' is not connected")
        if vehicle.autopilot not in MODE_WORDS or vehicle.vehicle_type not in HOVERS:
            raise CommandRefusedError(
                f"vehicle '{vehicle.id}' ({vehicle.vehicle_type}, autopilot {vehicle.autopilot}) cannot be landed by "
                "the station: that takes a helicopter or multirotor with ArduPilot or PX4"
            )
        if not vehicle.telemetry.armed:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' is not armed: it stands")
        pad = None if vehicle.latest is None else vehicle.latest.state.pad
        if pad is None or not pad.mode.known:
            why = f": {pad.reason}" if pad is not None and pad.reason else ""
            raise CommandRefusedError(f"the pad must be followed when a landing begins{why}")
        config, stands = self._config_for(vehicle), before if before is not None and before.active else None
        self._descents[vehicle.id] = Descent(vehicle.autopilot, page, unix_us(), config, stands)
        self._told.pop(vehicle.id, None)

    def _config_for(self, vehicle: LiveVehicle) -> LandingConfig:
        """The guidance counts how old the last picture is; the newest is as old as the estimator is behind."""
        behind_s = 0.0 if vehicle.worker is None else vehicle.worker.delay_us / 1e6
        return replace(
            self._config, hold_after_s=self._config.hold_after_s + behind_s,
            lost_after_s=self._config.lost_after_s + behind_s,
        )  # fmt: skip

    def abort(self, vehicle: LiveVehicle) -> None:
        """End a vehicle's landing on the operator's word, or where that is ended its standing; else nothing happens."""
        descent = self._descents.get(vehicle.id)
        if descent is not None and descent.active:
            self._send(vehicle, descent, descent.abort("the operator ended it"))

    def overrule(self, vehicle: LiveVehicle, command: str) -> None:
        """The operator tells a vehicle something else: the landing ends without another word to it."""
        descent = self._descents.get(vehicle.id)
        if descent is not None and descent.active and command in STEERS:
            descent.yield_to(f"the operator said '{command}'")
            self._tell_end(vehicle, descent)

    def on_state(self, vehicle: LiveVehicle, state: NavigationState) -> None:
        """A vehicle's new state."""
        descent = self._descents.get(vehicle.id)
        if descent is not None and descent.active:
            moving = Moving(state.vel_ned_m_s, worst_std(state.cov_vel_ned_m2_s2))
            self._send(vehicle, descent, descent.on_state(state.t_us, state.pad, moving, vehicle.telemetry))

    def tick(self, vehicle: LiveVehicle, page_is_there: Callable[[str, int], bool]) -> None:
        """Ten times a second."""
        descent = self._descents.get(vehicle.id)
        if descent is not None and descent.active:
            there = page_is_there(descent.page, mono_us())
            orders = descent.tick(unix_us(), vehicle.telemetry, page_there=there, connected=vehicle.connected)
            self._send(vehicle, descent, orders)

    async def close(self, vehicles: Callable[[], dict[str, LiveVehicle]]) -> None:
        """The station stops: end every landing, and wait a moment for the vehicles to have heard it."""
        left: list[tuple[LiveVehicle, str]] = []
        for vehicle in vehicles().values():
            descent = self._descents.get(vehicle.id)
            if descent is not None and descent.active:
                self._send(vehicle, descent, descent.stop("the station stops"))
                left.append((vehicle, descent.wanted_mode))
        ends_us = mono_us() + int(FAREWELL_S * 1e6)
        while mono_us() < ends_us and any(v.connected and v.telemetry.flight_mode == mode for v, mode in left):
            await asyncio.sleep(0.05)

    def message(self, vehicle: LiveVehicle) -> dict[str, Any] | None:
        """What is told of a vehicle's landing, None where there was none."""
        descent = self._descents.get(vehicle.id)
        if descent is None:
            return None
        point = descent.set_point_ned_m_s
        return {
            "active": descent.active, "phase": str(descent.phase), "reason": descent.reason,
            "set_point_ned_m_s": None if point is None else tuple(float(value) for value in point),
        }  # fmt: skip

    def _send(self, vehicle: LiveVehicle, descent: Descent, orders: Orders) -> None:
        link = self._wires.link_of(vehicle)
        if link is not None:
            if orders.vel_ned_m_s is not None:
                component_id = link.link.vehicles[vehicle.system_id].component_id
                link.link.send_message(velocity_set_point(vehicle.system_id, component_id, orders.vel_ned_m_s))
            try:
                if orders.order is Order.TAKE:
                    take_over(link.link, vehicle, descent.wanted_mode)
                elif orders.order is not None:
                    self._wires.command(vehicle, CommandBody(command=COMMANDS[orders.order]))
            except StationError as error:
                self._wires.tell(vehicle, "landing_order", f"'{orders.order}' could not be sent: {error}")
            link.send_soon()
        if not descent.active or descent.phase is LandingPhase.HOLD:
            self._tell_end(vehicle, descent)

    def _tell_end(self, vehicle: LiveVehicle, descent: Descent) -> None:
        before = self._told.get(vehicle.id)
        if before is descent.phase:
            return
        self._told[vehicle.id] = descent.phase
        if descent.phase is LandingPhase.LANDED:
            self._wires.tell(vehicle, "landed", "landed on the pad")
        elif descent.phase is LandingPhase.HOLD:
            self._wires.tell(vehicle, "landing_aborted", f"landing ended, held by vision: {descent.reason}")
        elif before is LandingPhase.HOLD:
            self._wires.tell(vehicle, "hold_ended", f"held by vision no more: {descent.reason}")
        else:
            self._wires.tell(vehicle, "landing_aborted", f"landing ended: {descent.reason}")
