"""Telling autopilots where they are: who is told, in which form, what comes of it, and when it ends."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from backend.aiding.checks import check, names_of, verdict
from backend.aiding.effect import judge
from backend.aiding.session import NO_ORIGIN, NO_STATE, SILENT_US, Seen, Session
from backend.clock import mono_us, unix_us
from backend.errors import CommandRefusedError, ConflictError, NoStateYetError
from backend.fleet.links import LinkEndpoint
from backend.fleet.messages import finite
from backend.fleet.parameters import Parameters
from backend.fleet.vehicle import LiveVehicle
from backend.guided.service import Guided
from backend.link.aiding import FORMS, AidingForm, Origin, Reader
from backend.link.events import CommandStatus
from backend.navigation.worker import StateUpdate
from backend.uncertainty import worst_std
from estimator.geometry.local import LocalFrame
from estimator.types import NavigationState

SAID_EVERY_TICKS = 5
TOLD_AFTER_TICKS = 10
OWN_SILENT_US = 2_000_000
FIX_SILENT_US = 3_000_000
BEHIND_US = 5_000_000
ECHO_US = 10_000_000
"""So long after the last GPS_INPUT an autopilot's GPS may still be what it was sent."""

Counts = tuple[int, int]


class PositionAiding:
    """At most one session of each vehicle. Lives on the event loop; ``say`` publishes a message."""

    def __init__(
        self, vehicles: Callable[[], dict[str, LiveVehicle]], link_of: Callable[[LiveVehicle], LinkEndpoint | None],
        say: Callable[..., None], guided: Guided,
    ) -> None:  # fmt: skip
        self.parameters = Parameters(link_of)
        self._vehicles = vehicles
        self._link_of = link_of
        self._say = say
        self._guided = guided
        self._sessions: dict[str, Session] = {}
        self._counts_before: dict[str, Counts] = {}
        self._told_sending: dict[str, bool] = {}
        self._changed_ticks: dict[str, int] = {}
        self._echo_ends_us: dict[str, int] = {}
        self._ticks = 0

    # --- what is asked ---

    async def check(self, vehicle: LiveVehicle, form: AidingForm | None) -> dict[str, Any]:
        """Whether a vehicle can be told in a form (its first where none is named): fields of ``AidingCheckBody``."""
        forms = self._forms(vehicle)
        session = self._sessions.get(vehicle.id)
        chosen = form or (forms[0] if session is None else session.form)
        self._check_form(vehicle, chosen)
        news = await self.parameters.read(vehicle, names_of(vehicle.autopilot, chosen))
        rows, to_do = check(vehicle.autopilot, chosen, {one.asked: one.value for one in news})
        return {
            "forms": [str(one) for one in forms], "form": str(chosen), "last_resort": chosen is AidingForm.GPS_INPUT,
            "parameters": [asdict(row) for row in rows], "parameters_ok": verdict(rows), "to_do": to_do,
            "objection": self._objection(vehicle, chosen), "status": self.message(vehicle),
        }  # fmt: skip

    def begin(self, vehicle: LiveVehicle, form: AidingForm, page: str | None) -> None:
        """Tell a vehicle where it is from now on, for a page that is open; the errors say why that cannot be."""
        name = self._guided.page(page)
        self._check_form(vehicle, form)
        link = self._guided.link(vehicle)
        if vehicle.latest is None or vehicle.setup is None:
            raise NoStateYetError(vehicle.id)
        if objection := self._objection(vehicle, form):
            raise CommandRefusedError(f"vehicle '{vehicle.id}' cannot be told where it is ({form}): {objection}")
        self.end(vehicle)
        session = Session(form, name, self._reader(vehicle, link), unix_us())
        session.gap_began_m = self._gap_m(vehicle, unix_us())
        self._counts_before[vehicle.id] = _counts(vehicle)
        vehicle.last_position_answer = None
        self._told_sending[vehicle.id] = True
        self._changed_ticks[vehicle.id] = self._ticks
        vehicle.aided = True
        if form is AidingForm.GPS_INPUT:
            vehicle.gps_is_echo = True
        self._sessions[vehicle.id] = session
        self._publish(vehicle)

    def end(self, vehicle: LiveVehicle) -> None:
        """Send nothing more; where nothing is sent, nothing happens."""
        session = self._sessions.pop(vehicle.id, None)
        if session is not None:
            # Its home, too, may still be made of what it was told.
            self._echo_ends_us[vehicle.id] = mono_us() + ECHO_US
            self._publish(vehicle)

    def check_gps_may_return(self, vehicle: LiveVehicle) -> None:
        """Refuse to give GPS back to an estimator while the vehicle's GPS is what the station sends (ConflictError)."""
        if vehicle.gps_is_echo:
            raise ConflictError(
                f"what vehicle '{vehicle.id}' reports as GPS is what the station sends it (gps_input): turn that off, "
                f"and wait {ECHO_US // 1_000_000} s"
            )

    # --- what happens ---

    def on_state(self, vehicle: LiveVehicle, update: StateUpdate) -> None:
        """A vehicle's new state: what is due goes to its autopilot."""
        session, link, setup = self._sessions.get(vehicle.id), self._link_of(vehicle), vehicle.setup
        if session is None or link is None or setup is None:
            return
        messages = session.messages(update.state, update.epoch, setup.frame, _seen(vehicle, unix_us()), unix_us())
        for message in messages:
            link.link.send_message(message)
        if messages:
            link.send_soon()

    def tick(self) -> None:
        """Ten times a second: end what nobody looks after any more, and tell how it stands."""
        self._ticks += 1
        now_us = unix_us()
        for vehicle in self._vehicles().values():
            session = self._sessions.get(vehicle.id)
            self._end_echo(vehicle, session)
            if session is None:
                continue
            if not self._guided.pages.is_there(session.page, mono_us()):
                self.end(vehicle)
                text = "its autopilot is told no more where it is: the page that began it has gone"
                self._guided.tell(vehicle, "position_aiding_ended", text)
                continue
            if vehicle.latest is None or abs(now_us - vehicle.latest.state.t_us) > SILENT_US:
                session.silent("the estimator gives no state")
            self._tell_change(vehicle, session)
            if self._ticks % SAID_EVERY_TICKS == 0:
                self._publish(vehicle)

    def close(self) -> None:
        """The station stops: nothing is sent any more."""
        self._sessions.clear()

    def _end_echo(self, vehicle: LiveVehicle, session: Session | None) -> None:
        if mono_us() < self._echo_ends_us.get(vehicle.id, 0):
            return
        vehicle.aided = session is not None
        vehicle.gps_is_echo = session is not None and session.form is AidingForm.GPS_INPUT

    def _tell_change(self, vehicle: LiveVehicle, session: Session) -> None:
        if session.sending == self._told_sending[vehicle.id]:
            self._changed_ticks[vehicle.id] = self._ticks
            return
        if self._ticks - self._changed_ticks.get(vehicle.id, self._ticks) < TOLD_AFTER_TICKS:
            return
        # Before the first message it waits for a state or for the origin: that is no pause yet.
        if not session.sending and session.reason in (NO_STATE, NO_ORIGIN):
            return
        self._told_sending[vehicle.id] = session.sending
        if session.sending:
            self._guided.tell(vehicle, "position_aiding_resumed", "its autopilot is told again where it is")
        else:
            text = f"its autopilot is not told where it is: {session.reason}"
            self._guided.tell(vehicle, "position_aiding_paused", text)

    # --- what is told ---

    def message(self, vehicle: LiveVehicle) -> dict[str, Any]:
        """Fields of the ``aiding`` message."""
        session, now_us = self._sessions.get(vehicle.id), unix_us()
        state = None if vehicle.latest is None else vehicle.latest.state
        std_m = math.nan if state is None else worst_std(state.cov_pos_ned_m2[:2, :2])
        gap_m = self._gap_m(vehicle, now_us)
        told: dict[str, Any] = {
            "vehicle_id": vehicle.id,
            "gap_now_m": gap_m,
            "std_horizontal_m": finite(round(std_m, 2)),
        }
        if session is None:
            return told | {
                "on": False, "form": None, "last_resort": False, "sending": False, "sent": 0, "reason": "",
                "accepted": 0, "refused": 0, "gap_began_m": None, "effect": "cannot_tell", "effect_text": "it is off",
            }  # fmt: skip
        accepted, refused, words = self._answers(vehicle)
        effect, text = judge(session.evidence(now_us, (accepted, refused, words), gap_m, std_m))
        return told | {
            "on": True, "form": str(session.form), "last_resort": session.form is AidingForm.GPS_INPUT,
            "sending": session.sending, "sent": session.sent, "reason": session.reason, "accepted": accepted,
            "refused": refused, "gap_began_m": session.gap_began_m, "effect": str(effect), "effect_text": text,
        }  # fmt: skip

    def _publish(self, vehicle: LiveVehicle) -> None:
        self._say("aiding", **self.message(vehicle))

    def _answers(self, vehicle: LiveVehicle) -> tuple[int, int, str]:
        """Accepted and refused since it began, and the words of a refusal that was the last answer."""
        before, now, last = self._counts_before[vehicle.id], _counts(vehicle), vehicle.last_position_answer
        words = "" if last is None or last.status is CommandStatus.ACCEPTED else last.status.replace("_", " ")
        return now[0] - before[0], now[1] - before[1], words

    def _objection(self, vehicle: LiveVehicle, form: AidingForm) -> str:
        """Why it cannot be begun; an origin that is not known yet is no reason."""
        link = self._link_of(vehicle)
        if vehicle.latest is None or vehicle.setup is None:
            return "the estimator has no state yet"
        if link is None or not vehicle.connected:
            return "the vehicle is not connected"
        state, now_us = vehicle.latest.state, unix_us()
        # An estimator that is a little behind keeps nobody from beginning: nothing is sent until it has caught up.
        at_us = state.t_us if abs(now_us - state.t_us) <= BEHIND_US else now_us
        probe = Session(form, "", self._reader(vehicle, link), at_us)
        return probe.objection(state, _seen(vehicle, now_us), at_us)

    def _forms(self, vehicle: LiveVehicle) -> tuple[AidingForm, ...]:
        forms = FORMS.get(vehicle.autopilot)
        if forms is None:
            raise CommandRefusedError(
                f"nobody knows what the autopilot of vehicle '{vehicle.id}' ({vehicle.autopilot}) takes: ArduPilot or "
                "PX4 can be told where it is"
            )
        return forms

    def _check_form(self, vehicle: LiveVehicle, form: AidingForm) -> None:
        forms = self._forms(vehicle)
        if form not in forms:
            raise CommandRefusedError(
                f"vehicle '{vehicle.id}' ({vehicle.autopilot}) does not take '{form}': it takes {', '.join(forms)}"
            )

    @staticmethod
    def _reader(vehicle: LiveVehicle, link: LinkEndpoint) -> Reader:
        return Reader(vehicle.system_id, link.link.vehicles[vehicle.system_id].component_id, vehicle.autopilot)

    def _gap_m(self, vehicle: LiveVehicle, now_us: int) -> float | None:
        """From the estimate to where the autopilot has itself, horizontally; None where one of them is not known."""
        if vehicle.latest is None or vehicle.setup is None:
            return None
        state, frame = vehicle.latest.state, vehicle.setup.frame
        if abs(now_us - state.t_us) > OWN_SILENT_US:
            return None
        own = vehicle.own_position
        if own is not None and abs(now_us - own.t_us) <= OWN_SILENT_US:
            return finite(round(_off_m(state, frame.ne_from_geodetic(own.lat_rad, own.lon_rad), own.t_us), 2))
        local, origin = vehicle.local_position, vehicle.origin
        if local is None or origin is None or abs(now_us - local.t_us) > OWN_SILENT_US:
            return None
        theirs = LocalFrame(origin.lat_rad, origin.lon_rad, origin.alt_amsl_m)
        lat_rad, lon_rad, _ = theirs.geodetic_from_ned(np.array(local.pos_ned_m))
        return finite(round(_off_m(state, frame.ne_from_geodetic(lat_rad, lon_rad), local.t_us), 2))


def _off_m(state: NavigationState, own_ne_m: Any, t_us: int) -> float:
    """How far the estimate, by its velocity carried to the time of the other, is from it."""
    estimate = state.pos_ned_m[:2] + (t_us - state.t_us) * 1e-6 * state.vel_ned_m_s[:2]
    return float(np.linalg.norm(estimate - own_ne_m))


def _seen(vehicle: LiveVehicle, now_us: int) -> Seen:
    gps, origin = vehicle.gps, vehicle.origin
    return Seen(
        vehicle.connected, gps is not None and gps.has_fix and now_us - gps.t_us <= FIX_SILENT_US, vehicle.gps_denied,
        None if origin is None else Origin(origin.lat_rad, origin.lon_rad, origin.alt_amsl_m),
    )  # fmt: skip


def _counts(vehicle: LiveVehicle) -> Counts:
    accepted = vehicle.position_answers[CommandStatus.ACCEPTED]
    return accepted, vehicle.position_answers.total() - accepted
