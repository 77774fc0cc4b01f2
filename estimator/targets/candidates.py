"""What may be a target that was lost, over several pictures.

A candidate that was seen once is looked for where it should be next, whatever else the picture shows: a car that
drives then is a chain of places, and what stands takes no room among what is looked at closely for the first time.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from estimator.targets.appearance import GridView
from estimator.targets.search import Look, Match, Place, likeness_by_shift, surroundings_of
from estimator.targets.tracker_config import TrackerConfig
from estimator.types import Float

BEND_PICTURES = 6


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A place that looks like the target: what speaks for it in natural log units, how its surroundings fit (NaN: not
    asked), and where it is on the ground relative to the expected place, metres right and down of the grid."""

    match: Match
    evidence: float
    surroundings: float
    offset_m: Float


@dataclass(frozen=True, slots=True, eq=False)
class Going:
    """How the target is expected to go: velocity (2,), metres a second right and down on the grid, its standard
    deviation, whether it is known to move, and whether it has been away for long enough to have turned about."""

    vel_m_s: Float
    std_m_s: float
    moving: bool
    long_away: bool = False


@dataclass(slots=True, eq=False)
class Chain:
    """One candidate over several pictures; ``path_m`` (n, 2) is its way over ground, on the grid's axes, and ``about``
    what was about it in each."""

    times_us: list[int]
    candidates: list[Candidate]
    path_m: list[Float]
    about: list[GridView]

    def forget_before(self, t_us: int) -> None:
        """Drop what is older, but for the last two."""
        count = min(sum(t < t_us for t in self.times_us), len(self.times_us) - 2)
        del self.times_us[:count], self.candidates[:count], self.path_m[:count], self.about[:count]

    @property
    def last_us(self) -> int:
        """Of the last picture with it."""
        return self.times_us[-1]

    @property
    def span_s(self) -> float:
        """From the first to the last."""
        return (self.times_us[-1] - self.times_us[0]) / 1e6

    @property
    def evidence(self) -> float:
        """Mean of what speaks for it, natural log units."""
        return float(np.mean([c.evidence for c in self.candidates]))

    @property
    def score(self) -> float:
        """Mean of how it fits."""
        return float(np.mean([c.match.score for c in self.candidates]))

    def velocity_m_s(self) -> Float:
        """Least-squares velocity (2,) over ground, right and down on the grid."""
        t = (np.array(self.times_us) - self.times_us[0]) / 1e6
        t = t - t.mean()
        out: Float = t @ np.array(self.path_m) / max(float(t @ t), 1e-9)
        return out

    def unevenness_m(self) -> float:
        """Median distance of the places from even motion, or in many pictures from a bend: one that is laid the wrong
        way round is let pass."""
        t = (np.array(self.times_us) - self.times_us[0]) / 1e6
        basis = np.vander(t - t.mean(), 3 if len(t) >= BEND_PICTURES else 2)
        path = np.array(self.path_m)
        left = path - basis @ np.linalg.lstsq(basis, path, rcond=None)[0]
        return float(np.median(np.hypot(*left.T)))

    def turn_step_rad(self) -> float:
        """The greatest turn from one to the next; front and back look much alike."""
        turns = [one.match.turn_rad for one in self.candidates]
        return max((abs(math.remainder(b - a, math.pi)) for a, b in itertools.pairwise(turns)), default=0.0)


