"""One flight by the station: the guidance's velocities while the vehicle obeys, and a safe end whatever happens.

No I/O: states and time go in, orders come out. Before anything moves the vehicle has to be seen in the mode in which it
takes velocities. Whoever takes it out of that mode flies it from then on, and nothing more is sent. What is ended in
the air stands still by the estimate's velocity, as without GPS an autopilot's own hold drifts, until the operator ends
that too or the velocity is not known any more.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Generic, Protocol, TypeVar

from backend.fleet.telemetry import Telemetry
from backend.link.events import Autopilot
from backend.uncertainty import worst_std
from estimator.types import Float, NavigationState

MODE_WORDS = {Autopilot.ARDUPILOT: "GUIDED", Autopilot.PX4: "OFFBOARD"}
TAKEN_WITHIN_US = 6_000_000
# PX4 takes OFFBOARD only where set-points have come for a while.
STREAM_FIRST_US = 1_000_000
STALE_US = 300_000
STAND_STD_M_S = 0.5
"""Velocities known worse than this are not held by."""

Seen = TypeVar("Seen")


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


class Command(Protocol):
    """What a guidance wants flown."""

    @property
    def vel_ned_m_s(self) -> Float:
        """The set-point (3,)."""


class Guidance(Protocol):
    """What decides the velocities."""

    reason: str

    @property
    def trim_ned_m_s(self) -> Float:
        """What the autopilot's own velocity is found to be off by, (3,)."""

    def abort(self, reason: str) -> None:
        """End it for a reason."""

    def stand(self, t_us: int, vel_ned_m_s: Float | None) -> Command:
        """Stand still by a velocity (3,) over the ground, None where it is not known."""


class GuidedFlight(ABC, Generic[Seen]):
    """From the operator's word to the flight's end; ``page`` is that of the operator.

    What a kind of flight adds: what of a state it flies by (``Seen``), its guidance, and when it is over.
    """

    name: ClassVar[str]
    """What alarms and refusals call it."""
    landed_words: ClassVar[str]

    def __init__(self, autopilot: Autopilot, page: str, t_us: int, guidance: Guidance, lost_after_s: float) -> None:
        self.page = page
        self.wanted_mode = MODE_WORDS[autopilot]
        self.set_point_ned_m_s: Float | None = None
        self.reason = f"waiting for the vehicle to take {self.wanted_mode}"
        self.active = True
        self.standing = False
        self._steered = guidance
        self._lost_after_us = int(lost_after_s * 1e6)
        self._stream_first = autopilot is Autopilot.PX4
        self._began_us = self._t_us = self._state_us = t_us
        self._asked = False
        self._obeyed = False
        self._moving: Moving | None = None
        self._moving_us = t_us

    # --- what a kind of flight says ---

    @property
    @abstractmethod
    def phase(self) -> StrEnum:
        """How far it is."""

    @property
    @abstractmethod
    def landed(self) -> bool:
        """Whether it has ended on the ground where it should."""

    @property
    @abstractmethod
    def low(self) -> bool:
        """Whether it is so low that it is committed to the ground."""

    @abstractmethod
    def seen_in(self, state: NavigationState) -> Seen | None:
        """What of a state it flies by."""

    @abstractmethod
    def _steer(self, t_us: int, seen: Seen | None) -> Orders:
        """Orders of a step of the guidance; ``t_us`` does not go backwards."""

    @abstractmethod
    def _note_landed(self) -> None:
        """The vehicle says that it stands."""

    def _nobody_looks(self) -> Orders | None:
        """The operator's page has gone; None where it goes on as it is."""
        return self.stop("the operator's page has gone")

    # --- what all do ---

    @property
    def trim_ned_m_s(self) -> Float:
        """What the autopilot's own velocity is found to be off by, (3,)."""
        return self._steered.trim_ned_m_s

    def take(self, state: NavigationState, said: Telemetry) -> Orders:
        """Orders for a navigation state."""
        moving = Moving(state.vel_ned_m_s, worst_std(state.cov_vel_ned_m2_s2))
        return self.on_state(state.t_us, self.seen_in(state), moving, said)

    def on_state(self, t_us: int, seen: Seen | None, moving: Moving, said: Telemetry) -> Orders:
        """Orders for a new state; ``t_us`` is its time."""
        if not self.active:
            return NOTHING
        self._state_us = t_us
        known = moving if moving.std_m_s <= STAND_STD_M_S else None
        if known is not None:
            self._moving, self._moving_us = known, t_us
        if (end := self._watch(t_us, said)) is not None:
            return end
        return self._go_on(t_us, seen, known)

    def tick(self, t_us: int, said: Telemetry, *, page_there: bool, connected: bool) -> Orders:
        """Orders where time passes, states or none."""
        if not self.active:
            return NOTHING
        if not page_there and (end := self._nobody_looks()) is not None:
            return end
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
        if self.standing or not self._obeyed:
            return self._end(reason, Order.HOLD)
        self._steered.abort(reason)
        return self._begin_to_stand(self._state_us)

    def stop(self, reason: str) -> Orders:
        """End it where nobody looks any more: hold, or where it is so low that it is committed, land."""
        if not self.active:
            return NOTHING
        return self._end(reason, Order.LAND if self.low else Order.HOLD)

    def yield_to(self, reason: str) -> None:
        """End it without a word to the vehicle: somebody else has told it what to do."""
        if self.active:
            self._steered.abort(reason)
            self.active, self.reason = False, reason

    def _watch(self, t_us: int, said: Telemetry) -> Orders | None:
        """The end that the vehicle itself tells of."""
        if not said.armed:
            if self._obeyed and self.low:
                self._note_landed()
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

    def _go_on(self, t_us: int, seen: Seen | None, moving: Moving | None) -> Orders:
        if self.standing:
            return self._stand(t_us, moving)
        if not self._obeyed:
            return self._take_over(t_us)
        # The station's time went on while no state came: one of before is taken for now.
        self._t_us = max(t_us, self._t_us)
        return self._steer(self._t_us, seen)

    def _take_over(self, t_us: int) -> Orders:
        self._t_us = max(t_us, self._t_us)
        still = self.trim_ned_m_s * (1.0, 1.0, 0.0)
        if self._asked or (self._stream_first and t_us - self._began_us < STREAM_FIRST_US):
            return Orders(still)
        self._asked = True
        return Orders(still, Order.TAKE)

    def _begin_to_stand(self, t_us: int) -> Orders:
        self.reason = self._steered.reason
        self.standing = True
        fresh = self._moving is not None and t_us - self._moving_us < STALE_US
        return self._stand(t_us, self._moving if fresh else None)

    def _stand(self, t_us: int, moving: Moving | None) -> Orders:
        self._t_us = max(t_us, self._t_us)
        if self._t_us - self._moving_us > self._lost_after_us:
            return self._end(f"{self.reason}; then its velocity was not known any more", Order.HOLD)
        command = self._steered.stand(self._t_us, None if moving is None else moving.vel_ned_m_s)
        self.set_point_ned_m_s = command.vel_ned_m_s
        return Orders(command.vel_ned_m_s)

    def _end(self, reason: str, order: Order) -> Orders:
        self._steered.abort(reason)
        command = self._steered.stand(self._t_us, None)
        self.active, self.reason = False, reason
        self.set_point_ned_m_s = command.vel_ned_m_s
        # Where it never obeyed, whatever it does is not ours.
        return Orders(command.vel_ned_m_s, order) if self._obeyed else NOTHING
