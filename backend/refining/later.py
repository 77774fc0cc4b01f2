"""What comes to be known later of the states that clicks were located with: by a live estimator, by a whole flight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from backend.navigation.setup import NavigationSetup
from backend.navigation.worker import NavigationWorker
from estimator.measurements.camera_attitude import Gimbal
from estimator.navigator_config import NavigatorConfig
from estimator.smoothing import smooth
from estimator.types import NavigationState

KEPT_US = 90_000_000  # the estimator keeps its states for two minutes
BEFORE_US = 200_000
LEAST_REACH = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Hindsight:
    """States as later fixes have them: ``at`` an exposure, None where that is not known.

    ``is_final`` says that nothing will move the state of a time any more.
    """

    at: Callable[[int], NavigationState | None]
    is_final: Callable[[int], bool]


class LaterFixes(Protocol):
    """Where hindsight on the states of clicks comes from. Clicks of one source are equal in it."""

    def expects_more(self, age_us: int, /) -> bool:
        """Whether it may still have something to say of a click so long ago."""

    def hindsight(self, first_us: int, setup: NavigationSetup, /) -> Hindsight | None:
        """On the states from a time on; None while there is none. Takes up to a second: not for the event loop."""


@dataclass(frozen=True, slots=True)
class LiveFixes:
    """Of a live estimator: what it has measured since, carried back by a smoother."""

    worker: NavigationWorker

    def expects_more(self, age_us: int, /) -> bool:
        """As long as the estimator keeps its states."""
        return age_us < KEPT_US

    def hindsight(self, first_us: int, setup: NavigationSetup, /) -> Hindsight | None:
        """By the fixes so far."""
        kept = [each for each in self.worker.corrected() if each.after.t_us >= first_us - BEFORE_US]
        smoothed = smooth(kept, NavigatorConfig().noise)
        fixed = setup.gimbal == Gimbal.FIXED
        return Hindsight(
            lambda t_us: smoothed.at(t_us, setup.frame, camera_is_fixed=fixed),
            lambda t_us: smoothed.reach_at(t_us) < LEAST_REACH,
        )
