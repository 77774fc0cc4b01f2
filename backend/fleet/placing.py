"""Sets up a vehicle's estimator as soon as it is known where the vehicle is: the map about it is read in a thread."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

import structlog

from backend.errors import StationError
from backend.fleet.vehicle import LiveVehicle
from backend.mapping import StationMaps
from backend.navigation.setup import CameraProfile, NavigationSetup, Place, build_setup
from estimator.landing.pad import Pad
from geodata.errors import GeodataError

TRY_AGAIN_S = 5.0

_log = structlog.get_logger(__name__)


class Placing:
    """Which vehicles are being set up, and what has kept others from it. Lives on the event loop.

    ``profile``, ``size_px`` and ``pad`` say what is known of camera, video and landing pad then; ``placed`` is called
    with a vehicle that has a new estimator.
    """

    def __init__(
        self, maps: StationMaps, time_offset_s: float | None, profile: Callable[[], CameraProfile | None],
        size_px: Callable[[], tuple[int, int] | None], pad: Callable[[], Pad | None],
        placed: Callable[[LiveVehicle, NavigationSetup], None],
    ) -> None:  # fmt: skip
        self._maps = maps
        self._time_offset_s = time_offset_s
        self._profile = profile
        self._size_px = size_px
        self._pad = pad
        self._placed = placed
        self._placing: set[str] = set()
        self._problem: dict[str, str] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def place(self, vehicle: LiveVehicle, here: Place | None) -> None:
        """Set a vehicle's estimator up, in the background; without a place a map is searched, if it is plain which."""
        if vehicle.id in self._placing:
            return
        self._placing.add(vehicle.id)
        task = asyncio.create_task(self._set_up(vehicle, here))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def waiting_for(self, vehicle: LiveVehicle) -> list[str]:
        """What a vehicle's estimator waits for, in the operator's words."""
        if vehicle.id not in self._problem and vehicle.id in self._placing:
            return [f"vehicle {vehicle.id}: the map of its area to be read"]
        waits = []
        if vehicle.id in self._problem:
            waits.append(f"vehicle {vehicle.id}: a usable map ({self._problem[vehicle.id]})")
        elif vehicle.setup is not None and vehicle.setup.reference is None:
            waits.append(f"vehicle {vehicle.id}: a reference map of its area: pilotage map import FILE.tif")
        return waits + vehicle.waiting_for()

    async def close(self) -> None:
        """Give up what is being set up."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _set_up(self, vehicle: LiveVehicle, here: Place | None) -> None:
        try:
            await self._maps.refresh()
            known = here is not None
            profile = self._profile()
            if here is None:
                alt_m = None if profile is None else profile.map.ground_alt_amsl_m
                here = await asyncio.to_thread(self._maps.middle, alt_m)
            if here is None:
                await asyncio.sleep(TRY_AGAIN_S)  # then the next sample tries again
                return
            setup = await asyncio.to_thread(
                build_setup, profile, self._maps.files_for(here), here, self._size_px(), self._time_offset_s
            )
        except (GeodataError, StationError, OSError) as error:
            self._problem[vehicle.id] = str(error)
            _log.error("estimator not set up", vehicle=vehicle.id, error=str(error))
            await asyncio.sleep(TRY_AGAIN_S)  # then the next sample tries again
        else:
            self._problem.pop(vehicle.id, None)
            vehicle.navigate(replace(setup, place_known=known, pad=self._pad()))
            self._placed(vehicle, setup)
        finally:
            self._placing.discard(vehicle.id)