class Pursuit:
    """All candidates for one target since it was lost, and what each of them does."""

    def __init__(self, config: TrackerConfig) -> None:
        self.config = config
        self.chains: list[Chain] = []
        self.ground_m_s = np.zeros(2)
        self._refuted: list[tuple[int, Float]] = []
        self._t_us = 0

    def clear(self) -> None:
        """Forget all."""
        self.chains, self._refuted, self.ground_m_s = [], [], np.zeros(2)

    def places(self, going: Going, t_us: int, m_per_px: float) -> tuple[list[Place], list[Float]]:
        """Where candidates should be now, the likeliest first, and places (2,) that were of no use a moment ago."""
        c = self.config
        self.chains = [chain for chain in self.chains if (t_us - chain.last_us) / 1e6 <= c.lost_after_s]
        self._refuted = [(t, at) for t, at in self._refuted if (t_us - t) / 1e6 <= c.refuted_s]
        going_on = sorted((one for one in self.chains if not self._stands(one)), key=lambda one: -one.score)
        standing = sorted((one for one in self.chains if self._stands(one)), key=lambda one: -one.score)
        out = []
        for chain in [*standing[: c.standing], *going_on[: c.pursued - c.standing]]:
            expected, reach_m = self._next(chain, going, t_us)
            match = chain.candidates[-1].match
            out.append(Place(expected / m_per_px, math.ceil(min(reach_m, c.pursued_m) / m_per_px), match.turn_rad))
        skip = [at - going.vel_m_s * ((t_us - t) / 1e6) for t, at in self._refuted]
        skip += [self._next(chain, going, t_us)[0] for chain in standing[c.standing :]]
        return out, [at / m_per_px for at in skip]

    def _stands(self, chain: Chain) -> bool:
        """Whether a candidate has hardly moved for so long that it will not be one that drives."""
        if len(chain.times_us) < self.config.moving_pictures:
            return False
        return float(np.hypot(*chain.velocity_m_s())) * chain.span_s < 0.5 * self.config.least_way_m

    def refute(self, offsets_m: list[Float], t_us: int) -> None:
        """Places on the ground, relative to the expected one, that showed nothing like the target."""
        self._refuted += [(t_us, at) for at in offsets_m]

    def _next(self, chain: Chain, going: Going, t_us: int) -> tuple[Float, float]:
        """Offset (2,) from the expected place, metres, at which a candidate should be, and how far about it."""
        c, gap_s = self.config, (t_us - chain.last_us) / 1e6
        here: Float = chain.candidates[-1].offset_m - going.vel_m_s * gap_s
        if len(chain.times_us) > 1:
            return here + chain.velocity_m_s() * gap_s, c.chain_m + 4.0 * gap_s
        # either as the target should go, or as what stands, or the other way
        fastest = float(np.hypot(*going.vel_m_s)) + (c.gate_sigmas * going.std_m_s if going.moving else 0.0)
        return here, c.chain_m + min(fastest, c.fastest_m_s) * gap_s

    def extend(self, found: list[Candidate], going: Going, look: Look, half_px: int, t_us: int) -> None:
        """Add candidates to the chains whose place they share, and begin chains for the rest.

        ``half_px`` is how far about one that drives is remembered.
        """
        c = self.config

        def about(one: Candidate) -> GridView:
            return surroundings_of(look, one.match.offset_px, half_px if going.moving else 1)

        taken: set[int] = set()
        for chain in sorted(self.chains, key=lambda one: (-len(one.times_us), -one.evidence)):
            expected, reach_m = self._next(chain, going, t_us)
            options = [
                (float(np.hypot(*(one.offset_m - expected))), k) for k, one in enumerate(found) if k not in taken
            ]
            options = [option for option in options if option[0] <= reach_m]
            if options:
                k = min(options)[1]
                taken.add(k)
                gap_s = (t_us - chain.last_us) / 1e6
                step = found[k].offset_m - chain.candidates[-1].offset_m + going.vel_m_s * gap_s
                chain.path_m.append(chain.path_m[-1] + step)
                chain.candidates.append(found[k])
                chain.times_us.append(t_us)
                chain.about.append(about(found[k]))
                chain.forget_before(t_us - round(c.judged_s * 1e6))
        self.chains += [
            Chain([t_us], [one], [np.zeros(2)], [about(one)]) for k, one in enumerate(found) if k not in taken
        ]
        self.chains = [chain for chain in self.chains if (t_us - chain.last_us) / 1e6 <= c.lost_after_s]
        self.ground_m_s = self._ground_velocity()

    def rivals(self, going: Going, course_0: float) -> list[tuple[float, Chain]]:
        """Candidates that may be the target with all that speaks for them, best first."""
        may = [chain for chain in self.chains if not going.moving or self.goes_as(chain, going, course_0)]
        return sorted(((self.weight(chain, going), chain) for chain in may), key=lambda pair: -pair[0])

    def right_way_round(self, chain: Chain, course_0: float) -> Candidate:
        """The last of a chain's candidates, with front and back as it moves."""
        one, turn = chain.candidates[-1], self._turn_as_it_goes(chain, course_0)
        if not np.isfinite(turn):
            return one
        if abs(math.remainder(turn - one.match.turn_rad, 2.0 * math.pi)) < 0.5 * math.pi:
            return one
        return replace(one, match=replace(one.match, turn_rad=one.match.turn_rad + math.pi))

    def _turn_as_it_goes(self, chain: Chain, course_0: float) -> float:
        """By how much a candidate must have turned since the click, by its course; NaN where that of then is not
        known."""
        right, down = chain.velocity_m_s() - self.ground_m_s
        return math.atan2(right, -down) - course_0

    def drives_as_expected(self, chain: Chain, going: Going) -> bool:
        """Whether a candidate has come so far, and so much as the target was going, that it is a car at least."""
        off = float(np.hypot(*(chain.velocity_m_s() - self.ground_m_s - going.vel_m_s)))
        far = float(np.hypot(*chain.path_m[-1])) >= self.config.long_way_m
        return far and off < going.std_m_s + self.config.speed_std_m_s

    def _ground_velocity(self) -> Float:
        """How fast (2,) what stands seems to move, from the candidates that hardly do: the pose's error changes, and
        other ground lies at other heights."""
        slow = [chain.velocity_m_s() for chain in self.chains if len(chain.times_us) >= self.config.find_pictures]
        slow = [vel for vel in slow if float(np.hypot(*vel)) < self.config.parked_m_s]
        out: Float = np.median(slow, axis=0) if len(slow) >= 2 else np.zeros(2)
        return out

    def goes_as(self, chain: Chain, going: Going, course_0: float) -> bool:
        """Whether a candidate moves over ground, and no otherwise than the target may."""
        if len(chain.times_us) < 2:
            return False
        c = self.config
        right, down = chain.velocity_m_s() - self.ground_m_s
        # what stands high seems to creep, but not far
        way_m = float(np.hypot(right, down)) * chain.span_s
        if way_m < c.least_way_m or self.speed_sigmas(chain, going) > c.speed_sigmas:
            return False
        if chain.unevenness_m() > min(c.uneven_m, c.uneven_share * way_m) or chain.turn_step_rad() > c.turn_step_rad:
            return False
        turn = self._turn_as_it_goes(chain, course_0)
        if not np.isfinite(turn):
            return True
        # a car goes where it looks: its turn since the click is that of its course; front and back look much alike
        off = [abs(math.remainder(turn - one.match.turn_rad, math.pi)) for one in chain.candidates]
        return float(np.median(off)) < c.course_off_rad

    def leaves_its_place(self, chain: Chain, look: Look, m_per_px: float, size_px: float) -> bool:
        """Whether a candidate moves over what is about it: what lies higher or lower than is thought seems to move as
        well, but together with all about it."""
        c, then = self.config, chain.about[0]
        way = (chain.path_m[-1] - chain.path_m[0]) / m_per_px
        least = c.least_way_m / m_per_px
        reach = math.ceil(float(np.hypot(*way)) + least)
        before = chain.candidates[-1].match.offset_px - way
        now = surroundings_of(look, before, then.half_px + reach)
        likeness, shifts = likeness_by_shift(now, then, math.ceil(0.6 * size_px))
        with_it = np.hypot(*np.moveaxis(shifts - way, -1, 0)) < least
        creeps = np.hypot(shifts[..., 0], shifts[..., 1]) * m_per_px <= 0.5 + c.parked_m_s * chain.span_s
        if not (creeps & ~with_it).any():
            return False
        return float(likeness[creeps & ~with_it].max()) > float(likeness[with_it].max()) + c.likelier

    def speed_sigmas(self, chain: Chain, going: Going) -> float:
        """How far a candidate's velocity lies from the target's, over the standard deviation of that.

        One that has been away for long may have turned about or stopped, at a price.
        """
        c, std_m_s = self.config, going.std_m_s + self.config.speed_std_m_s
        vel = chain.velocity_m_s() - self.ground_m_s
        if not going.long_away:
            return float(np.hypot(*(vel - going.vel_m_s))) / std_m_s
        std_m_s = math.hypot(std_m_s, c.any_speed_m_s)
        off = float(np.hypot(*(vel - going.vel_m_s))) / std_m_s
        slower, back = (float(np.hypot(*(vel - k * going.vel_m_s))) / std_m_s for k in (0.0, -1.0))
        return min(off, math.hypot(min(slower, back), c.about_sigmas))

    def weight(self, chain: Chain, going: Going) -> float:
        """All that speaks for a candidate: as it was seen, and as it moves."""
        if not going.moving or len(chain.times_us) < 2:
            return chain.evidence
        return chain.evidence - 0.5 * self.speed_sigmas(chain, going) ** 2
