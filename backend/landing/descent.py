"""One landing flown by the station: the guidance's velocities while the vehicle obeys, and a safe end whatever happens.

No I/O: states and time go in, orders come out. Before anything moves the vehicle has to be seen in the mode in which it
takes velocities. Whoever takes it out of that mode flies it from then on, and nothing more is sent. What is ended in
the air stands still by the estimate's velocity, as without GPS an autopilot's own hold drifts, until the operator ends
that too or the velocity is not known any more.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from backend.fleet.telemetry import Telemetry
from backend.link.events import Autopilot
from estimator.types import Float, PadRelative
from guidance.landing import LandingConfig, LandingGuidance, LandingPhase

MODE_WORDS = {Autopilot.ARDUPILOT: "GUIDED", Autopilot.PX4: "OFFBOARD"}
TAKEN_WITHIN_US = 6_000_000
# PX4 takes OFFBOARD only where set-points have come for a while.
STREAM_FIRST_US = 1_000_000
STALE_US = 300_000
STAND_STD_M_S = 0.5
"""Velocities known worse than this are not held by."""


class Order(StrEnum):
    """What to tell the vehicle beside a velocity: take our velocities, stay where it is, land by itself."""

    TAKE = "take"
    HOLD = "hold"
    LAND = "land"


@dataclass(frozen=True, slots=True, eq=False)
class Moving:
    """A velocity (3,) NED over the ground, and its standard deviation along the axis on which it is known worst."""

    vel_ned_m_s: Float
    std_m_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Orders:
    """A velocity (3,) NED to send, and an order; None where there is nothing to send."""

    vel_ned_m_s: Float | None = None
    order: Order | None = None


NOTHING = Orders()


class Descent:
    """From the operator's word to the ground, or to its end. ``page`` is that of the operator.

    ``before`` is one of the same vehicle that stands: what that found of the autopilot's velocity is kept.
    """

    def __init__(
        self, autopilot: Autopilot, page: str, t_us: int, config: LandingConfig, before: Descent | None = None
    ) -> None:
        self.page = page
        self.wanted_mode = MODE_WORDS[autopilot]
        self.set_point_ned_m_s: Float | None = None
        self.reason = f"waiting for the vehicle to take {self.wanted_mode}"
        self.active = True
        trim_ned_m_s = None if before is None else before.trim_ned_m_s
        self._guidance = LandingGuidance(config, trim_ned_m_s)
        self._config = config
        self._stream_first = autopilot is Autopilot.PX4
        self._began_us = self._t_us = self._state_us = t_us
        self._asked = False
        self._obeyed = False
        self._low = False
        self._standing = False
        self._moving: Moving | None = None
        self._moving_us = t_us

    @property
    def phase(self) -> LandingPhase:
        """How far it is."""
        return LandingPhase.HOLD if self._standing and self.active else self._guidance.phase

    @property
    def trim_ned_m_s(self) -> Float:
        """What the autopilot's own velocity is found to be off by, (3,)."""
        return self._guidance.trim_ned_m_s

    def on_state(self, t_us: int, pad: PadRelative | None, moving: Moving, said: Telemetry) -> Orders:
        """Orders for a new state; ``t_us`` is its time."""
        if not self.active:
            return NOTHING
        self._state_us = t_us
        known = moving if moving.std_m_s <= STAND_STD_M_S else None
        if known is not None:
            self._moving, self._moving_us = known, t_us
        if (end := self._watch(t_us, said)) is not None:
            return end
        return self._go_on(t_us, pad, known)

    def tick(self, t_us: int, said: Telemetry, *, page_there: bool, connected: bool) -> Orders:
        """Orders where time passes, states or none."""
        if not self.active:
            return NOTHING
        if not page_there:
            return self.stop("the operator's page has gone")
        if not connected:
            return self.stop("the vehicle is not connected")
        if (end := self._watch(t_us, said)) is not None:
            return end
        if t_us - self._state_us < STALE_US:
            return NOTHING
        return self._go_on(t_us, None, None)

    def abort(self, reason: str) -> Orders:
        """End it on the operator's word: stand still by the estimate; where it does already, have the vehicle hold."""
        if not self.active:
            return NOTHING
        if self._standing or not self._obeyed:
            return self._end(reason, Order.HOLD)
        self._guidance.abort(reason)
        return self._begin_to_stand(self._state_us)

    def stop(self, reason: str) -> Orders:
        """End it where nobody looks any more: hold, or where it is so low that it is committed, land."""
        if not self.active:
            return NOTHING
        return self._end(reason, Order.LAND if self._low else Order.HOLD)

    def yield_to(self, reason: str) -> None:
        """End it without a word to the vehicle: somebody else has told it what to do."""
        if self.active:
            self._guidance.abort(reason)
            self.active, self.reason = False, reason

    def _watch(self, t_us: int, said: Telemetry) -> Orders | None:
        """The end that the vehicle itself tells of."""
        if not said.armed:
            if self._obeyed and self._low:
                self._guidance.phase = LandingPhase.LANDED
                self.active, self.reason = False, ""
            else:
                self.yield_to("the vehicle is disarmed")
            return NOTHING
        if said.flight_mode == self.wanted_mode:
            self._obeyed = self._obeyed or self._asked
        elif self._obeyed:
            self.yield_to(f"the vehicle left {self.wanted_mode} for {said.flight_mode}: whoever had it do so flies it")
            return NOTHING
        elif t_us - self._began_us > TAKEN_WITHIN_US:
            self.yield_to(f"the vehicle did not take {self.wanted_mode}; it is in {said.flight_mode}")
            return NOTHING
        return None

    def _go_on(self, t_us: int, pad: PadRelative | None, moving: Moving | None) -> Orders:
        if self._standing:
            return self._stand(t_us, moving)
        return self._fly(t_us, pad) if self._obeyed else self._take(t_us)

    def _take(self, t_us: int) -> Orders:
        self._t_us = max(t_us, self._t_us)
        still = self.trim_ned_m_s * (1.0, 1.0, 0.0)
        if self._asked or (self._stream_first and t_us - self._began_us < STREAM_FIRST_US):
            return Orders(still)
        self._asked = True
        return Orders(still, Order.TAKE)

    def _fly(self, t_us: int, pad: PadRelative | None) -> Orders:
        # The station's time went on while no state came: one of before is taken for now.
        self._t_us = max(t_us, self._t_us)
        command = self._guidance.step(self._t_us, pad)
        self.reason = command.reason
        self.set_point_ned_m_s = command.vel_ned_m_s
        if pad is not None and np.isfinite(pad.pos_ned_m[2]):
            height_m = -float(pad.pos_ned_m[2]) - self._config.gear_m
            self._low = self.phase is not LandingPhase.APPROACH and height_m < self._config.decision_height_m
        if not self._guidance.over:
            return Orders(command.vel_ned_m_s)
        if self._guidance.phase is LandingPhase.ABORT:
            return self._begin_to_stand(t_us)
        self.active = False
        return Orders(command.vel_ned_m_s, Order.LAND)

    def _begin_to_stand(self, t_us: int) -> Orders:
        self.reason = self._guidance.reason
        self._standing = True
        fresh = self._moving is not None and t_us - self._moving_us < STALE_US
        return self._stand(t_us, self._moving if fresh else None)

    def _stand(self, t_us: int, moving: Moving | None) -> Orders:
        self._t_us = max(t_us, self._t_us)
        if self._t_us - self._moving_us > self._config.lost_after_s * 1e6:
            return self._end(f"{self.reason}; then its velocity was not known any more", Order.HOLD)
        command = self._guidance.stand(self._t_us, None if moving is None else moving.vel_ned_m_s)
        self.set_point_ned_m_s = command.vel_ned_m_s
        return Orders(command.vel_ned_m_s)

    def _end(self, reason: str, order: Order) -> Orders:
        self._guidance.abort(reason)
        command = self._guidance.stand(self._t_us, None)
        self.active, self.reason = False, reason
        self.set_point_ned_m_s = command.vel_ned_m_s
        # Where it never obeyed, whatever it does is not ours.
        return Orders(command.vel_ned_m_s, order) if self._obeyed else NOTHING
