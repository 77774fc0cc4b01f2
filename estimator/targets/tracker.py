"""Follows what an operator clicked from picture to picture, says when it is lost, and finds it again.

The search takes place on a north-up grid of the ground, onto which each picture is laid with the known motion of the
camera, so that scale, rotation and slant are gone before anything is compared, and only a target's own turning is left
to try. The expected place with its covariance bounds the search. What comes back after a loss is a candidate first: it
must keep its place relative to the expected one over several pictures, as the target itself would, fit better than
anything else about, and, of a target that stood, have the same surroundings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from estimator.targets.appearance import RING_PX, Appearance, GridView, grid_from_picture, square_about
from estimator.targets.candidates import Candidate, Chain
from estimator.targets.search import (
    APART,
    TURN_STEP_RAD,
    WIDE_STEP_RAD,
    Look,
    Match,
    SearchArea,
    Searcher,
    affine_from_grid,
    picture_from_grid,
    surroundings_fit,
)  # fmt: skip
from estimator.targets.view import PICTURE_UPRIGHT, ExpectedView
from estimator.types import Float, Image

MIN_PICTURE_PX = 32


class CannotFollowError(ValueError):
    """A click that no tracker can start from: where it is, or what it shows, is not enough."""


@dataclass(frozen=True, slots=True)
class TrackerConfig:
    """Sizes in pixels of the grid, scores in [-1, 1], times in seconds.

    Attributes
    ----------
    size_m, size_px, most_size_px
        A target's greatest extent where the start does not say: metres where the scale is known, pixels of the picture
        otherwise; and what it has on the grid at most.
    keep_score, find_score, worse
        What a target in sight must fit; what one that was lost must, and by how much at most it may fit worse than
        usual.
    find_pictures, find_s, find_moving_s, judged_s
        In how many pictures and over what time it must be seen before it is found; of one that drives; and how far
        back candidates are judged by.
    margin
        By how many natural log units it must lead whatever else fits.
    least_speed_m_s, least_speed_share, speed_std_m_s, speed_sigmas, uneven_m, course_off_rad, parked_m_s
        How one that drives must move: at least so fast, or that share of the expected speed; its velocity, measured so
        well, within so many standard deviations; so evenly; along its long axis. What seems slower than the last is
        taken to stand, and tells how fast what stands seems to move.
    surroundings, surroundings_sizes
        The correlation that the surroundings of one that stands must reach, and how far they reach, in its sizes.
    score_std
        The score's standard deviation: what a difference in score is worth.
    gate_sigmas, most_reach_m, chain_m
        How far from the expected place is searched, in standard deviations and at most; and what a candidate may jump.
    lost_after_s, least_std_px, candidates
        When it is lost; the least standard deviation of a place on the grid; how many places are looked at closely.
    """

    size_m: float = 5.0
    size_px: float = 32.0
    most_size_px: float = 36.0
    keep_score: float = 0.45
    find_score: float = 0.58
    find_pictures: int = 3
    find_s: float = 0.3
    find_moving_s: float = 0.75
    least_speed_m_s: float = 1.5
    least_speed_share: float = 0.6
    speed_std_m_s: float = 0.7
    speed_sigmas: float = 2.0
    judged_s: float = 1.2
    most_reach_m: float = 60.0
    parked_m_s: float = 3.5
    chain_m: float = 0.8
    uneven_m: float = 0.45
    course_off_rad: float = 0.55
    worse: float = 0.13
    margin: float = 3.0
    surroundings: float = 0.40
    surroundings_sizes: float = 1.8
    score_std: float = 0.07
    gate_sigmas: float = 3.0
    lost_after_s: float = 0.7
    least_std_px: float = 0.35
    candidates: int = 6

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                message = f"{name} must be positive and finite, not {getattr(self, name)}"
                raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """The target in a picture: pixel (2,) of what was clicked, covariance (2, 2).

    ``confidence`` in [0, 1] is how probably it is the target, ``score`` in [-1, 1] how well it fits, ``turn_rad`` how
    far it has turned clockwise since the click, ``found_again`` whether it had been lost before.
    """

    t_us: int
    uv_px: Float
    cov_px2: Float
    confidence: float
    score: float
    turn_rad: float
    found_again: bool


@dataclass(frozen=True, slots=True)
class Lost:
    """No target in this picture, and why. ``last_seen_us`` is of the last sighting."""

    t_us: int
    reason: str
    last_seen_us: int


OUTSIDE, NOT_SEEN, UNSURE, ALIKE = "outside the picture", "not seen", "not sure yet", "several look alike"


class TargetTracker:
    """A tracker of one target. ``start`` makes one; ``update`` takes each picture after that."""

    def __init__(
        self, appearance: Appearance, m_per_grid_px: float, t_us: int, uv_px: Float, px_per_m: Float,
        course_rad: float, surroundings: GridView, config: TrackerConfig,
    ) -> None:  # fmt: skip
        self.config = config
        self.appearance = appearance
        self.last_seen_us = t_us
        self._search = Searcher(appearance, config.candidates, 0.6 * config.keep_score, config.least_std_px)
        self._m = m_per_grid_px
        self._t_us = t_us
        self._uv, self._px_per_m = uv_px, px_per_m
        self._drift_px_s = np.zeros(2)
        self._offset_m = np.zeros(2)
        self._turn, self._scale, self._gain = 0.0, 1.0, 1.0
        self._course_0 = course_rad
        self._surroundings = surroundings
        self._usual = 0.8
        self._ground_m_s = np.zeros(2)
        self._chains: list[Chain] = []
        self._lost = False

    @classmethod
    def start(
        cls, image: Image, uv_px: Float, t_us: int, px_per_m: Float | None = None, size_px: float | None = None,
        course_rad: float = float("nan"), config: TrackerConfig | None = None,
    ) -> TargetTracker:  # fmt: skip
        """Start on what a pixel shows.

        Parameters
        ----------
        image
            Grey (rows, cols) or BGR (rows, cols, 3), uint8.
        uv_px
            The pixel (2,) clicked, as near the target's middle as the operator can.
        px_per_m
            (2, 2): pixels per metre north and east at the target (``ExpectedView.px_per_m``). Without it the camera's
            motion is not known, and ``update`` is to be called without expected views.
        size_px
            The target's greatest extent in this picture; that of ``config.size_m`` where that can be told, otherwise
            ``config.size_px``.
        course_rad
            The target's course, clockwise from north, where it is known to move.

        Raises
        ------
        CannotFollowError
            The click lies outside the picture or too near its border, or shows nothing that could be told from the
            ground.
        ValueError
            The picture is none.
        """
        config = config or TrackerConfig()
        picture = checked_picture(image)
        uv = np.asarray(uv_px, dtype=np.float64)
        if uv.shape != (2,) or not np.isfinite(uv).all():
            message = f"a click is two finite numbers, not {uv_px}"
            raise CannotFollowError(message)
        jacobian = PICTURE_UPRIGHT if px_per_m is None else np.asarray(px_per_m, dtype=np.float64)
        density = math.sqrt(abs(float(np.linalg.det(jacobian))))
        if jacobian.shape != (2, 2) or not (np.isfinite(density) and density > 1e-3):
            message = "px_per_m must be (2, 2), finite and not singular"
            raise ValueError(message)
        extent = size_px if size_px is not None else (config.size_px if px_per_m is None else config.size_m * density)
        if not 6.0 <= extent <= 0.5 * min(picture.shape[:2]):
            message = (
                f"a target of {extent:.0f} pixels cannot be followed: 6 at least, half the picture's height at most"
            )
            raise CannotFollowError(message)
        size = min(extent, config.most_size_px)
        metres = extent / density / size
        half = math.ceil(size) + RING_PX
        grid = grid_from_picture(picture, affine_from_grid(uv, jacobian, metres), square_about(half))
        middle = slice(half - round(0.5 * size), half + round(0.5 * size) + 1)
        if not grid.known[middle, middle].all():
            message = (
                f"the click at ({uv[0]:g}, {uv[1]:g}) is too near the border of the picture: the target is cut off"
            )
            raise CannotFollowError(message)
        if float(grid.image.reshape(-1, 3).std(axis=0).max()) < 2.0:
            message = "there is nothing at the click that could be told from the ground"
            raise CannotFollowError(message)
        reach = round(config.surroundings_sizes * size)
        around = grid_from_picture(picture, affine_from_grid(uv, jacobian, metres), square_about(reach))
        return cls(Appearance(grid.image, size), metres, t_us, uv, jacobian, course_rad, around, config)

    @property
    def lost(self) -> bool:
        """Whether the next sighting must first be verified."""
        return self._lost

    def update(self, image: Image, t_us: int, expected: ExpectedView | None = None) -> Sighting | Lost:
        """Look for the target in the next picture.

        Without ``expected`` it is searched where it was last, going on as it went. Raises ValueError where the picture
        is none or is older than the last one.
        """
        picture = checked_picture(image)
        if t_us < self._t_us:
            message = f"pictures must come in order: {t_us} us is before {self._t_us} us"
            raise ValueError(message)
        dt_s = (t_us - self._t_us) / 1e6
        self._t_us = t_us
        if (t_us - self.last_seen_us) / 1e6 > self.config.lost_after_s and not self._lost:
            self._lost, self._chains = True, []
        view = expected if expected is not None else self._guess(picture, t_us)
        look = Look(picture, picture_from_grid(view, self._m), self._gain)
        centre, cov = self._where(look, view, t_us)
        reach = math.ceil(self.config.gate_sigmas * math.sqrt(float(np.linalg.eigvalsh(cov)[-1]))) + 2
        reach = min(reach, math.ceil(self.config.most_reach_m / self._m) if expected is not None else reach)
        limit = np.array([picture.shape[1], picture.shape[0]], dtype=np.float64)
        beyond = np.maximum(np.maximum(-look.pixel(centre), look.pixel(centre) - limit), 0.0)
        if float(np.hypot(*beyond)) > reach * self._density(view):
            self._chains = []
            return Lost(t_us, OUTSIDE, self.last_seen_us)
        scales = (1.0,) if expected is not None or self._lost else (0.95, 1.0, 1.05)
        area = SearchArea(centre, reach, self._turns(view), tuple(self._scale * s for s in scales), self._lost)
        found = self._weighed(look, view, self._search.find(look, area), centre, cov)
        return self._find(found, view, look, t_us, dt_s) if self._lost else self._keep(found, view, look, t_us)

    def _guess(self, picture: Image, t_us: int) -> ExpectedView:
        """Where the target should be when nobody says: as far on as it went, and ever less surely."""
        unseen_s = (t_us - self.last_seen_us) / 1e6
        size = self.appearance.size_px * self._m * math.sqrt(abs(float(np.linalg.det(self._px_per_m))))
        std = min(0.12 * size + 1.5 * size * unseen_s, 0.5 * max(picture.shape[:2]))
        limit = np.array([picture.shape[1] - 1, picture.shape[0] - 1], dtype=np.float64)
        uv = np.clip(self._uv + self._drift_px_s * min(unseen_s, 1.0), 0.0, limit)
        return ExpectedView(uv, std**2 * np.eye(2), self._px_per_m, 2.0 * size)

    def _density(self, view: ExpectedView) -> float:
        """Pixels of the picture by a step on the grid."""
        return self._m * math.sqrt(abs(float(np.linalg.det(view.px_per_m))))

    def _where(self, look: Look, view: ExpectedView, t_us: int) -> tuple[Float, Float]:
        """Offset (2,) from the expected place on the grid about which to search, and covariance (2, 2)."""
        back = np.linalg.inv(look.px_per_step(np.zeros(2)))
        cov: Float = back @ view.cov_px2 @ back.T + np.eye(2)
        if self._lost:
            return np.zeros(2), cov
        # in sight, errors that change slowly are what they were a moment ago
        dt_s = (t_us - self.last_seen_us) / 1e6
        per_px = math.sqrt(abs(float(np.linalg.det(back))))
        std = 1.5 + 0.03 * self.appearance.size_px + (view.rate_std_px_s * per_px + 2.0) * dt_s
        if std**4 > float(np.linalg.det(cov)):
            return np.zeros(2), cov
        return self._offset_m / self._m, std**2 * np.eye(2)

    def _turns(self, view: ExpectedView) -> tuple[float, ...]:
        """Turns since the click that are worth trying."""
        if view.moving is False:
            return (self._turn,)
        if not self._lost:
            return (self._turn - TURN_STEP_RAD, self._turn, self._turn + TURN_STEP_RAD)
        count = math.floor(math.pi / WIDE_STEP_RAD)
        middle = self._turn
        if np.isfinite(view.course_rad) and np.isfinite(self._course_0):
            middle = view.course_rad - self._course_0
            count = min(count, math.ceil(2.5 * view.course_std_rad / WIDE_STEP_RAD) + 1)
        last = count if 2 * count * WIDE_STEP_RAD < 2.0 * math.pi - 1e-6 else count - 1
        return tuple(middle + WIDE_STEP_RAD * k for k in range(-count, last + 1))

    def _weighed(
        self, look: Look, view: ExpectedView, matches: list[Match], centre: Float, cov: Float
    ) -> list[Candidate]:
        """Matches with all that speaks for them, best first."""
        out = []
        limit = np.array([look.picture.shape[1], look.picture.shape[0]]) - 0.5
        for match in matches:
            uv = look.pixel(match.offset_px)
            if not ((uv >= -0.5) & (uv < limit)).all():  # below a pixel beyond the border, by interpolation
                continue
            away = match.offset_px - centre
            evidence = match.score / self.config.score_std - 0.5 * float(away @ np.linalg.solve(cov, away))
            surroundings = math.nan
            if view.moving is False and self._lost:
                surroundings = surroundings_fit(look, match.offset_px, self._surroundings)
                evidence += surroundings / self.config.score_std
            out.append(Candidate(match, evidence, surroundings, match.offset_px * self._m))
        return sorted(out, key=lambda one: -one.evidence)

    def _keep(self, found: list[Candidate], view: ExpectedView, look: Look, t_us: int) -> Sighting | Lost:
        if not found or found[0].match.score < self.config.keep_score:
            return Lost(t_us, NOT_SEEN, self.last_seen_us)
        lead = found[0].evidence - found[1].evidence if len(found) > 1 else math.inf
        confidence = _confidence(found[0].match.score, lead, self.config)
        return self._seen(found[0], confidence, view, look, t_us, False)

    def _find(self, found: list[Candidate], view: ExpectedView, look: Look, t_us: int, dt_s: float) -> Sighting | Lost:
        c = self.config
        self._extend(found, view, t_us, dt_s)
        if not found:
            return Lost(t_us, NOT_SEEN, self.last_seen_us)
        moving = view.moving is True
        self._ground_m_s = self._ground_velocity()
        rivals = sorted(
            ((self._weight(chain, view), chain) for chain in self._chains if not moving or self._goes_as(chain, view)),
            key=lambda pair: -pair[0],
        )
        evidence, best = next(((w, chain) for w, chain in rivals if chain.last_us == t_us), (0.0, None))
        if best is None or len(best.candidates) < c.find_pictures:
            return Lost(t_us, UNSURE, self.last_seen_us)
        if best.span_s < (c.find_moving_s if moving else c.find_s):
            return Lost(t_us, UNSURE, self.last_seen_us)
        surroundings = float(np.mean([one.surroundings for one in best.candidates]))
        if (
            best.score < max(c.find_score, self._usual - c.worse) or surroundings < c.surroundings
        ):  # NaN where they were not asked
            return Lost(t_us, NOT_SEEN, self.last_seen_us)
        apart_m = APART * self.appearance.size_px * self._m
        place_m = best.candidates[-1].offset_m
        others = [w for w, chain in rivals if float(np.hypot(*(chain.candidates[-1].offset_m - place_m))) > apart_m]
        lead = evidence - max(others) if others else math.inf
        if lead < c.margin:
            return Lost(t_us, ALIKE, self.last_seen_us)
        self._lost, self._chains = False, []
        one = self._right_way_round(best) if moving else best.candidates[-1]
        return self._seen(one, _confidence(best.score, lead, c), view, look, t_us, True)

    def _extend(self, found: list[Candidate], view: ExpectedView, t_us: int, dt_s: float) -> None:
        """Add candidates to the chains whose place they share, and begin chains for the rest."""
        c = self.config
        went_m = np.array([view.vel_ne_m_s[1], -view.vel_ne_m_s[0]]) * dt_s
        per_px = self._m / self._density(view)
        taken: set[int] = set()
        for chain in sorted(self._chains, key=lambda one: -one.evidence):
            gap_s = (t_us - chain.last_us) / 1e6
            # a rival that stands among what moves is followed as well
            reach_m = (
                c.chain_m + (c.gate_sigmas * view.rate_std_px_s * per_px + float(np.hypot(*view.vel_ne_m_s))) * gap_s
            )
            expected = chain.candidates[-1].offset_m
            if len(chain.times_us) > 1:
                going = chain.velocity_m_s() * gap_s - went_m * (gap_s / max(dt_s, 1e-6))
                expected, reach_m = expected + going, c.chain_m + 4.0 * gap_s
            options = [
                (float(np.hypot(*(one.offset_m - expected))), k) for k, one in enumerate(found) if k not in taken
            ]
            options = [option for option in options if option[0] <= reach_m]
            if options:
                k = min(options)[1]
                taken.add(k)
                step = found[k].offset_m - chain.candidates[-1].offset_m + went_m * (gap_s / max(dt_s, 1e-6))
                chain.path_m.append(chain.path_m[-1] + step)
                chain.candidates.append(found[k])
                chain.times_us.append(t_us)
                chain.forget_before(t_us - round(c.judged_s * 1e6))
        self._chains += [Chain([t_us], [one], [np.zeros(2)]) for k, one in enumerate(found) if k not in taken]
        self._chains = [chain for chain in self._chains if (t_us - chain.last_us) / 1e6 <= c.lost_after_s]

    def _right_way_round(self, chain: Chain) -> Candidate:
        """The last of a chain's candidates, with front and back as it moves."""
        one = chain.candidates[-1]
        if not np.isfinite(self._course_0):
            return one
        right, down = chain.velocity_m_s() - self._ground_m_s
        turn = math.atan2(right, -down) - self._course_0
        if abs(math.remainder(turn - one.match.turn_rad, 2.0 * math.pi)) < 0.5 * math.pi:
            return one
        return replace(one, match=replace(one.match, turn_rad=one.match.turn_rad + math.pi))

    def _ground_velocity(self) -> Float:
        """How fast (2,) what stands seems to move, from the candidates that hardly do: the pose's error changes, and
        other ground lies at other heights."""
        slow = [chain.velocity_m_s() for chain in self._chains if len(chain.times_us) >= self.config.find_pictures]
        slow = [vel for vel in slow if float(np.hypot(*vel)) < self.config.parked_m_s]
        out: Float = np.median(slow, axis=0) if len(slow) >= 2 else np.zeros(2)
        return out

    def _goes_as(self, chain: Chain, view: ExpectedView) -> bool:
        """Whether a candidate moves over ground, and no otherwise than the target may."""
        if len(chain.times_us) < 2:
            return False
        c = self.config
        right, down = chain.velocity_m_s() - self._ground_m_s
        least = max(c.least_speed_m_s, c.least_speed_share * float(np.hypot(*view.vel_ne_m_s)))
        if np.hypot(right, down) < least or self._speed_sigmas(chain, view) > c.speed_sigmas:
            return False
        if chain.unevenness_m() > c.uneven_m:
            return False
        if not np.isfinite(self._course_0):
            return True
        # a car goes where it looks: its turn since the click is that of its course; front and back look much alike
        turn = math.atan2(right, -down) - self._course_0
        off = [abs(math.remainder(turn - one.match.turn_rad, math.pi)) for one in chain.candidates]
        return float(np.median(off)) < c.course_off_rad

    def _speed_sigmas(self, chain: Chain, view: ExpectedView) -> float:
        """How far a candidate's velocity lies from the target's, over the standard deviation of that."""
        right, down = chain.velocity_m_s() - self._ground_m_s
        std_m_s = view.rate_std_px_s / math.sqrt(abs(float(np.linalg.det(view.px_per_m)))) + self.config.speed_std_m_s
        return float(np.hypot(*(np.array([-down, right]) - view.vel_ne_m_s))) / std_m_s

    def _weight(self, chain: Chain, view: ExpectedView) -> float:
        """All that speaks for a candidate: as it was seen, and as it moves."""
        if view.moving is not True or len(chain.times_us) < 2:
            return chain.evidence
        return chain.evidence - 0.5 * self._speed_sigmas(chain, view) ** 2

    def _seen(
        self, one: Candidate, confidence: float, view: ExpectedView, look: Look, t_us: int, found_again: bool
    ) -> Sighting:
        match = one.match
        uv = look.pixel(match.offset_px)
        dt_s = (t_us - self.last_seen_us) / 1e6
        if dt_s > 0.0:
            self._drift_px_s = np.zeros(2) if found_again else (uv - self._uv) / dt_s
        self._uv, self._px_per_m, self._offset_m = uv, view.px_per_m, one.offset_m
        self._turn, self._scale, self.last_seen_us = match.turn_rad, match.scale, t_us
        if np.isfinite(view.course_rad) and not np.isfinite(self._course_0):
            self._course_0 = view.course_rad - match.turn_rad
        self._usual += 0.1 * (match.score - self._usual)
        self._learn(match, view, look)
        per_step = look.px_per_step(match.offset_px)
        cov = per_step @ match.cov_px2 @ per_step.T
        turn = math.remainder(match.turn_rad, 2 * math.pi)
        return Sighting(t_us, uv, cov, confidence, match.score, turn, found_again)

    def _learn(self, match: Match, view: ExpectedView, look: Look) -> None:
        """Take over the light, and the surroundings of what is not known to stand."""
        if match.score < self.config.find_score:
            return
        template = self.appearance.turned(match.turn_rad, match.scale)
        grid = grid_from_picture(look.picture, look.about(match.offset_px), square_about(self.appearance.half_px))
        if not grid.whole:
            return
        light = self.appearance.mean_colour(grid.image, template.inside)[0] / max(self.appearance.mean_lab[0], 1.0)
        self._gain = float(np.clip(0.8 * self._gain + 0.2 * light, 0.5, 2.0))
        if view.moving is not False:
            half = self._surroundings.image.shape[0] // 2
            self._surroundings = grid_from_picture(look.picture, look.about(match.offset_px), square_about(half))


def checked_picture(image: Image) -> Image:
    """The picture itself; ValueError where it is not one that can be looked at."""
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        message = f"a picture is an array of uint8, not {getattr(image, 'dtype', type(image).__name__)}"
        raise ValueError(message)
    if not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        message = f"a picture is (rows, cols) grey or (rows, cols, 3) BGR, not {image.shape}"
        raise ValueError(message)
    if min(image.shape[:2]) < MIN_PICTURE_PX:
        message = f"a picture of {image.shape[1]} x {image.shape[0]} pixels is too small to look for anything"
        raise ValueError(message)
    return image


def _confidence(score: float, lead: float, config: TrackerConfig) -> float:
    """Probability that it is the target: by the fit, and against the best other candidate."""
    fits = 1.0 / (1.0 + math.exp(-(score - config.keep_score) / config.score_std - 1.0))
    return fits / (1.0 + math.exp(-min(max(lead, -50.0), 50.0)))
