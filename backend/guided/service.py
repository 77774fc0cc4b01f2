"""What the station flies and who looks after it: the pages, the pilot, and the words to the operator."""

from __future__ import annotations

from collections.abc import Callable

import structlog

from backend.clock import mono_us, unix_us
from backend.errors import CommandRefusedError, ConflictError
from backend.fleet.links import LinkEndpoint
from backend.fleet.vehicle import LiveVehicle
from backend.guided.pages import Pages
from backend.guided.pilot import GuidedPilot, Wires
from backend.schemas.vehicles import CommandBody
from estimator.types import NavigationState

GOOD_NEWS = frozenset({"landed", "over_home", "position_aiding_resumed"})

_log = structlog.get_logger(__name__)


class Guided:
    """Lives on the event loop; ``say`` publishes a message."""

    def __init__(
        self, vehicles: Callable[[], dict[str, LiveVehicle]], link_of: Callable[[LiveVehicle], LinkEndpoint | None],
        say: Callable[..., None], command: Callable[[LiveVehicle, CommandBody], str],
    ) -> None:  # fmt: skip
        self.pages = Pages()
        self.pilot = GuidedPilot(Wires(link_of, command, self.tell))
        self._vehicles = vehicles
        self._link_of = link_of
        self._say = say

    def page(self, page: str | None) -> str:
        """The name of a page that is open; ConflictError where it is not."""
        if page is None or not self.pages.is_there(page, mono_us()):
            raise ConflictError(
                "this ends with the page that began it: open /api/v1/stream?page=NAME and give the same name as 'page'"
            )
        return page

    def link(self, vehicle: LiveVehicle) -> LinkEndpoint:
        """The link to a vehicle that is connected; CommandRefusedError."""
        link = self._link_of(vehicle)
        if link is None or not vehicle.connected:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' is not connected")
        return link

    def on_state(self, vehicle: LiveVehicle, state: NavigationState) -> None:
        """A vehicle's new state: with each goes what is sent to the vehicle."""
        self.pilot.on_state(vehicle, state)

    def tick(self) -> None:
        """Ten times a second: end what nobody looks after any more."""
        for vehicle in self._vehicles().values():
            self.pilot.tick(vehicle, self.pages.is_there)

    async def close(self) -> None:
        """The station stops: end what it flies."""
        await self.pilot.close(self._vehicles)

    def tell(self, vehicle: LiveVehicle, code: str, text: str) -> None:
        """A passing alarm: it is told, and does not stand."""
        now_us = unix_us()
        severity = "info" if code in GOOD_NEWS else "warning"
        _log.warning("flown", vehicle=vehicle.id, code=code, text=text)
        self._say(
            "alarm", id=f"{code}:{vehicle.id}:{now_us}", vehicle_id=vehicle.id, severity=severity, code=code,
            text=f"vehicle {vehicle.id}: {text}", active=False, since_unix_us=now_us,
        )  # fmt: skip
