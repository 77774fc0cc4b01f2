"""LANDING_TARGET to one vehicle's autopilot: with every state while the pad's place is known, or a word why not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from backend.fleet.vehicle import LiveVehicle
from backend.link.landing_target import TargetForm, target_in_body, target_in_local
from backend.uncertainty import worst_std
from estimator.measurements.pad_tracking import PadConfig
from estimator.types import NavigationState, PadMode

OWN_POSITION_SILENT_US = 1_000_000
# The estimator calls a pad lost by what it knew of it; a state that is carried on from there may be worse.
LANDING_STD_M = PadConfig().landing_std_m


@dataclass(slots=True)
class Aiding:
    """What was asked for one vehicle by ``page``, and how it goes; ``reason`` is empty while packets go out."""

    form: TargetForm
    page: str
    sent: int = 0
    sending: bool = False
    reason: str = "no state yet"

    def message(self, vehicle: LiveVehicle, state: NavigationState) -> Any | None:
        """What to send with a state, None when nothing is to be sent."""
        self.reason = self._objection(vehicle, state)
        self.sending = not self.reason
        pad = state.pad
        if not self.sending or pad is None:
            return None
        self.sent += 1
        own = vehicle.local_position
        if self.form is TargetForm.BODY or own is None:
            return target_in_body(state.t_us, state.q_ned_from_body, pad.pos_ned_m)
        return target_in_local(state.t_us, pad.q_ned_from_pad, pad.pos_ned_m, own)

    def silent(self, reason: str) -> None:
        """No state came, or none that can be sent."""
        self.sending, self.reason = False, reason

    def _objection(self, vehicle: LiveVehicle, state: NavigationState) -> str:
        pad, own = state.pad, vehicle.local_position
        if not vehicle.connected:
            return "the vehicle is not connected"
        if pad is None:
            return "no pad is described"
        if not pad.mode.known:
            return f"the pad is {'not found' if pad.mode is PadMode.SEARCHING else 'lost'}" + (
                f": {pad.reason}" if pad.reason else ""
            )
        std_m = worst_std(pad.cov_pos_ned_m2)
        if not std_m <= LANDING_STD_M:
            return f"the pad's place is known to {std_m:.1f} m only"
        if self.form is TargetForm.LOCAL and (own is None or abs(state.t_us - own.t_us) > OWN_POSITION_SILENT_US):
            return "the autopilot does not say where it has itself (LOCAL_POSITION_NED)"
        return ""
