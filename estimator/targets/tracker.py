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

from estimator.targets.anchor import Before, anchored_place, found_there
from estimator.targets.appearance import RING_PX, Appearance, GridView, grid_from_picture, picture_box, square_about
from estimator.targets.candidates import Candidate, Chain, Going, Pursuit
from estimator.targets.moved import Earlier
from estimator.targets.search import (
    APART,
    TURN_STEP_RAD,
    WIDE_STEP_RAD,
    Look,
    Match,
    Place,
    SearchArea,
    Searcher,
    affine_from_grid,
    picture_from_grid,
    surroundings_fit,
    surroundings_of,
)  # fmt: skip
from estimator.targets.tracker_config import TrackerConfig
from estimator.targets.view import PICTURE_UPRIGHT, ExpectedView
from estimator.types import Float, Image

MIN_PICTURE_PX = 32


class CannotFollowError(ValueError):
    """A click that no tracker can start from: where it is, or what it shows, is not enough."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """The target in a picture: pixel (2,) of what was clicked, covariance (2, 2).

    ``confidence`` in [0, 1] is how probably it is the target, ``score`` in [-1, 1] how well it fits, ``turn_rad`` how
    far it has turned clockwise since the click, ``found_again`` whether it had been lost before.
    Of one that drives and was lost, ``vel_ne_m_s`` (2,) is how fast it went over ground while it was verified, with
    ``vel_std_m_s`` on each axis.
    """

    t_us: int
    uv_px: Float
    cov_px2: Float
    confidence: float
    score: float
    turn_rad: float
    found_again: bool
    vel_ne_m_s: Float | None = None
    vel_std_m_s: float = 1.0


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
        self._search = Searcher(appearance, config.candidates, config.keep_score, config.least_std_px)
        self._m = m_per_grid_px
        self._t_us = t_us
        self._uv, self._px_per_m = uv_px, px_per_m
        self._drift_px_s = np.zeros(2)
        self._offset_m, self._anchor_m = np.zeros(2), np.zeros(2)
        self._turn, self._scale, self._gain = 0.0, 1.0, 1.0
        self._course_0 = course_rad
        self._surroundings = surroundings
        self._usual = 0.8
        self._pursuit = Pursuit(config)
        self._lost = False
        self._before: Before | None = None
        self._earlier = Earlier()

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
        tracker = cls(Appearance(grid.image, size), metres, t_us, uv, jacobian, course_rad, around, config)
        tracker._before = Before(t_us, Look(picture, affine_from_grid(uv, jacobian, metres), 1.0), np.zeros(2))
        return tracker

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
        self._t_us = t_us
        if (t_us - self.last_seen_us) / 1e6 > self.config.lost_after_s and not self._lost:
            self._lost = True
            self._pursuit.clear()
        view = expected if expected is not None else self._guess(picture, t_us)
        look = Look(picture, picture_from_grid(view, self._m), self._gain)
        if not look.plain:
            return Lost(t_us, OUTSIDE, self.last_seen_us)
        centre, cov = self._where(look, view, t_us)
        reach = math.ceil(self.config.gate_sigmas * math.sqrt(float(np.linalg.eigvalsh(cov)[-1]))) + 2
        reach = min(reach, math.ceil(self.config.most_reach_m / self._m) if expected is not None else reach)
        low, high = picture_box(picture, look.picture_from_grid)
        if (np.maximum(low - centre, centre - high) > reach).any():
            return Lost(t_us, OUTSIDE, self.last_seen_us)
        steps = (1.0,) if expected is not None or self._lost else (0.95, 1.0, 1.05)
        scales = tuple(self._scale * step for step in steps)
        area = SearchArea(centre, reach, self._turns(view, t_us), scales, self._lost, view.moving is True)
        going = self._going(view, t_us)
        if not self._lost:
            matches = self._anchored(look, view, t_us)
            if matches is None:
                matches = self._search.find(look, area).matches
            return self._keep(self._weighed(look, view, matches, centre, cov), going, view, look, t_us)
        places, skip = self._pursuit.places(going, t_us, self._m) if going.moving else ([], [])
        if view.moving is False:
            anchor = self._anchor(look, np.zeros(2), min(reach, self.config.anchor_px))
            places = [] if anchor is None else [Place(anchor, self.config.anchored_px, self._turn)]
        moved: list[Float] = []
        if going.moving:
            size, most = self.appearance.size_px, self.config.moved
            moved = self._earlier.moved(look, t_us, going.vel_m_s / self._m, reach, size, most)
            self._earlier.add(t_us, look)
        seen = self._search.find(look, area, places, skip, moved)
        self._pursuit.refute([offset * self._m for offset in seen.in_vain], t_us)
        found = self._weighed(look, view, seen.matches, centre, cov)
        self._pursuit.extend(found, going, look, self._surroundings.half_px, t_us)
        return self._find(found, going, view, look, t_us)

    def _anchor(self, look: Look, about_px: Float, reach_px: int) -> Float | None:
        return anchored_place(look, self._surroundings, self.appearance.size_px, about_px, reach_px)

    def _anchored(self, look: Look, view: ExpectedView, t_us: int) -> list[Match] | None:
        """What fits in sight where the ground has something that stands; None where that is to be sought more widely:
        it does not stand, the ground is not known again, or it is not there any more."""
        if view.moving is not False:
            return None
        at = self._anchor(look, self._anchor_m / self._m, self.config.anchor_px // 2)
        if at is None:
            return None
        self._anchor_m = at * self._m
        reach = self.config.anchored_px
        here = found_there(self._search, look, at, reach, self._turns(view, t_us), self._scale)
        here = [one for one in here if one.score >= self.config.keep_score]
        return here if here or not surroundings_of(look, at, self.appearance.half_px).whole else None

    def _going(self, view: ExpectedView, t_us: int) -> Going:
        """How the target is expected to go."""
        std_m_s = view.rate_std_px_s / math.sqrt(abs(float(np.linalg.det(view.px_per_m))))
        vel = np.array([view.vel_ne_m_s[1], -view.vel_ne_m_s[0]])
        return Going(vel, std_m_s, view.moving is True, self._long_away(t_us))

    def _long_away(self, t_us: int) -> bool:
        return (t_us - self.last_seen_us) / 1e6 > self.config.long_away_s

    def _guess(self, picture: Image, t_us: int) -> ExpectedView:
        """Where the target should be when nobody says: as far on as it went, and ever less surely."""
        unseen_s = (t_us - self.last_seen_us) / 1e6
        size = self.appearance.size_px * self._m * math.sqrt(abs(float(np.linalg.det(self._px_per_m))))
        std = min(0.12 * size + 1.5 * size * unseen_s, 0.5 * max(picture.shape[:2]))
        limit = np.array([picture.shape[1] - 1, picture.shape[0] - 1], dtype=np.float64)
        uv = np.clip(self._uv + self._drift_px_s * min(unseen_s, 1.0), 0.0, limit)
        return ExpectedView(uv, std**2 * np.eye(2), self._px_per_m, 2.0 * size)

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

    def _turns(self, view: ExpectedView, t_us: int) -> tuple[float, ...]:
        """Turns since the click that are worth trying."""
        if view.moving is False:
            return (self._turn,)
        if not self._lost:
            return (self._turn - TURN_STEP_RAD, self._turn, self._turn + TURN_STEP_RAD)
        count = math.floor(math.pi / WIDE_STEP_RAD)
        middle = self._turn
        if np.isfinite(view.course_rad) and np.isfinite(self._course_0):
            middle = view.course_rad - self._course_0
            if not self._long_away(t_us):
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
            elif view.moving is True and self._lost:
                evidence -= 0.5 * self._colour_sigmas(match, look) ** 2
            out.append(Candidate(match, evidence, surroundings, match.offset_px * self._m))
        return sorted(out, key=lambda one: -one.evidence)

    def _colour_sigmas(self, match: Match, look: Look) -> float:
        """How far the colour at a place lies from the target's, over the standard deviations of that in other light."""
        here = surroundings_of(look, match.offset_px, self.appearance.half_px)
        colour = self.appearance.mean_colour(here.image, self.appearance.turned(match.turn_rad, match.scale).inside)
        lighter = colour[0] / max(self._gain * self.appearance.mean_lab[0], 1.0)
        hue = float(np.hypot(*(colour[1:] - self.appearance.mean_lab[1:])))
        return math.hypot(hue / self.config.hue_std, math.log(max(lighter, 1e-3)) / self.config.lighter_std)

    def _keep(
        self, found: list[Candidate], going: Going, view: ExpectedView, look: Look, t_us: int
    ) -> Sighting | Lost:  # fmt: skip
        least = self.config.keep_score
        if going.moving:  # one that drives slides off onto what stands
            least = max(least, self._usual - self.config.worse_in_sight)
        if view.moving is not False:
            found = [one for one in found if not self._stood_there(one.match, going, look, t_us)]
        if not found or found[0].match.score < least:
            return Lost(t_us, NOT_SEEN, self.last_seen_us)
        lead = found[0].evidence - found[1].evidence if len(found) > 1 else math.inf
        if lead < self.config.keep_margin and found[1].match.score >= self.config.keep_score:
            return Lost(t_us, ALIKE, self.last_seen_us)
        confidence = _confidence(found[0].match.score, lead, self.config)
        return self._seen(found[0], confidence, view, look, t_us, False)

    def _stood_there(self, match: Match, going: Going, look: Look, t_us: int) -> bool:
        """Whether what fits was where it is when the target was last seen elsewhere, or is where the target was."""
        if self._before is None or not self._before.useful(t_us):
            return False
        dt_s = (t_us - self._before.t_us) / 1e6
        step = going.vel_m_s * dt_s / self._m
        c = self.config
        tolerance = (c.step_m + c.gate_sigmas * going.std_m_s * dt_s) / self._m if going.moving else math.inf
        return self._before.speaks_against(self._search, look, match, step, tolerance, self._surroundings.half_px)

    def _find(
        self, found: list[Candidate], going: Going, view: ExpectedView, look: Look, t_us: int
    ) -> Sighting | Lost:  # fmt: skip
        rivals = self._pursuit.rivals(going, self._course_0)
        evidence, best = next(((w, chain) for w, chain in rivals if chain.last_us == t_us), (0.0, None))
        if not found or best is None:
            # one that drives is not seen in what stands, however much that may look like it
            return Lost(t_us, NOT_SEEN if not found or going.moving else UNSURE, self.last_seen_us)
        apart_m = APART * self.appearance.size_px * self._m
        place_m = best.candidates[-1].offset_m
        others = [
            weight
            for weight, chain in rivals
            if float(np.hypot(*(chain.candidates[-1].offset_m - place_m))) > apart_m
            and not (going.moving and len(chain.candidates) < self.config.find_pictures)  # any two places are a way
        ]
        lead = evidence - max(others) if others else math.inf
        doubt = self._doubt(best, lead, going, look)
        if doubt is not None:
            return Lost(t_us, doubt, self.last_seen_us)
        one = self._pursuit.right_way_round(best, self._course_0) if going.moving else best.candidates[-1]
        right, down = best.velocity_m_s() - self._pursuit.ground_m_s
        self._lost = False
        self._earlier.clear()
        self._usual = min(self._usual, best.score)
        self._pursuit.clear()
        seen = self._seen(one, _confidence(best.score, lead, self.config), view, look, t_us, True)
        if not going.moving:
            return seen
        return replace(seen, vel_ne_m_s=np.array([-down, right]), vel_std_m_s=self.config.speed_std_m_s)

    def _doubt(self, best: Chain, lead: float, going: Going, look: Look) -> str | None:
        """What speaks against the best candidate being the target; None where nothing does."""
        c = self.config
        pictures, span_s = (c.moving_pictures, c.find_moving_s) if going.moving else (c.find_pictures, c.find_s)
        if len(best.candidates) < pictures or best.span_s < span_s:
            return UNSURE
        if going.moving:
            least, weight = max(c.find_moving_score, self._usual - c.worse_moving), c.least_weight
            if self._pursuit.drives_as_expected(best, going):
                least, weight = c.long_way_score, c.long_way_weight
            unlike = self._pursuit.weight(best, going) < weight or best.candidates[-1].match.score < least
        else:
            # NaN where they were not asked
            surroundings = float(np.mean([one.surroundings for one in best.candidates]))
            unlike = surroundings < c.surroundings
            # where the ground leaves no doubt the light may be another
            least = c.find_score if surroundings >= c.sure_surroundings else max(c.find_score, self._usual - c.worse)
        if unlike or best.score < least:
            return NOT_SEEN
        if lead < c.margin:
            return ALIKE
        if going.moving and not self._pursuit.leaves_its_place(best, look, self._m, self.appearance.size_px):
            return UNSURE
        return None

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
        if found_again or self._before is None or self._before.old(t_us):
            self._before = Before(t_us, look, match.offset_px)
        self._learn(match, view, look)
        per_step = look.px_per_step(match.offset_px)
        cov = per_step @ match.cov_px2 @ per_step.T
        turn = math.remainder(match.turn_rad, 2 * math.pi)
        return Sighting(t_us, uv, cov, confidence, match.score, turn, found_again)

    def _learn(self, match: Match, view: ExpectedView, look: Look) -> None:
        """Take over the light, and the surroundings of what drives; what stands keeps those that it was clicked or came
        to stand in."""
        if match.score < self.config.find_score:
            return
        template = self.appearance.turned(match.turn_rad, match.scale)
        grid = surroundings_of(look, match.offset_px, self.appearance.half_px)
        if not grid.whole:
            return
        light = self.appearance.mean_colour(grid.image, template.inside)[0] / max(self.appearance.mean_lab[0], 1.0)
        self._gain = float(np.clip(0.8 * self._gain + 0.2 * light, 0.5, 2.0))
        if view.moving is True:
            self._anchor_m = self._offset_m
            self._surroundings = surroundings_of(look, match.offset_px, self._surroundings.half_px)


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
