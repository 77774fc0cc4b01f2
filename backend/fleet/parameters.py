"""Parameters of vehicles, asked for and waited for. Lives on the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from backend.errors import CommandRefusedError, InvalidRequestError
from backend.fleet.links import LinkEndpoint
from backend.fleet.vehicle import LiveVehicle
from backend.link.events import ParameterNews, ParameterStatus

# The link gives up by itself; this is for a link that is closed meanwhile.
LONGEST_S = 60.0


@dataclass(slots=True)
class _Waiting:
    names: set[str]
    done: asyncio.Future[None]
    news: dict[str, ParameterNews] = field(default_factory=dict)


class Parameters:
    """Reads and writes; ``link_of`` gives a vehicle's link."""

    def __init__(self, link_of: Callable[[LiveVehicle], LinkEndpoint | None]) -> None:
        self._link_of = link_of
        self._waiting: dict[tuple[str, int], _Waiting] = {}

    async def read(self, vehicle: LiveVehicle, names: Sequence[str]) -> list[ParameterNews]:
        """What the vehicle says of each name, in their order; the errors say why it cannot be asked."""
        link = self._link(vehicle)
        wanted = list(dict.fromkeys(names))
        try:
            request_id = link.link.read_parameters(vehicle.system_id, wanted)
        except ValueError as error:
            raise InvalidRequestError(str(error)) from None
        found = await self._answers(link, request_id, wanted)
        return [found[name] for name in wanted]

    async def write(self, vehicle: LiveVehicle, name: str, value: float, *, armed: bool) -> ParameterNews:
        """Change a parameter, of an armed vehicle only where ``armed`` says so; the errors say what became of it."""
        link = self._link(vehicle)
        if vehicle.telemetry.armed and not armed:
            raise CommandRefusedError(
                f"vehicle '{vehicle.id}' is armed: what {name} does takes effect at once; say \"armed\": true to "
                "change it all the same"
            )
        try:
            request_id = link.link.write_parameter(vehicle.system_id, name, value)
        except ValueError as error:
            raise InvalidRequestError(str(error)) from None
        news = (await self._answers(link, request_id, [name]))[name]
        if news.status is not ParameterStatus.WRITTEN:
            raise CommandRefusedError(f"{news.name} of vehicle '{vehicle.id}' was not changed: {news.text}")
        return news

    def on_news(self, endpoint: str, news: ParameterNews) -> None:
        """Take news of a link."""
        waiting = self._waiting.get((endpoint, news.request_id))
        if waiting is None:
            return
        waiting.news[news.asked] = news
        if waiting.names <= waiting.news.keys() and not waiting.done.done():
            waiting.done.set_result(None)

    def _link(self, vehicle: LiveVehicle) -> LinkEndpoint:
        link = self._link_of(vehicle)
        if link is None or not vehicle.connected:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' is not connected")
        return link

    async def _answers(self, link: LinkEndpoint, request_id: int, names: list[str]) -> dict[str, ParameterNews]:
        key = (link.name, request_id)
        waiting = self._waiting[key] = _Waiting(set(names), asyncio.get_running_loop().create_future())
        try:
            link.send_soon()
            async with asyncio.timeout(LONGEST_S):
                await waiting.done
        except TimeoutError:
            missing = ", ".join(sorted(waiting.names - waiting.news.keys()))
            raise CommandRefusedError(f"the vehicle did not answer for its parameters {missing}") from None
        finally:
            del self._waiting[key]
        return waiting.news
