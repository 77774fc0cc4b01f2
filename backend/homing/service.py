"""Flights home of the station's vehicles: begun, handed over to the pad where there is one, and told."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

from backend.clock import unix_us
from backend.errors import CommandRefusedError, NoStateYetError, StationError
from backend.fleet.messages import finite
from backend.fleet.vehicle import LiveVehicle
from backend.guided.service import Guided
from backend.homing.flight import HomeFlight
from backend.homing.planning import Way, plan_way
from backend.landing.service import Landings
from backend.navigation.setup import NavigationSetup, Place
from backend.schemas.homing import HomingRequest
from backend.uncertainty import worst_std
from estimator.types import Mode, NavigationState
from guidance.geofence import Geofence, InclusionRule
from guidance.homing import HomingConfig, HomingGuidance, HomingPhase

SAID_EVERY_TICKS = 5

Fence = Callable[[LiveVehicle], Awaitable[tuple[Geofence, InclusionRule]]]


class Homings:
    """Lives on the event loop; ``say`` publishes a message, ``fence_of`` gives the fence of a vehicle's kept plan."""

    def __init__(
        self, vehicles: Callable[[], dict[str, LiveVehicle]], say: Callable[..., None], guided: Guided,
        landings: Landings, fence_of: Fence,
    ) -> None:  # fmt: skip
        self._vehicles = vehicles
        self._say = say
        self._guided = guided
        self._landings = landings
        self._fence_of = fence_of
        self._ways: dict[str, Way] = {}
        self._over: set[str] = set()
        self._ticks = 0

    async def ask(self, vehicle: LiveVehicle, wish: HomingRequest) -> dict[str, Any]:
        """Show the way home, fly it, or end that; the errors say why that cannot be. What is told then."""
        if wish.action == "abort":
            self._guided.pilot.abort(vehicle)
            return self._told(vehicle)
        page = None if wish.action == "preview" else self._guided.page(wish.page)
        if page is not None:
            self._guided.pilot.check_free(vehicle)
        fence, rule = await self._fence_of(vehicle)
        state, setup = self._known(vehicle)
        home = self._home(vehicle, wish)
        way = await asyncio.to_thread(plan_way, state, setup, home, wish, fence, rule)
        if page is None:
            return {**self.message(vehicle), "way": way.body.model_dump()}
        self._guided.pilot.check_free(vehicle)
        self._begin(vehicle, way, page)
        return self._told(vehicle)

    def _begin(self, vehicle: LiveVehicle, way: Way, page: str) -> None:
        before = self._guided.pilot.flight_of(vehicle)
        trim = None if before is None or not before.active else before.trim_ned_m_s
        behind_s = 0.0 if vehicle.worker is None else vehicle.worker.delay_us / 1e6
        config = HomingConfig()
        config = replace(config, lost_after_s=config.lost_after_s + behind_s)
        guidance = HomingGuidance(way.segments, config, land=way.body.land, trim_ned_m_s=trim)
        self._ways[vehicle.id] = way
        self._over.discard(vehicle.id)
        flight = HomeFlight(vehicle.autopilot, page, unix_us(), guidance, way.body.when_lost)
        self._guided.pilot.begin(vehicle, flight)

    def _known(self, vehicle: LiveVehicle) -> tuple[NavigationState, NavigationSetup]:
        if vehicle.latest is None or vehicle.setup is None:
            raise NoStateYetError(vehicle.id)
        state = vehicle.latest.state
        if state.mode is Mode.LOST:
            raise CommandRefusedError(f"the estimator has lost the place of vehicle '{vehicle.id}'")
        std_m, most_m = worst_std(state.cov_pos_ned_m2[:2, :2]), HomingConfig().std_m
        if not std_m <= most_m:
            raise CommandRefusedError(
                f"the place of vehicle '{vehicle.id}' is known to {std_m:.0f} m only; {most_m:g} m are asked for"
            )
        return state, vehicle.setup

    @staticmethod
    def _home(vehicle: LiveVehicle, wish: HomingRequest) -> Place:
        own = vehicle.home
        if wish.home is not None:
            alt_m = vehicle.latest.state.alt_amsl_m if own is None and vehicle.latest is not None else 0.0
            return Place(
                math.radians(wish.home.lat_deg), math.radians(wish.home.lon_deg),
                alt_m if own is None else own.alt_amsl_m,
            )  # fmt: skip
        if own is None:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' has not said where its home is: name one ('home')")
        return Place(own.lat_rad, own.lon_rad, own.alt_amsl_m)

    def on_state(self, vehicle: LiveVehicle) -> None:
        """After a vehicle's new state has been flown by: over home the pad takes over where it is in sight."""
        flight = self._flight(vehicle)
        if flight is None or not flight.active or flight.standing:
            return
        if flight.guidance.over_home and vehicle.id not in self._over:
            self._over.add(vehicle.id)
            self._guided.tell(
                vehicle, "over_home", "is over home" + ("" if self._lands(vehicle) else " and stays there")
            )
        if flight.phase is HomingPhase.DESCEND and flight.pad_followed:
            try:
                self._landings.take_over(vehicle, flight.page)
            except StationError as error:
                self._guided.tell(vehicle, "pad_refused", f"is not landed on the pad: {error}")
                return
            self._guided.tell(vehicle, "over_home", "sees the pad and lands on it")
            self._told(vehicle)

    def _lands(self, vehicle: LiveVehicle) -> bool:
        way = self._ways.get(vehicle.id)
        return way is not None and way.body.land

    def tick(self) -> None:
        """Ten times a second: tell how it stands, twice."""
        self._ticks += 1
        if self._ticks % SAID_EVERY_TICKS:
            return
        for vehicle in self._vehicles().values():
            if vehicle.id in self._ways:
                self._told(vehicle)

    def message(self, vehicle: LiveVehicle) -> dict[str, Any]:
        """Fields of the ``homing`` message."""
        flight, way = self._flight(vehicle), self._ways.get(vehicle.id)
        state = None if vehicle.latest is None else vehicle.latest.state
        if flight is None or way is None:
            return {
                "vehicle_id": vehicle.id, "active": False, "phase": None, "reason": "", "way": None,
                "remaining_m": None, "to_home_m": None, "std_horizontal_m": None, "set_point_ned_m_s": None,
            }  # fmt: skip
        point, remaining_m = flight.set_point_ned_m_s, flight.guidance.remaining_m
        away = None if state is None else state.pos_ned_m - flight.guidance.home_ned_m
        return {
            "vehicle_id": vehicle.id, "active": flight.active, "phase": str(flight.phase), "reason": flight.reason,
            "way": way.body.model_dump(), "remaining_m": finite(round(remaining_m, 3)),
            "to_home_m": None if away is None else finite(round(math.hypot(away[0], away[1]), 3)),
            "std_horizontal_m": None if state is None else finite(round(worst_std(state.cov_pos_ned_m2[:2, :2]), 3)),
            "set_point_ned_m_s": None if point is None else [float(value) for value in point],
        }  # fmt: skip

    def _flight(self, vehicle: LiveVehicle) -> HomeFlight | None:
        flight = self._guided.pilot.flight_of(vehicle)
        return flight if isinstance(flight, HomeFlight) else None

    def _told(self, vehicle: LiveVehicle) -> dict[str, Any]:
        message = self.message(vehicle)
        self._say("homing", **message)
        return message
