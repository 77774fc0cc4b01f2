"""Hypotheses of where a mosaic lies, in competition: each is followed over ground that took no part in its search.

Of a hundred million places the best owes much to chance, and so says little of itself. Pieces of ground that were not
searched, laid before or after, are independent of that choice: a sequential probability ratio test (Wald 1945) over
them drops the hypotheses one by one. One is accepted when enough pieces agree with one consistent track, and when it
leads every other place by far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from estimator.geometry.rotation import wrap_pi
from estimator.measurements.hypothesis import Fit, FollowConfig, Ground, Piece, first_fit, followed
from estimator.odometry.mosaic import Mosaic
from estimator.registration.global_search import Place, SearchConfig, Slice, template_of
from estimator.registration.near_match import NearMatcher


@dataclass(frozen=True, slots=True)
class ContestConfig:
    """Whom to drop and whom to believe.

    A hypothesis is dropped at ``reject_log_ratio``. When a new search brings others, those that have come to
    ``promising_log_ratio`` stay, ``max_promising`` of them. One is accepted with ``accept_log_ratio`` in all, when
    ``min_pieces`` pieces spoke for it and it leads all that lie elsewhere, by ``alike_m``, by ``lead_log_ratio``.
    """

    follow: FollowConfig = field(default_factory=FollowConfig)
    max_candidates: int = 80
    max_promising: int = 40
    reject_log_ratio: float = -5.0
    promising_log_ratio: float = 2.0
    accept_log_ratio: float = 12.0
    lead_log_ratio: float = 6.0
    min_pieces: int = 4
    alike_m: float = 40.0
    alike_rad: float = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class GroundSeen:
    """Ground of one stretch of the way that was not seen before it; mean heights as `Piece` has them."""

    fresh: Mosaic
    piece: Piece
    height_m: float
    pressure_alt_m: float


@dataclass(slots=True, eq=False)
class Searched:
    """What was searched: a mosaic of the stretches ``first`` to ``last``; the earlier ones without its ground."""

    mosaic: Mosaic
    first: int
    last: int
    behind: dict[int, Piece | None] = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class Contender:
    """One hypothesis: followed ahead and behind from what was searched, each to the next stretch to compare."""

    searched: Searched
    ahead: Fit
    behind: Fit
    next_ahead: int
    next_behind: int
    log_ratio: float
    agreeing: int = 0
    compared: int = 0
    refuted: bool = False


def piece_of(
    mosaic: Mosaic, height_m: float, pressure_alt_m: float, matcher: NearMatcher, search: SearchConfig
) -> Piece | None:
    """What can be compared of a mosaic's ground; None where that is too little."""
    if mosaic.area_m2 < (4.0 * matcher.map.cell_m) ** 2:
        return None
    template = template_of(mosaic.image, mosaic.known, mosaic.gsd_m, matcher.map.cell_m, search)
    if not template.known.any():
        return None
    clutter = matcher.clutter(template, 1.0)
    if clutter is None:
        return None
    return Piece(template, mosaic.place_m(template.centre_px), height_m, pressure_alt_m, clutter)


def log_priors(count: int) -> list[float]:
    """What the rank of each of the places of a search says of it, as the logarithm of a likelihood ratio.

    A true place that is among them has rank k, from zero, about as often as 1 / (k + 2); a false one any rank alike.
    """
    weight = 1.0 / (np.arange(count) + 2.0)
    return [float(value) for value in np.log(count * weight / weight.sum())]


