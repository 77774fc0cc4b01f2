"""What the ground says of where a target can be: where one that stands must be, and what has stood there before.

What drives past, or has stood beside it all along, may fit a target's template, but not where the ground has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.targets.appearance import GridView
from estimator.targets.search import Look, Match, SearchArea, Searcher, likeness_by_shift, surroundings_of
from estimator.types import Float

LEAST_LIKENESS = 0.5
"""Below that the ground is not known again: too little of it shows, or the light is another."""
OLD_S, USELESS_S = 0.19, 1.0
"""From what age on a picture is put in another's place, and until what age it is compared with."""
SEARCHED_PX, SLACK_PX = 16, 5
"""How far the same ground is sought in an earlier picture, and how far from there what stood on it may be."""
ELSEWHERE = 0.2
"""Over the target's size: what is nearer to where it was may be the target itself."""
WORSE = 0.12
"""By how much what stood there may have fitted worse."""


def anchored_place(look: Look, remembered: GridView, size_px: float, about_px: Float, reach_px: int) -> Float | None:
    """Offset (2,) from the expected place at which the remembered ground has its middle, within ``reach_px`` of
    ``about_px`` (2,) in either direction and to 2 pixels of the grid; None where the ground is not known again.

    What is in the middle, ``size_px`` across, is not compared.
    """
    now = surroundings_of(look, about_px, remembered.half_px + reach_px)
    likeness, shifts = likeness_by_shift(now, remembered, math.ceil(size_px))
    best = np.unravel_index(int(likeness.argmax()), likeness.shape)
    if float(likeness[best]) < LEAST_LIKENESS:
        return None
    out: Float = about_px + shifts[best]
    return out


def found_there(
    search: Searcher, look: Look, at_px: Float, reach_px: int, turns_rad: tuple[float, ...], scale: float
) -> list[Match]:
    """What fits within ``reach_px`` of an offset (2,), but for what lies on the edge of that: there it is no peak, but
    the slope of one elsewhere."""
    matches = search.find(look, SearchArea(at_px, reach_px, turns_rad, (scale,))).matches
    return [one for one in matches if float(np.abs(one.offset_px - np.round(at_px)).max()) < reach_px - 0.5]


@dataclass(frozen=True, slots=True, eq=False)
class Before:
    """An earlier picture in which the target was seen, and its offset (2,) from the place expected then."""

    t_us: int
    look: Look
    offset_px: Float

    def old(self, t_us: int) -> bool:
        """Whether a later picture may take its place."""
        return (t_us - self.t_us) / 1e6 >= OLD_S

    def useful(self, t_us: int) -> bool:
        """Whether it can be compared with."""
        return OLD_S <= (t_us - self.t_us) / 1e6 <= USELESS_S

    def speaks_against(
        self, search: Searcher, look: Look, match: Match, step_px: Float, tolerance_px: float, half_px: int
    ) -> bool:
        """Whether the same ground showed what fits now while the target was elsewhere, or the target would have had to
        stop at once.

        ``step_px`` (2,) is the target's expected way over ground since then, ``tolerance_px`` how far from that it may
        have gone, ``half_px`` how much ground is compared.
        """
        ground = surroundings_of(look, match.offset_px, half_px)
        at = anchored_place(self.look, ground, search.appearance.size_px, match.offset_px + step_px, SEARCHED_PX)
        if at is None:
            return False
        if float(np.hypot(*(at - self.offset_px - step_px))) > tolerance_px:
            return True
        if float(np.hypot(*(at - self.offset_px))) < ELSEWHERE * search.appearance.size_px:
            return False
        return any(
            one.score >= match.score - WORSE
            and float(np.hypot(*(one.offset_px - self.offset_px))) >= ELSEWHERE * search.appearance.size_px
            for one in found_there(search, self.look, at, SLACK_PX, (match.turn_rad,), match.scale)
        )
