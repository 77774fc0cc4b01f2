"""Where in a picture something looks like a target: near the expected place at once, further off coarse to fine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.targets.appearance import (
    GROUND_FROM_GRID,
    Appearance,
    Float32,
    GridView,
    grid_from_picture,
    mapped,
    peaks,
    picture_box,
    square_about,
)  # fmt: skip
from estimator.targets.view import ExpectedView
from estimator.types import Float, Image

NEAR_PX = 30
LEAST_SHOWN = 0.9
"""Of what is compared with the template, rim included, that the picture must show: beyond its border there is but
smear, which fits whatever is held against it."""
LEAST_AREA = 1e-6
"""Square pixels of the picture by a square of the grid: less is ground seen edge on."""
BLOBS, CLOSE_PX = 24, 4
SCANNED, SCAN_EVERY = 12, 3
"""How many places are chosen from for their shape alone, and in how many pictures all turns are tried."""
INNER_SIZES = 4.0
"""How far from the expected place, in the target's sizes, it most probably is if it went on as it did."""
FLIP_MARGIN = 0.06
"""By what the less expected way round must fit better."""
APART = 0.6
"""Of the target's size: what is nearer together than that is one thing."""
TURN_STEP_RAD = math.radians(8.0)
WIDE_STEP_RAD = math.radians(12.0)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A picture and the homography (3, 3) from offsets on the grid, about the expected place, to its pixels."""

    picture: Image
    picture_from_grid: Float
    gain: float

    def pixel(self, offset_px: Float) -> Float:
        """The pixel (2,) of an offset (2,) on the grid."""
        return mapped(self.picture_from_grid, offset_px)

    def px_per_step(self, offset_px: Float) -> Float:
        """Pixels (2, 2) by steps right and down on the grid, at an offset (2,)."""
        steps = offset_px + np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        uv = mapped(self.picture_from_grid, steps)
        return np.stack((uv[0] - uv[1], uv[2] - uv[3]), axis=-1)

    @property
    def plain(self) -> bool:
        """Whether the ground at the expected place lies flat enough before the camera to be laid on a grid."""
        step = self.px_per_step(np.zeros(2))
        return bool(np.isfinite(step).all()) and abs(float(np.linalg.det(step))) > LEAST_AREA

    def about(self, offset_px: Float) -> Float:
        """The homography (3, 3) from offsets about another place."""
        shift = np.array([[1.0, 0.0, offset_px[0]], [0.0, 1.0, offset_px[1]], [0.0, 0.0, 1.0]])
        out: Float = self.picture_from_grid @ shift
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """A place on the grid: ``offset_px`` (2,) right and down of the expected one, covariance (2, 2), how it fits."""

    offset_px: Float
    cov_px2: Float
    score: float
    turn_rad: float
    scale: float


@dataclass(frozen=True, slots=True, eq=False)
class SearchArea:
    """Offsets within ``reach_px`` of ``centre_px`` (2,), turns and scales to be tried.

    ``whole`` asks that the picture shows all of the target: what sticks to its border moves over ground as a car does.
    ``driven`` says that the ground about it may be other than when it was clicked.
    """

    centre_px: Float
    reach_px: int
    turns_rad: tuple[float, ...]
    scales: tuple[float, ...] = (1.0,)
    whole: bool = False
    driven: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where something is known to be: within ``reach_px`` of an offset (2,), turned about so."""

    offset_px: Float
    reach_px: int
    turn_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Places that fit, and offsets (2,) that were looked at closely in vain."""

    matches: list[Match]
    in_vain: list[Float]


class Searcher:
    """Finds places that fit an appearance."""

    def __init__(self, appearance: Appearance, most: int, useful_score: float, least_std_px: float) -> None:
        self.appearance, self.most, self.useful_score = appearance, most, useful_score
        self.least_score = 0.6 * useful_score
        # seen from elsewhere a thing with height is not the same shape
        self.least_std_px = math.hypot(least_std_px, 0.04 * appearance.size_px)
        self._small = appearance.halved() if appearance.size_px >= 16.0 else appearance
        self._scans = 0
        self._step = 2 if self._small is not appearance else 1

    def find(
        self, look: Look, area: SearchArea, places: Sequence[Place] = (), skip: Sequence[Float] = (),
        moved: Sequence[Float] = (),
    ) -> Found:  # fmt: skip
        """The best places, apart from each other, best first.

        ``places`` are looked at first; neither about them nor about the offsets in ``skip`` anything else is sought.
        ``moved`` are offsets (2,) at which something has come or gone: looked at as well, whatever their colour.
        """
        matches: list[Match] = []
        in_vain: list[Float] = []
        known: list[Float] = []
        for place in places:
            turns = _about(place.turn_rad, TURN_STEP_RAD)
            here = self._near(look, replace(area, centre_px=place.offset_px, reach_px=place.reach_px, turns_rad=turns))
            if here:
                best = max(here, key=lambda match: match.score)
                matches.append(best)
                known.append(best.offset_px)
        if area.reach_px <= NEAR_PX and len(area.turns_rad) <= 3:
            matches += self._near(look, area)
        else:
            come = [
                self._likeliest(look, area, at) for at in moved if _away(at, known) > APART * self.appearance.size_px
            ]
            known += [offset for offset, _ in come]
            for offset, turn in [*come, *self._promising(look, area, [*known, *skip])]:
                here = self._close(look, area, offset, turn)
                matches += here
                if max((match.score for match in here), default=-1.0) < self.useful_score:
                    in_vain.append(offset)
        out: list[Match] = []
        for one in sorted(matches, key=lambda match: -match.score):
            if _away(one.offset_px, [other.offset_px for other in out]) > APART * self.appearance.size_px:
                out.append(one)
        return Found(out[: self.most + len(places) + len(moved)], in_vain)

    def _likeliest(self, look: Look, area: SearchArea, about_px: Float) -> tuple[Float, float]:
        """Offset (2,) and turn that fit best near a place, at half the resolution."""
        a, step = self._small, self._step
        half = a.half_px + math.ceil(0.35 * a.size_px)
        middle = np.round(about_px / step).astype(np.intp)
        grid = grid_from_picture(look.picture, coarser(look.picture_from_grid, step), (middle - half, middle + half))
        likeness = np.asarray(a.colour.likeness(grid.image, look.gain) * grid.known, np.float32)
        score, which = _best(a, grid.image, likeness, replace(area, scales=area.scales[:1]))
        row, col = np.unravel_index(int(score.argmax()), score.shape)
        offset = step * (grid.low_px + a.half_px + np.array([col, row]))
        return offset.astype(np.float64), area.turns_rad[int(which[row, col])]

    def _close(self, look: Look, area: SearchArea, offset: Float, turn: float) -> list[Match]:
        """At full resolution: colour does not tell front from back, nor small turns apart."""
        turns = area.turns_rad
        if len(turns) > 1:
            middle = turns[len(turns) // 2]
            ways = [
                t for t in (turn, turn + math.pi) if min(abs(math.remainder(t - o, 2 * math.pi)) for o in turns) < 0.3
            ]
            ways.sort(key=lambda t: abs(math.remainder(t - middle, 2 * math.pi)))
            first: list[Match] = []
            for way in ways:
                seen = self._near(look, replace(area, centre_px=offset, reach_px=CLOSE_PX, turns_rad=(way,)))
                top = max((match.score for match in first), default=-1.0)
                if max((match.score for match in seen), default=-1.0) > top + (FLIP_MARGIN if first else 0.0):
                    first = seen
            if not first:
                return []
            best = max(first, key=lambda match: match.score)
            if best.score < 1.2 * self.least_score:
                return first
            offset, turns = best.offset_px, _about(best.turn_rad, 0.5 * WIDE_STEP_RAD)
            return self._near(look, replace(area, centre_px=offset, reach_px=2, turns_rad=turns))
        return self._near(look, replace(area, centre_px=offset, reach_px=CLOSE_PX))

    def _box(
        self, look: Look, area: SearchArea, step: int, half_px: int
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
        """The part of the grid, at ``step``, within reach and in the picture, with room for the template."""
        low, high = picture_box(look.picture, coarser(look.picture_from_grid, step))
        low = np.maximum(np.round(area.centre_px / step) - math.ceil(area.reach_px / step), np.floor(low))
        high = np.minimum(np.round(area.centre_px / step) + math.ceil(area.reach_px / step), np.ceil(high))
        if (high < low).any():
            return None
        return (low - half_px).astype(np.intp), (high + half_px).astype(np.intp)

    def _near(self, look: Look, area: SearchArea) -> list[Match]:
        a = self.appearance
        box = self._box(look, area, 1, a.half_px)
        if box is None:
            return []
        grid = grid_from_picture(look.picture, look.picture_from_grid, box)
        likeness = a.colour.likeness(grid.image, look.gain) * grid.known
        score, which = _best(a, grid.image, likeness, area)
        out = []
        for row, col in peaks(score, self.most, max(3, round(0.3 * a.size_px))):
            turn, scale = divmod(int(which[row, col]), len(area.scales))
            shown = grid.known[row : row + 2 * a.half_px + 1, col : col + 2 * a.half_px + 1]
            mask = a.turned(area.turns_rad[turn], area.scales[scale]).mask > 0
            if score[row, col] < self.least_score or not shown[a.half_px, a.half_px]:
                continue
            if not shown.all() and (area.whole or float(shown[mask].mean()) < LEAST_SHOWN):
                continue
            step, cov = _subpixel(score, row, col, self.least_std_px)
            offset = grid.low_px + a.half_px + np.array([col, row]) + step
            out.append(Match(offset, cov, float(score[row, col]), area.turns_rad[turn], area.scales[scale]))
        return out

    def _promising(self, look: Look, area: SearchArea, skip: Sequence[Float]) -> list[tuple[Float, float]]:
        """Offsets (2,) with turns to be looked at closely: in all of the area, and again where the target most probably
        is, so that all that resembles it elsewhere does not crowd it out."""
        inner = round(INNER_SIZES * self.appearance.size_px)
        if area.reach_px < 1.5 * inner:
            return self._coarse(look, area, skip, SCAN_EVERY, self.most)
        within = replace(area, reach_px=inner)
        first = self._coarse(look, within, skip, 1, self.most // 2)
        taken = [*skip, *(offset for offset, _ in first)]
        return first + self._coarse(look, area, taken, SCAN_EVERY, self.most // 2)

    def _coarse(
        self, look: Look, area: SearchArea, skip: Sequence[Float], every: int, most: int
    ) -> list[tuple[Float, float]]:
        """Offsets (2,) with the turn that fits best there, from a grid of half the resolution; none about ``skip``."""
        a, step = self._small, self._step
        box = self._box(look, area, step, a.half_px)
        if box is None:
            return []
        softened = np.asarray(cv2.GaussianBlur(look.picture, (0, 0), 0.8), np.uint8) if step > 1 else look.picture
        grid = grid_from_picture(softened, coarser(look.picture_from_grid, step), box)
        likeness = np.asarray(a.colour.likeness(grid.image, look.gain) * grid.known, np.float32)
        found: list[tuple[float, Float, float]] = []
        apart = APART * self.appearance.size_px
        for row, col in a.blobs(likeness, BLOBS + len(skip)):
            if _away(step * (grid.low_px + np.array([col, row])), skip) > apart:
                found += self._at_blob(likeness, grid, row, col, area)
        found.sort(key=lambda one: -one[0])
        best = [(step * offset, turn) for _, offset, turn in found[:most]]
        if len(area.turns_rad) > 3:
            taken = [*skip, *(offset for offset, _ in best)]
            scanned = [(step * offset, turn) for offset, turn in self._scanned(grid, area.turns_rad, every)]
            best += [one for one in scanned if _away(one[0], taken) > apart][: most // 2]
        return best

    def _scanned(self, grid: GridView, turns: tuple[float, ...], every: int) -> list[tuple[Float, float]]:
        """Offsets (2,) and turns that correlate in grey, whatever the colour: one turn in ``every`` a time."""
        a = self._small
        half_round = [t for t in turns if abs(t - turns[0]) < math.pi - 1e-6]
        self._scans += 1
        grey = cv2.cvtColor(grid.image, cv2.COLOR_BGR2GRAY).astype(np.float32)
        grey -= grey.mean()
        top: Float32 | None = None
        which = np.zeros((1, 1), np.intp)
        for k, turn in enumerate(half_round):
            if (k + self._scans) % every:
                continue
            score = a.correlation(grey, a.turned(turn))
            better = np.ones(score.shape, bool) if top is None else score > top
            which = np.where(better, k, which)
            top = score if top is None else np.maximum(top, score)
        if top is None:
            return []
        shown = grid.known[a.half_px : a.half_px + top.shape[0], a.half_px : a.half_px + top.shape[1]]
        top = np.where(shown > 0, top, np.float32(-1.0))
        out = []
        for row, col in peaks(top, SCANNED, max(2, round(0.3 * a.size_px))):
            offset = grid.low_px + a.half_px + np.array([col, row])
            out.append((offset.astype(np.float64), half_round[int(which[row, col])]))
        return out

    def _at_blob(
        self, likeness: Float32, grid: GridView, row: int, col: int, area: SearchArea
    ) -> list[tuple[float, Float, float]]:
        a = self._small
        turns = area.turns_rad
        if len(turns) > 3:
            turns = a.turns_like(likeness, row, col, turns)
        slack = a.half_px + 3
        rows, cols = likeness.shape
        r0, r1 = max(row - slack, 0), min(row + slack + 1, rows)
        c0, c1 = max(col - slack, 0), min(col + slack + 1, cols)
        if not turns or min(r1 - r0, c1 - c0) < 2 * a.half_px + 1:
            return []
        layers = np.stack([a.contrast(likeness[r0:r1, c0:c1], a.turned(turn, area.scales[0])) for turn in turns])
        which, r, c = np.unravel_index(int(layers.argmax()), layers.shape)
        offset = grid.low_px + a.half_px + np.array([c0 + c, r0 + r])
        return [(float(layers[which, r, c]), offset.astype(np.float64), turns[which])]


def surroundings_of(look: Look, offset_px: Float, half_px: int) -> GridView:
    """What lies within ``half_px`` of a place."""
    return grid_from_picture(look.picture, look.about(offset_px), square_about(half_px))


def surroundings_fit(look: Look, offset_px: Float, remembered: GridView) -> float:
    """Correlation in [-1, 1] of a place's surroundings with remembered ones; 0 where too little of them shows."""
    now = surroundings_of(look, offset_px, remembered.half_px)
    known = (now.known & remembered.known) > 0
    if known.mean() < 0.25:
        return 0.0
    a = cv2.GaussianBlur(now.image, (0, 0), 1.0)[known].astype(np.float64)
    b = cv2.GaussianBlur(remembered.image, (0, 0), 1.0)[known].astype(np.float64)
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    return float((a * b).sum() / math.sqrt(max(float((a * a).sum() * (b * b).sum()), 1e-9)))


