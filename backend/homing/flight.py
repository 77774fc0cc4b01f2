"""One flight home by the station. No I/O: see ``backend.guided.flight``."""

from __future__ import annotations

from typing import ClassVar, Literal

from backend.guided.flight import GuidedFlight, Order, Orders
from backend.link.events import Autopilot
from backend.uncertainty import worst_std
from estimator.geometry.rotation import euler_from_q
from estimator.types import Mode, NavigationState, PadMode
from guidance.homing import HomingEstimate, HomingGuidance, HomingPhase

PAD_FOLLOWED_US = 1_500_000
"""So long must the pad be followed before the landing is flown by it."""

WhenLost = Literal["hold", "land"]


class HomeFlight(GuidedFlight[HomingEstimate]):
    """From the operator's word until it stands at home, or to its end.

    An estimate that stays lost ends it as ``when_lost`` says: the autopilot holds by itself, or lands where it is.
    """

    name: ClassVar[str] = "homing"
    landed_words: ClassVar[str] = "landed at home"

    def __init__(
        self, autopilot: Autopilot, page: str, t_us: int, guidance: HomingGuidance, when_lost: WhenLost = "hold"
    ) -> None:
        self.guidance = guidance
        self.when_lost = when_lost
        super().__init__(autopilot, page, t_us, guidance, guidance.config.lost_after_s)
        self._pad_since_us: int | None = None
        self.pad_followed = False

    @property
    def phase(self) -> HomingPhase:
        """How far it is."""
        return HomingPhase.HOLD if self.standing and self.active else self.guidance.phase

    @property
    def landed(self) -> bool:
        """Whether it stands at home."""
        return self.guidance.phase is HomingPhase.LANDED

    @property
    def low(self) -> bool:
        """Whether it goes down whatever is seen."""
        return self.guidance.phase in (HomingPhase.TOUCHDOWN, HomingPhase.LANDED)

    def seen_in(self, state: NavigationState) -> HomingEstimate:
        """The place, and how long the pad has been followed."""
        followed = state.pad is not None and state.pad.mode is PadMode.TRACKING
        if not followed:
            self._pad_since_us = None
        elif self._pad_since_us is None:
            self._pad_since_us = state.t_us
        since_us = self._pad_since_us
        self.pad_followed = since_us is not None and state.t_us - since_us >= PAD_FOLLOWED_US
        return estimate_of(state)

    def _note_landed(self) -> None:
        self.guidance.phase = HomingPhase.LANDED

    def _nobody_looks(self) -> Orders | None:
        # By vision it stands; left to its autopilot without GPS it would drift away.
        if self.standing:
            return None
        reason = "the operator's page has gone"
        return self.stop(reason) if self.low else self.abort(reason)

    def _steer(self, t_us: int, seen: HomingEstimate | None) -> Orders:
        command = self.guidance.step(t_us, seen)
        self.reason = command.reason
        self.set_point_ned_m_s = command.vel_ned_m_s
        if not self.guidance.over:
            return Orders(command.vel_ned_m_s)
        if self.guidance.phase is HomingPhase.LANDED:
            self.active = False
            return Orders(command.vel_ned_m_s, Order.LAND)
        return self._end(self.guidance.reason, Order.LAND if self.when_lost == "land" else Order.HOLD)


def estimate_of(state: NavigationState) -> HomingEstimate:
    """What a flight home needs of a state."""
    return HomingEstimate(
        pos_ned_m=state.pos_ned_m, vel_ned_m_s=state.vel_ned_m_s, std_m=worst_std(state.cov_pos_ned_m2[:2, :2]),
        std_m_s=worst_std(state.cov_vel_ned_m2_s2), yaw_rad=float(euler_from_q(state.q_ned_from_body)[2]),
        alt_agl_m=state.alt_agl_m, lost=state.mode is Mode.LOST,
    )  # fmt: skip
