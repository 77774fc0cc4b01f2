"""One landing on the pad flown by the station. No I/O: see ``backend.guided.flight``."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from backend.guided.flight import GuidedFlight, Order, Orders
from backend.link.events import Autopilot
from estimator.types import NavigationState, PadRelative
from guidance.landing import LandingConfig, LandingGuidance, LandingPhase


class Descent(GuidedFlight[PadRelative]):
    """From the operator's word to the ground, or to its end.

    ``before`` is a flight of the same vehicle that goes on or stands: what that found of the autopilot's velocity is
    kept.
    """

    name: ClassVar[str] = "landing"
    landed_words: ClassVar[str] = "landed on the pad"

    def __init__(
        self, autopilot: Autopilot, page: str, t_us: int, config: LandingConfig,
        before: GuidedFlight[Any] | None = None,
    ) -> None:  # fmt: skip
        self._guidance = LandingGuidance(config, None if before is None else before.trim_ned_m_s)
        super().__init__(autopilot, page, t_us, self._guidance, config.lost_after_s)
        self._config = config
        self._low = False

    @property
    def phase(self) -> LandingPhase:
        """How far it is."""
        return LandingPhase.HOLD if self.standing and self.active else self._guidance.phase

    @property
    def landed(self) -> bool:
        """Whether it stands on the pad."""
        return self.phase is LandingPhase.LANDED

    @property
    def low(self) -> bool:
        """Whether it is below the height at which it is committed."""
        return self._low

    def seen_in(self, state: NavigationState) -> PadRelative | None:
        """Where the pad is."""
        return state.pad

    def _note_landed(self) -> None:
        self._guidance.phase = LandingPhase.LANDED

    def _steer(self, t_us: int, seen: PadRelative | None) -> Orders:
        command = self._guidance.step(t_us, seen)
        self.reason = command.reason
        self.set_point_ned_m_s = command.vel_ned_m_s
        if seen is not None and np.isfinite(seen.pos_ned_m[2]):
            height_m = -float(seen.pos_ned_m[2]) - self._config.gear_m
            self._low = self.phase is not LandingPhase.APPROACH and height_m < self._config.decision_height_m
        if not self._guidance.over:
            return Orders(command.vel_ned_m_s)
        if self._guidance.phase is LandingPhase.ABORT:
            return self._begin_to_stand(t_us)
        self.active = False
        return Orders(command.vel_ned_m_s, Order.LAND)