def likeness_by_shift(now: GridView, then: GridView, without_px: int) -> tuple[Float32, Float]:
    """Correlation (n, n) of a square, without what is in its middle, with a larger one about the same place, and the
    shifts (n, n, 2) right and down that they belong to; -1 where they cannot be told."""
    small = cv2.resize(cv2.cvtColor(then.image, cv2.COLOR_BGR2GRAY), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    large = cv2.resize(cv2.cvtColor(now.image, cv2.COLOR_BGR2GRAY), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    mask = cv2.resize(then.known, (small.shape[1], small.shape[0]), interpolation=cv2.INTER_NEAREST)
    cv2.circle(mask, (small.shape[1] // 2, small.shape[0] // 2), math.ceil(0.5 * without_px), (0,), -1)
    found = cv2.matchTemplate(large, small, cv2.TM_CCOEFF_NORMED, mask=mask)
    found = np.where(np.isfinite(found) & (np.abs(found) <= 1.0), found, -1.0)
    rows, cols = np.mgrid[0 : found.shape[0], 0 : found.shape[1]]
    middle = 0.5 * (np.array(large.shape[::-1]) - np.array(small.shape[::-1]))
    return np.asarray(found, np.float32), 2.0 * (np.stack((cols, rows), axis=-1) - middle)


def picture_from_grid(view: ExpectedView, m_per_grid_px: float) -> Float:
    """The homography (3, 3) from offsets on the grid to pixels."""
    ground_from_grid = np.eye(3)
    ground_from_grid[:2, :2] = m_per_grid_px * GROUND_FROM_GRID
    if view.picture_from_ground is not None:
        whole: Float = view.picture_from_ground @ ground_from_grid
        # about the expected place it is exactly there
        return _through(whole, view.uv_px)
    return affine_from_grid(view.uv_px, view.px_per_m, m_per_grid_px)


def affine_from_grid(uv_px: Float, px_per_m: Float, m_per_grid_px: float) -> Float:
    """The same where only the pixels per metre at the place are known."""
    out = np.eye(3)
    out[:2, :2], out[:2, 2] = m_per_grid_px * px_per_m @ GROUND_FROM_GRID, uv_px
    return out


def _through(homography: Float, uv_px: Float) -> Float:
    """The homography, moved in the picture so that the grid's origin falls on ``uv_px``."""
    move = np.eye(3)
    move[:2, 2] = uv_px - mapped(homography, np.zeros(2))
    out: Float = move @ homography
    return out


def coarser(homography: Float, step: int) -> Float:
    """The homography (3, 3) from a grid of ``step`` times the step."""
    out: Float = homography @ np.diag([float(step), float(step), 1.0])
    return out


def _away(offset_px: Float, others: Sequence[Float]) -> float:
    """Distance to the nearest of other offsets (2,)."""
    return float(np.min(np.hypot(*(np.stack(others) - offset_px).T))) if others else math.inf


def _about(turn_rad: float, step_rad: float) -> tuple[float, ...]:
    return (turn_rad - step_rad, turn_rad, turn_rad + step_rad)


def _best(
    appearance: Appearance, piece: Image, likeness: Float32, area: SearchArea
) -> tuple[Float32, NDArray[np.intp]]:
    """The best score at each place and which turn and scale has it."""
    share = np.float32(0.25 + 0.35 * appearance.distinct)
    layers = []
    for turn in area.turns_rad:
        for scale in area.scales:
            correlation, contrast = appearance.fit(piece, likeness, appearance.turned(turn, scale), area.driven)
            layers.append((1 - share) * correlation + share * contrast)
    stack = np.stack(layers)
    which = np.asarray(stack.argmax(axis=0))
    return np.asarray(np.take_along_axis(stack, which[None], axis=0)[0], np.float32), which


def _subpixel(score: Float32, row: int, col: int, least_std_px: float) -> tuple[Float, Float]:
    """The vertex (2,) right and down of the parabolas through a peak and its neighbours, and covariance (2, 2).

    The better the fit and the sharper the peak, the surer: what the score lacks of 1 is taken for noise of its slope.
    """
    step, std = np.zeros(2), np.full(2, 3.0)
    for axis, (before, after) in enumerate((((row, col - 1), (row, col + 1)), ((row - 1, col), (row + 1, col)))):
        if not all(0 <= r < score.shape[0] and 0 <= c < score.shape[1] for r, c in (before, after)):
            continue
        low, top, high = (float(score[at]) for at in (before, (row, col), after))
        bend = 2.0 * top - low - high
        if bend > 1e-4:
            step[axis] = float(np.clip(0.5 * (high - low) / bend, -0.5, 0.5))
            std[axis] = float(np.clip(0.12 * (1.0 - top) / bend, 0.0, 3.0))
    return step, np.diag(np.hypot(std, least_std_px) ** 2)