class Contenders:
    """The hypotheses that are left, and the ground they are compared on."""

    def __init__(self, matcher: NearMatcher, ground: Ground, search: SearchConfig, config: ContestConfig) -> None:
        self.config = config
        self.left: list[Contender] = []
        self._matcher = matcher
        self._ground = ground
        self._search = search
        self._seen: list[GroundSeen] = []

    @property
    def stretches(self) -> int:
        """How many stretches of ground have been seen."""
        return len(self._seen)

    @property
    def best(self) -> Contender | None:
        """The one for which most speaks."""
        return max(self.left, key=lambda one: one.log_ratio, default=None)

    def heights(self, first: int, last: int) -> tuple[float, float]:
        """Mean height in the mosaic and mean pressure altitude of some stretches."""
        seen = self._seen[first : last + 1]
        return float(np.mean([one.height_m for one in seen])), float(np.mean([one.pressure_alt_m for one in seen]))

    def forget(self) -> None:
        """Begin anew."""
        self.left.clear()
        self._seen.clear()

    def see(self, seen: GroundSeen) -> None:
        """Take another stretch of ground."""
        self._seen.append(seen)

    def propose(self, places: Sequence[Place], searched: Searched, centre_m: complex) -> None:
        """Take the places that a search found for its mosaic's centre; those who promise nothing make room.

        A place is a hypothesis of its own even where one is followed already: that may have drifted, and the search
        says where it really is. Of such neighbours the better is left by the next search.
        """
        self.left = self._promising(centre_m)
        height_m, alt_m = self.heights(searched.first, searched.last)
        for place, log_prior in zip(places, log_priors(len(places)), strict=True):
            ne = complex(place.centre_ne_m[0], place.centre_ne_m[1])
            what = Slice(place.heading_rad, place.scale)
            fit = first_fit(ne, what, (centre_m, height_m, alt_m), self._ground, self.config.follow)
            self.left.append(Contender(searched, fit, fit, searched.last + 1, searched.first - 1, log_prior))

    def _promising(self, mosaic_m: complex) -> list[Contender]:
        """Those worth keeping, the best first, and of several that put a place of the mosaic alike only the best."""
        kept: list[Contender] = []
        for one in sorted(self.left, key=lambda one: -one.log_ratio):
            if one.log_ratio < self.config.promising_log_ratio or len(kept) == self.config.max_promising:
                break
            ne_m, turn_rad = one.ahead.ne_m(mosaic_m), one.ahead.turn_rad
            if not any(self._at(better.ahead, mosaic_m, ne_m, turn_rad) for better in kept):
                kept.append(one)
        return kept

    def _at(self, fit: Fit, mosaic_m: complex, ne_m: complex, turn_rad: float) -> bool:
        """Whether a fit puts a place of the mosaic there, turned like that."""
        near = abs(fit.ne_m(mosaic_m) - ne_m) < self.config.alike_m
        return near and abs(wrap_pi(fit.turn_rad - turn_rad)) < self.config.alike_rad

    def step(self) -> bool:
        """Compare one hypothesis on one more piece of ground; False where all has been compared."""
        for one in self.left:
            if one.next_ahead < len(self._seen):
                one.ahead = self._compared(one, one.ahead, self._seen[one.next_ahead].piece)
                one.next_ahead += 1
            elif one.next_behind >= 0:
                piece = self._piece_behind(one.searched, one.next_behind)
                if piece is not None:
                    one.behind = self._compared(one, one.behind, piece)
                one.next_behind -= 1
            else:
                continue
            if one.refuted:
                self.left.remove(one)
            return True
        return False

    def _piece_behind(self, searched: Searched, index: int) -> Piece | None:
        if index not in searched.behind:
            seen = self._seen[index]
            rest = seen.fresh.without(searched.mosaic)
            enough = rest.area_m2 >= 0.5 * seen.fresh.area_m2
            searched.behind[index] = (
                piece_of(rest, seen.height_m, seen.pressure_alt_m, self._matcher, self._search) if enough else None
            )
        return searched.behind[index]

    def _compared(self, one: Contender, fit: Fit, piece: Piece) -> Fit:
        answer = followed(fit, piece, self._matcher, self._ground, self.config.follow)
        if answer is None:
            one.refuted = True
            return fit
        after, gain = answer
        one.log_ratio += gain
        one.compared += 1
        one.agreeing += gain > 0.0
        one.refuted = one.log_ratio <= self.config.reject_log_ratio
        return after

    def accepted(self, now_m: complex) -> Contender | None:
        """The one that is to be believed, with the camera at a place of the mosaic; None while none is."""
        best, config = self.best, self.config
        if best is None or best.log_ratio < config.accept_log_ratio or best.agreeing < config.min_pieces:
            return None
        here = best.ahead.ne_m(now_m)
        rivals = [one for one in self.left if not self._at(one.ahead, now_m, here, best.ahead.turn_rad)]
        if any(one.log_ratio > best.log_ratio - config.lead_log_ratio for one in rivals):
            return None
        return best
