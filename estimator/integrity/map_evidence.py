"""Does the map show this place? A sequential test over pictures, because one alone seldom tells.

Each registered picture says by the shape of its similarity surface how likely it is to be matched where it is not
(`registration.verify`). Summed log odds of pictures that show different ground are a sequential probability ratio test
(Wald, Sequential tests of statistical hypotheses, 1945) of "wrong map or wrong place" against "right". Over a bare
field or in a hover nothing is added, in either direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.types import Float


@dataclass(frozen=True, slots=True)
class MapEvidenceConfig:
    """``against_log_odds`` is where the map is no longer believed, and ``for_log_odds`` where it is again.

    Wald's limits for one error in twenty either way are three; the way back asks for no more than even odds, since
    what stands against the map must have been undone. The sum is held within ``limit_log_odds``, so that a long good
    flight does not delay the discovery of bad imagery. A picture says no more than ``picture_log_odds`` against the
    map: one alone does not decide. For it it may say ``picture_for_log_odds``: what no wrong map shows ends a doubt
    sooner, and each fix has tests of its own.
    """

    against_log_odds: float = 3.0
    for_log_odds: float = 0.0
    limit_log_odds: float = 6.0
    picture_log_odds: float = 2.0
    picture_for_log_odds: float = 4.0


class MapEvidence:
    """Log odds that the map, or the place on it, is wrong."""

    def __init__(self, config: MapEvidenceConfig | None = None) -> None:
        self.config = config or MapEvidenceConfig()
        self.log_odds = 0.0
        self.against = False
        self._last_ne_m: Float | None = None

    def add(self, outlier_probability: float, pos_ne_m: Float, alike_m: float) -> None:
        """A picture registered at a position (2,); pictures within ``alike_m`` say the same thing."""
        config = self.config
        odds = outlier_probability / max(1.0 - outlier_probability, 1e-9)
        said = float(np.clip(np.log(max(odds, 1e-9)), -config.picture_for_log_odds, config.picture_log_odds))
        self.log_odds += self._fresh_share(pos_ne_m, alike_m) * said
        self.log_odds = float(np.clip(self.log_odds, -config.limit_log_odds, config.limit_log_odds))
        if self.log_odds > config.against_log_odds:
            self.against = True
        elif self.log_odds < config.for_log_odds:
            self.against = False

    def _fresh_share(self, pos_ne_m: Float, alike_m: float) -> float:
        """Share of a picture that the last one has not said: (1 - r) / (1 + r) of a first-order process."""
        last, self._last_ne_m = self._last_ne_m, pos_ne_m.copy()
        if last is None:
            return 1.0
        alike = float(np.exp(-np.hypot(*(pos_ne_m - last)) / max(alike_m, 1.0)))
        return (1.0 - alike) / (1.0 + alike)
