"""Landing on the pad, as far as the station has to do with it: who is told what, and when it ends."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

from backend.clock import mono_us, unix_us
from backend.errors import CommandRefusedError, ConflictError, NoPadError, StationError
from backend.fleet.links import LinkEndpoint
from backend.fleet.vehicle import LiveVehicle
from backend.guided.service import Guided
from backend.landing.aiding import Aiding
from backend.landing.gaze import PAN_TILT, Gaze
from backend.landing.messages import place_fields
from backend.landing.pads import Pads
from backend.landing.pilot import LandingPilot
from backend.landing.view import PadView, Pictures, pad_view
from backend.link.landing_target import LOCAL_POSITION_NED, LOCAL_POSITION_RATE_HZ, TargetForm, form_for
from backend.navigation.worker import StateUpdate
from backend.schemas.landing import LandingRequest
from estimator.landing.pad import Pad
from estimator.types import FrameSample, Mode
from guidance.landing import LandingConfig

STALE_US = 500_000
VIEW_OF_US = 3_000_000


class Landings:
    """The pad, and what was asked for each vehicle. Lives on the event loop; ``say`` publishes a message."""

    def __init__(
        self, data_dir: Path, vehicles: Callable[[], dict[str, LiveVehicle]],
        link_of: Callable[[LiveVehicle], LinkEndpoint | None], say: Callable[..., None], guided: Guided,
        gear_height_m: float,
    ) -> None:  # fmt: skip
        self.pads = Pads(data_dir)
        self._pictures = Pictures()
        self._vehicles = vehicles
        self._link_of = link_of
        self._say = say
        self._guided = guided
        self.pilot = LandingPilot(guided.pilot, LandingConfig(gear_m=gear_height_m))
        self._aiding: dict[str, Aiding] = {}
        self._gazes: dict[str, Gaze] = {}

    # --- the pad ---

    @property
    def pad(self) -> Pad:
        """The pad that is looked for, or NoPadError."""
        if self.pads.pad is None:
            raise NoPadError
        return self.pads.pad

    def change_pad(self, description: object | None) -> None:
        """Look for another pad, or for none. The estimators begin anew with it, so not while one carries a flight."""
        for vehicle in self._vehicles().values():
            state = None if vehicle.latest is None else vehicle.latest.state
            if vehicle.connected and vehicle.telemetry.armed and state is not None and state.mode is not Mode.GPS:
                raise ConflictError(
                    f"vehicle '{vehicle.id}' flies without GPS: another pad has its estimator begin anew, which would "
                    "lose where it is; give GPS back or land first"
                )
        if description is None:
            self.pads.remove()
            self._pictures.clear()
        else:
            try:
                self.pads.give(description)
            except OSError as error:
                raise StationError(f"the pad's description cannot be kept: {error.strerror or error}") from None
        for vehicle in self._vehicles().values():
            vehicle.look_for(self.pads.pad)
            self._publish(vehicle)
        self._say("pad", name=None if self.pads.pad is None else self.pads.pad.name)

    # --- what is asked ---

    def ask(self, vehicle: LiveVehicle, body: LandingRequest) -> None:
        """Begin or end what a request says; its errors say why that cannot be."""
        if body.abort:
            self._guided.pilot.abort(vehicle)
        elif body.land:
            _ = self.pad
            self.pilot.begin(vehicle, self._guided.page(body.page))
            self._look(vehicle, body.page)
        if body.aiding is True:
            self._begin_aiding(vehicle, body.page)
        elif body.aiding is False:
            self._aiding.pop(vehicle.id, None)
        if body.gaze is True:
            self._begin_gaze(vehicle, body.page)
        elif body.gaze is False:
            self._end_gaze(vehicle)
        self._publish(vehicle)

    def _begin_aiding(self, vehicle: LiveVehicle, page: str | None) -> None:
        name = self._guided.page(page)
        _ = self.pad
        try:
            form = form_for(vehicle.autopilot)
        except ValueError as error:
            raise CommandRefusedError(str(error)) from None
        link = self._guided.link(vehicle)
        if form is TargetForm.LOCAL:
            link.link.request_rate(vehicle.system_id, LOCAL_POSITION_NED, LOCAL_POSITION_RATE_HZ)
            link.send_soon()
        self._aiding[vehicle.id] = Aiding(form, name)

    def _begin_gaze(self, vehicle: LiveVehicle, page: str | None) -> None:
        name = self._guided.page(page)
        _ = self.pad
        self._guided.link(vehicle)
        if not _turns(vehicle):
            raise CommandRefusedError(
                f"the camera of vehicle '{vehicle.id}' cannot be turned: its camera file does not say 'pan_tilt'"
            )
        self._gazes[vehicle.id] = Gaze(name)

    def take_over(self, vehicle: LiveVehicle, page: str) -> None:
        """Land a vehicle that the station flies and that has the pad in sight, for the same page."""
        self.pilot.go_on(vehicle, page)
        self._look(vehicle, page)

    def _look(self, vehicle: LiveVehicle, page: str | None) -> None:
        if vehicle.id not in self._gazes and _turns(vehicle):
            self._begin_gaze(vehicle, page)

    def _end_gaze(self, vehicle: LiveVehicle) -> None:
        gaze = self._gazes.pop(vehicle.id, None)
        if gaze is not None:
            gaze.release(vehicle, self._link_of(vehicle))

    # --- what happens ---

    def on_picture(self, picture: FrameSample) -> None:
        """A picture for the estimator, in the decoder's thread."""
        if self.pads.pad is not None:
            self._pictures.take(picture)

    def on_state(self, vehicle: LiveVehicle, update: StateUpdate) -> None:
        """A vehicle's new state: with each goes what is sent to the vehicle."""
        gaze, wired = self._gazes.get(vehicle.id), self._link_of(vehicle)
        if gaze is not None and wired is not None:
            gaze.point(vehicle, update.state, wired)
        aiding = self._aiding.get(vehicle.id)
        if aiding is None:
            return
        link, message = self._link_of(vehicle), aiding.message(vehicle, update.state)
        if link is not None and message is not None:
            link.link.send_message(message)
            link.send_soon()

    def tick(self) -> None:
        """Ten times a second: end what nobody looks after any more, and tell how it stands."""
        now_us = unix_us()
        for vehicle in self._vehicles().values():
            gaze = self._gazes.get(vehicle.id)
            if gaze is not None and not self._guided.pages.is_there(gaze.page, mono_us()):
                self._end_gaze(vehicle)
            aiding = self._aiding.get(vehicle.id)
            if aiding is not None and not self._guided.pages.is_there(aiding.page, mono_us()):
                del self._aiding[vehicle.id]
                self._guided.tell(
                    vehicle, "aiding_ended", "LANDING_TARGET is sent no more: the page that began it has gone"
                )
            elif aiding is not None and (vehicle.latest is None or now_us - vehicle.latest.state.t_us > STALE_US):
                aiding.silent("the estimator gives no state")
            if self.pads.pad is not None or aiding is not None:
                self._publish(vehicle)

    def close(self) -> None:
        """The station stops: nothing is sent any more."""
        self._aiding.clear()
        for vehicle in self._vehicles().values():
            self._end_gaze(vehicle)

    # --- what is told ---

    def message(self, vehicle: LiveVehicle) -> dict[str, Any]:
        """Fields of the ``landing`` message."""
        aiding = self._aiding.get(vehicle.id)
        state = None if vehicle.latest is None else vehicle.latest.state
        told: dict[str, Any] = {"on": False, "form": None, "sending": False, "sent": 0, "reason": ""}
        if aiding is not None:
            told = {
                "on": True, "form": str(aiding.form), "sending": aiding.sending, "sent": aiding.sent,
                "reason": aiding.reason,
            }  # fmt: skip
        place = place_fields(state, vehicle.setup)
        return {
            "vehicle_id": vehicle.id, **place, "aiding": told, "descent": self.pilot.message(vehicle),
            "gaze": self._gaze_fields(vehicle),
        }  # fmt: skip

    def _gaze_fields(self, vehicle: LiveVehicle) -> dict[str, Any] | None:
        gaze = self._gazes.get(vehicle.id)
        if gaze is not None:
            return {"on": True, "reason": gaze.reason}
        return {"on": False, "reason": ""} if _turns(vehicle) else None

    async def view(self, vehicle: LiveVehicle) -> PadView | None:
        """The newest picture that showed the pad, as from straight above it; None where none has lately."""
        pad, setup = self.pad, vehicle.setup
        relative = None if vehicle.latest is None else vehicle.latest.state.pad
        seen = None if relative is None else relative.seen
        if setup is None or seen is None or unix_us() - seen.t_us > VIEW_OF_US:
            return None
        picture = self._pictures.get(seen.frame_id)
        if picture is None:
            return None
        return await asyncio.to_thread(pad_view, picture, seen, setup.camera, pad)

    def _publish(self, vehicle: LiveVehicle) -> None:
        self._say("landing", **self.message(vehicle))


def _turns(vehicle: LiveVehicle) -> bool:
    """Whether the vehicle's camera can be turned."""
    return vehicle.setup is not None and vehicle.setup.gimbal == PAN_TILT
