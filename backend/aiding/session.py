"""What goes to one autopilot while it is told where it is: when, what, and why not. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from backend.aiding.effect import Evidence
from backend.link.aiding import (
    AidingForm,
    Origin,
    Reader,
    carried_on,
    external_position,
    global_position_sensor,
    gps_input,
    odometry,
    request_origin,
    set_origin,
)
from backend.link.events import Autopilot
from backend.uncertainty import worst_std
from estimator.geometry.local import LocalFrame
from estimator.types import Doubt, Mode, NavigationState

INTERVAL_US = {
    AidingForm.EXTERNAL_POSITION: 1_000_000,
    AidingForm.ODOMETRY: 50_000,
    AidingForm.GPS_INPUT: 200_000,
    AidingForm.GLOBAL_POSITION_SENSOR: 200_000,
}
STD_LIMIT_M = {
    AidingForm.EXTERNAL_POSITION: 10.0,
    AidingForm.ODOMETRY: 5.0,
    AidingForm.GPS_INPUT: 5.0,
    AidingForm.GLOBAL_POSITION_SENSOR: 10.0,
}
# What was too uncertain is sent again when it is clearly better, not at each crossing of the limit.
RESUME_SHARE = 0.8
STALE_US = 500_000
# A busy machine gives no state for a moment, and nothing is sent then; that is no pause to speak of.
SILENT_US = 1_000_000
_AHEAD_US = 100_000
# States come every 50 ms, some a little early.
_EARLY_US = 10_000
# Beyond what a vehicle can do between two states: the estimator has changed its mind.
JUMP_M, JUMP_M_S2 = 2.0, 10.0
# After that the autopilot has gone its own way, and has to be fetched from there.
LONG_PAUSE_S = 2.0
_ASK_ORIGIN_US = 2_000_000
_ASKS_BEFORE_SETTING = 3
NO_STATE = "no state yet"
NO_ORIGIN = "the autopilot has not said where its local frame begins (GPS_GLOBAL_ORIGIN)"


@dataclass(frozen=True, slots=True)
class Seen:
    """What of a vehicle counts: ``has_fix`` of its own receiver, ``gps_denied`` to the estimator."""

    connected: bool
    has_fix: bool
    gps_denied: bool
    origin: Origin | None


class Session:
    """From the operator's word to its end; ``page`` is the operator's. ``reason`` is empty while it is sent."""

    def __init__(self, form: AidingForm, page: str, to: Reader, t_us: int) -> None:
        self.form, self.page, self.to = form, page, to
        self.sent = 0
        self.sending = False
        self.reason = NO_STATE
        self.gap_began_m: float | None = None
        self._due_us = t_us
        self._sending_since_us = t_us
        self._last_sent_us: int | None = None
        self._too_uncertain = False
        self._resets = 0
        self._told: tuple[int, NavigationState] | None = None
        self._ask_origin_us = t_us
        self._origin_asks = 0

    @property
    def limit_m(self) -> float:
        """How well a place must be known to be told."""
        return STD_LIMIT_M[self.form] * (RESUME_SHARE if self._too_uncertain else 1.0)

    def objection(self, state: NavigationState, seen: Seen, t_us: int) -> str:  # noqa: PLR0911  one return a reason
        """Why a state is not to be told at ``t_us``; empty where it is."""
        age_us = t_us - state.t_us
        place = (state.lat_rad, state.lon_rad, state.alt_amsl_m, *state.vel_ned_m_s, *state.q_ned_from_body)
        if not seen.connected:
            return "the vehicle is not connected"
        if not -_AHEAD_US <= age_us <= STALE_US:
            return f"the estimate is {age_us * 1e-6:.1f} s old"
        if state.mode is Mode.LOST or not np.all(np.isfinite(place)):
            return "the estimator has lost the place"
        if state.mode is Mode.GPS and self.form is not AidingForm.ODOMETRY:
            return "the estimate comes from the vehicle's own GPS"
        if self.form is AidingForm.EXTERNAL_POSITION and seen.has_fix:
            return "the vehicle's receiver has a fix: ArduPilot takes a position from outside only where GPS is lost"
        if self.form is AidingForm.GPS_INPUT and not seen.gps_denied:
            return "GPS must be kept from the estimator: what is sent comes back as the vehicle's GPS"
        if Doubt.MAP_MISMATCH in state.doubts:
            return "the pictures do not fit the map"
        return self._uncertain(state)

    def _uncertain(self, state: NavigationState) -> str:
        std_m, limit_m = worst_std(state.cov_pos_ned_m2[:2, :2]), self.limit_m
        self._too_uncertain = not std_m <= limit_m
        return f"the place is known to {std_m:.1f} m only; {limit_m:g} m are asked for" if self._too_uncertain else ""

    def messages(
        self, state: NavigationState, epoch: int, frame: LocalFrame, seen: Seen, t_us: int
    ) -> list[Any]:  # fmt: skip
        """What to send at ``t_us`` with a new state of the estimator's ``epoch``; ``frame`` is that of the state."""
        self.reason = self.objection(state, seen, t_us)
        if not self.reason and self.form is AidingForm.ODOMETRY and seen.origin is None:
            self.reason = NO_ORIGIN
            self.sending = False
            return self._for_origin(frame, t_us)
        if self.reason:
            self.sending = False
            return []
        if not self.sending:
            self.sending = True
            if self._last_sent_us is None or not 0 <= t_us - self._last_sent_us <= int(LONG_PAUSE_S * 1e6):
                self._sending_since_us = t_us
        if t_us < self._due_us - _EARLY_US and self._due_us - t_us <= INTERVAL_US[self.form]:
            return []
        # Steady on its own grid, and not in bursts after a pause.
        self._due_us = max(self._due_us, t_us - _EARLY_US) + INTERVAL_US[self.form]
        told = carried_on(state, frame, t_us)
        self._count_jump(told, epoch)
        self.sent += 1
        self._last_sent_us = t_us
        return [self._message(told, seen, t_us)]

    def silent(self, reason: str) -> None:
        """No state comes."""
        self.sending, self.reason = False, reason

    def evidence(
        self, t_us: int, answers: tuple[int, int, str], gap_now_m: float | None, std_m: float
    ) -> Evidence:  # fmt: skip
        """What is known of the effect; ``answers`` count from the session's begin."""
        answered = answers if self.form is AidingForm.EXTERNAL_POSITION else None
        sending_us = t_us - self._sending_since_us if self.sending else 0
        return Evidence(self.sending, sending_us, self.sent, answered, self.gap_began_m, gap_now_m, std_m)

    def _message(self, state: NavigationState, seen: Seen, t_us: int) -> Any:
        if self.form is AidingForm.ODOMETRY and seen.origin is not None:
            std_m = worst_std(state.cov_pos_ned_m2[:2, :2])
            quality_pct = max(1, round(100.0 * (1.0 - std_m / STD_LIMIT_M[self.form])))
            return odometry(state, self.to, seen.origin, self._resets, quality_pct)
        if self.form is AidingForm.EXTERNAL_POSITION:
            return external_position(state, self.to, t_us)
        if self.form is AidingForm.GLOBAL_POSITION_SENSOR:
            return global_position_sensor(state, self.to, t_us)
        return gps_input(state)

    def _count_jump(self, state: NavigationState, epoch: int) -> None:
        before, self._told = self._told, (epoch, state)
        if before is None:
            return
        told = before[1]
        dt_s = (state.t_us - told.t_us) * 1e-6
        # Through the places themselves: a new epoch may lie in another frame.
        at = LocalFrame(told.lat_rad, told.lon_rad, told.alt_amsl_m)
        moved = at.ned_from_geodetic(state.lat_rad, state.lon_rad, state.alt_amsl_m)
        off_m = float(np.linalg.norm(moved - dt_s * 0.5 * (told.vel_ned_m_s + state.vel_ned_m_s)))
        if before[0] != epoch or dt_s > LONG_PAUSE_S or off_m > JUMP_M + 0.5 * JUMP_M_S2 * dt_s**2:
            self._resets += 1

    def _for_origin(self, frame: LocalFrame, t_us: int) -> list[Any]:
        """Ask for the origin; an ArduPilot that has none after three questions is given that of the estimate, once."""
        if t_us < self._ask_origin_us:
            return []
        self._ask_origin_us = t_us + _ASK_ORIGIN_US
        self._origin_asks += 1
        asked = request_origin(self.to)
        if self._origin_asks == _ASKS_BEFORE_SETTING + 1 and self.to.autopilot is Autopilot.ARDUPILOT:
            return [set_origin(Origin(frame.lat_rad, frame.lon_rad, frame.alt_m), self.to, t_us), asked]
        return [asked]
