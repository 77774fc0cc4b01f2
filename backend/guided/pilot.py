"""The flights that the station flies: which vehicles can be, what goes to them, and what the operator is told."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from backend.clock import mono_us, unix_us
from backend.errors import CommandRefusedError, ConflictError, StationError
from backend.fleet.commands import take_over
from backend.fleet.links import LinkEndpoint
from backend.fleet.vehicle import LiveVehicle
from backend.guided.flight import MODE_WORDS, GuidedFlight, Order, Orders
from backend.link.events import VehicleType
from backend.link.landing_target import velocity_set_point
from backend.schemas.vehicles import CommandBody
from estimator.types import NavigationState

HOVERS = (VehicleType.MULTIROTOR, VehicleType.HELICOPTER)
STEERS = frozenset({"disarm", "takeoff", "goto", "orbit", "hold", "return", "land", "start_mission"})
COMMANDS: dict[Order, Literal["hold", "land"]] = {Order.HOLD: "hold", Order.LAND: "land"}
FAREWELL_S = 3.0

Flight = GuidedFlight[Any]


@dataclass(frozen=True, slots=True)
class Wires:
    """What the pilot speaks through: a vehicle's link, a command to it, and words to the operator (code, text)."""

    link_of: Callable[[LiveVehicle], LinkEndpoint | None]
    command: Callable[[LiveVehicle, CommandBody], str]
    tell: Callable[[LiveVehicle, str, str], None]


class GuidedPilot:
    """At most one flight of each vehicle. Lives on the event loop."""

    def __init__(self, wires: Wires) -> None:
        self._wires = wires
        self._flights: dict[str, Flight] = {}
        self._told: dict[str, str] = {}

    def flight_of(self, vehicle: LiveVehicle) -> Flight | None:
        """The flight of a vehicle that goes on, or that was its last."""
        return self._flights.get(vehicle.id)

    def check_free(self, vehicle: LiveVehicle) -> None:
        """Refuse a vehicle that cannot be flown by the station now; the errors say why."""
        before = self._flights.get(vehicle.id)
        if before is not None and before.active and not before.standing:
            raise ConflictError(f"vehicle '{vehicle.id}' is flown already ({before.name}): end that first")
        link = self._wires.link_of(vehicle)
        if link is None or not vehicle.connected:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' is not connected")
        if vehicle.autopilot not in MODE_WORDS or vehicle.vehicle_type not in HOVERS:
            raise CommandRefusedError(
                f"vehicle '{vehicle.id}' ({vehicle.vehicle_type}, autopilot {vehicle.autopilot}) cannot be flown by "
                "the station: that takes a helicopter or multirotor with ArduPilot or PX4"
            )
        if not vehicle.telemetry.armed:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' is not armed: it stands")

    def begin(self, vehicle: LiveVehicle, flight: Flight) -> None:
        """Fly a vehicle from now on, in place of what it flew before."""
        self._flights[vehicle.id] = flight
        self._told.pop(vehicle.id, None)

    def abort(self, vehicle: LiveVehicle) -> None:
        """End a vehicle's flight on the operator's word, or where that is ended its standing; else nothing happens."""
        flight = self._flights.get(vehicle.id)
        if flight is not None and flight.active:
            self._send(vehicle, flight, flight.abort("the operator ended it"))

    def overrule(self, vehicle: LiveVehicle, command: str) -> None:
        """The operator tells a vehicle something else: the flight ends without another word to it."""
        flight = self._flights.get(vehicle.id)
        if flight is not None and flight.active and command in STEERS:
            flight.yield_to(f"the operator said '{command}'")
            self._tell_end(vehicle, flight)

    def on_state(self, vehicle: LiveVehicle, state: NavigationState) -> None:
        """A vehicle's new state."""
        flight = self._flights.get(vehicle.id)
        if flight is not None and flight.active:
            self._send(vehicle, flight, flight.take(state, vehicle.telemetry))

    def tick(self, vehicle: LiveVehicle, page_is_there: Callable[[str, int], bool]) -> None:
        """Ten times a second."""
        flight = self._flights.get(vehicle.id)
        if flight is not None and flight.active:
            there = page_is_there(flight.page, mono_us())
            orders = flight.tick(unix_us(), vehicle.telemetry, page_there=there, connected=vehicle.connected)
            self._send(vehicle, flight, orders)

    async def close(self, vehicles: Callable[[], dict[str, LiveVehicle]]) -> None:
        """The station stops: end every flight, and wait a moment for the vehicles to have heard it."""
        left: list[tuple[LiveVehicle, str]] = []
        for vehicle in vehicles().values():
            flight = self._flights.get(vehicle.id)
            if flight is not None and flight.active:
                self._send(vehicle, flight, flight.stop("the station stops"))
                left.append((vehicle, flight.wanted_mode))
        ends_us = mono_us() + int(FAREWELL_S * 1e6)
        while mono_us() < ends_us and any(v.connected and v.telemetry.flight_mode == mode for v, mode in left):
            await asyncio.sleep(0.05)

    def _send(self, vehicle: LiveVehicle, flight: Flight, orders: Orders) -> None:
        link = self._wires.link_of(vehicle)
        if link is not None:
            if orders.vel_ned_m_s is not None:
                component_id = link.link.vehicles[vehicle.system_id].component_id
                link.link.send_message(velocity_set_point(vehicle.system_id, component_id, orders.vel_ned_m_s))
            try:
                if orders.order is Order.TAKE:
                    take_over(link.link, vehicle, flight.wanted_mode)
                elif orders.order is not None:
                    self._wires.command(vehicle, CommandBody(command=COMMANDS[orders.order]))
            except StationError as error:
                self._wires.tell(vehicle, f"{flight.name}_order", f"'{orders.order}' could not be sent: {error}")
            link.send_soon()
        if not flight.active or flight.standing:
            self._tell_end(vehicle, flight)

    def _tell_end(self, vehicle: LiveVehicle, flight: Flight) -> None:
        before, now = self._told.get(vehicle.id), "hold" if flight.active else "ended"
        if before == now:
            return
        self._told[vehicle.id] = now
        if flight.landed:
            self._wires.tell(vehicle, "landed", flight.landed_words)
        elif flight.active:
            self._wires.tell(vehicle, f"{flight.name}_aborted", f"{flight.name} ended, held by vision: {flight.reason}")
        elif before == "hold":
            self._wires.tell(vehicle, "hold_ended", f"held by vision no more: {flight.reason}")
        else:
            self._wires.tell(vehicle, f"{flight.name}_aborted", f"{flight.name} ended: {flight.reason}")
