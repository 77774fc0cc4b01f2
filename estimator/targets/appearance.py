"""What a target looks like: a template with colour and shape on a north-up grid of the ground, and how well places fit.

Two measures are added, as template and colour statistics fail under different changes (Bertinetto et al., Staple:
complementary learners for real-time tracking, CVPR 2016, section 3): normalised cross-correlation over the target and
a rim of ground, which light does not change; and how much more of the target's colour lies inside its silhouette than
around it, which other ground under it does not change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.targets.silhouette import silhouette
from estimator.types import Float, Image

Float32 = NDArray[np.float32]
GROUND_FROM_GRID: Float = np.array([[0.0, -1.0], [1.0, 0.0]])
"""North and east of a step right and down on the grid."""
RIM_PX, RING_PX = 2, 6
RIMLESS = 0.1
"""What a correlation without the rim is worth less: more looks like it."""
FAR_PX = 1500.0
_BINS = (16, 32, 32)
_STD_LAB = np.array([13.0, 4.5, 4.5])


@dataclass(frozen=True, slots=True, eq=False)
class GridView:
    """A piece (rows, cols, 3) of a picture, resampled to a grid, and which of it the picture shows.

    ``low_px`` (2,) is where its first pixel lies, right and down of the place that the grid is about.
    """

    image: Image
    known: NDArray[np.uint8]
    whole: bool
    low_px: NDArray[np.intp]

    @property
    def half_px(self) -> int:
        """Of a square: how far it reaches."""
        return int(self.image.shape[0]) // 2


def square_about(half_px: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The box of 2 ``half_px`` + 1 about a place."""
    return np.array([-half_px, -half_px]), np.array([half_px, half_px])


def mapped(homography: Float, points: Float) -> Float:
    """Points (..., 2) under a homography (3, 3); NaN where they go through infinity."""
    out = points @ homography[:, :2].T + homography[:, 2]
    denominator = out[..., 2:] * np.sign(homography[2, 2])
    result: Float = out[..., :2] * np.sign(homography[2, 2]) / np.where(denominator > 1e-6, denominator, np.nan)
    return result


def picture_box(image: Image, picture_from_grid: Float) -> tuple[Float, Float]:
    """The box on the grid that holds the whole picture, as far as it shows the grid's plane."""
    width, height = image.shape[1] - 1.0, image.shape[0] - 1.0
    corners = mapped(
        np.asarray(np.linalg.inv(picture_from_grid), np.float64),
        np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]),
    )
    far = FAR_PX * np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])
    corners = np.where(np.isfinite(corners), corners, far)
    return np.maximum(corners.min(axis=0), -FAR_PX), np.minimum(corners.max(axis=0), FAR_PX)


def grid_from_picture(
    image: Image, picture_from_grid: Float, box: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> GridView:
    """The picture on a grid with ``picture_from_grid`` (3, 3), from the box's first to its last pixel."""
    low, high = box
    cols, rows = (high - low + 1).tolist()
    shift = np.array([[1.0, 0.0, low[0]], [0.0, 1.0, low[1]], [0.0, 0.0, 1.0]])
    there = picture_from_grid @ shift
    corners = mapped(there, np.array([[0.0, 0.0], [cols - 1, 0.0], [0.0, rows - 1], [cols - 1, rows - 1]]))
    limit = np.array([image.shape[1] - 1, image.shape[0] - 1])
    whole = bool((corners >= 0.0).all() and (corners <= limit).all())
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(image, there, (cols, rows), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    if seen.ndim == 2:
        seen = cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR)
    known = np.ones((rows, cols), np.uint8)
    if not whole:
        ones = np.full(image.shape[:2], 255, np.uint8)
        known = (
            cv2.warpPerspective(ones, there, (cols, rows), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP) > 0
        ).astype(np.uint8)
    return GridView(np.asarray(seen, np.uint8), known, whole, low)


class ColourModel:
    """How much likelier a colour is the target's than the ground's, by kernel density in CIE L*a*b*, as a table."""

    def __init__(self, patch: Image, inside: NDArray[np.uint8], around: NDArray[np.uint8]) -> None:
        lab = np.asarray(cv2.cvtColor(patch, cv2.COLOR_BGR2LAB), np.uint8)
        target = _density(lab[inside > 0])
        ground = _density(lab[around > 0])
        self._table = (target / (target + ground + 1e-4 * target.max())).astype(np.float32)

    def likeness(self, image: Image, gain: float) -> Float32:
        """Probability (rows, cols) that a pixel is of the target; ``gain`` is the brightness over that at the start."""
        even = image if abs(gain - 1.0) < 0.02 else cv2.convertScaleAbs(image, alpha=1.0 / gain)
        lab = np.asarray(cv2.cvtColor(even, cv2.COLOR_BGR2LAB), np.uint8)
        out: Float32 = self._table[_bins(lab)]
        return out


def _bins(lab: Image) -> NDArray[np.intp]:
    value = lab.astype(np.intp)
    a, b = np.clip((value[..., 1] - 64) >> 2, 0, 31), np.clip((value[..., 2] - 64) >> 2, 0, 31)
    return np.asarray(((value[..., 0] >> 4) * _BINS[1] + a) * _BINS[2] + b, np.intp)


def _density(lab: Image) -> Float32:
    """Smoothed histogram of colours (n, 3), flat; each axis on its own as the kernel is a product."""
    counts = np.bincount(_bins(lab), minlength=math.prod(_BINS)).astype(np.float32).reshape(_BINS)
    for axis, (std, step) in enumerate(zip(_STD_LAB, (16.0, 4.0, 4.0), strict=True)):
        at = np.arange(counts.shape[axis])
        kernel = np.exp(-0.5 * ((at[:, None] - at[None, :]) * step / std) ** 2).astype(np.float32)
        counts = np.moveaxis(np.tensordot(kernel, counts, axes=(1, axis)), 0, axis)
    return np.asarray(counts.ravel() / max(float(counts.sum()), 1e-9), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class TurnedTemplate:
    """The template at one turn and scale: picture, the mask that correlates, and the silhouette's kernel."""

    image: Image
    mask: NDArray[np.uint8]
    kernel: Float32
    inside: NDArray[np.uint8]


class Appearance:
    """The target as it was clicked, to be found at other turns and scales."""

    def __init__(self, patch: Image, size_px: float, inside: NDArray[np.uint8] | None = None) -> None:
        """``patch`` (2 h + 1, 2 h + 1, 3) about the target, h at least ``size_px`` + ``RING_PX``."""
        self.size_px = size_px
        self._patch = patch
        self._inside = silhouette(patch, size_px) if inside is None else inside
        away = cv2.distanceTransform(1 - self._inside, cv2.DIST_L2, 5)
        self._mask = (away <= RIM_PX).astype(np.uint8)
        self._ring = ((away > RIM_PX - 0.5) & (away <= RING_PX)).astype(np.uint8)
        wide = ((away > RIM_PX - 0.5) & (away <= 0.6 * size_px + RING_PX)).astype(np.uint8)
        self.colour = ColourModel(patch, self._inside, wide)
        reach = np.argwhere(self._ring)
        self.half_px = int(np.abs(reach - patch.shape[0] // 2).max()) + 2
        self.half_px = min(self.half_px, patch.shape[0] // 2)
        self._turned: dict[tuple[int, int], TurnedTemplate] = {}
        ring_share = self._contrast(self.colour.likeness(patch, 1.0))
        self._contrast_0 = max(ring_share, 0.05)
        self.distinct = float(np.clip(ring_share / 0.5, 0.0, 1.0))
        self.mean_lab = self.mean_colour(patch, self._inside)
        self.axis_rad, self.elongation = _axis(self._inside.astype(np.float32))

    def halved(self) -> Appearance:
        """The same on a grid of twice the step."""
        half = self._patch.shape[0] // 2
        even = half - half % 2  # so that the middle stays one
        cut = slice(half - even, half + even + 1)
        patch = cv2.GaussianBlur(self._patch, (0, 0), 0.8)[cut, cut][::2, ::2]
        inside = (cv2.GaussianBlur(self._inside.astype(np.float32), (0, 0), 0.8)[cut, cut][::2, ::2] > 0.5).astype(
            np.uint8
        )
        middle = inside.shape[0] // 2
        inside[middle, middle] = 1
        small = Appearance(np.ascontiguousarray(patch), 0.5 * self.size_px, inside)
        small.colour = self.colour
        return small

    @property
    def area_px(self) -> int:
        """Size of the silhouette."""
        return int(self._inside.sum())

    @staticmethod
    def mean_colour(image: Image, inside: NDArray[np.uint8]) -> Float:
        """Mean CIE L*a*b* (3,) of what is inside, OpenCV's 8-bit units."""
        return np.asarray(cv2.mean(cv2.cvtColor(image, cv2.COLOR_BGR2LAB), mask=inside)[:3])

    def turned(self, turn_rad: float, scale: float = 1.0) -> TurnedTemplate:
        """The template turned clockwise on the north-up grid, and enlarged."""
        key = (round(math.degrees(turn_rad)) % 360, round(scale * 100))
        if key not in self._turned:
            self._turned[key] = self._turn(math.radians(key[0]), key[1] / 100.0)
        return self._turned[key]

    def _turn(self, turn_rad: float, scale: float) -> TurnedTemplate:
        half, from_half = self.half_px, self._patch.shape[0] // 2
        c, s = math.cos(turn_rad) / scale, math.sin(turn_rad) / scale
        # from the turned grid back to the first; rows run down, so a clockwise turn is (c, -s; s, c)
        back = np.array([[c, s], [-s, c]])
        affine = np.column_stack((back, from_half - back @ np.array([half, half], dtype=np.float64)))
        size = (2 * half + 1, 2 * half + 1)
        flags = cv2.WARP_INVERSE_MAP

        def warped(what: Image, how: int) -> Image:
            return np.asarray(cv2.warpAffine(what, affine, size, flags=flags | how, borderMode=cv2.BORDER_REPLICATE))

        inside, mask = warped(self._inside, cv2.INTER_NEAREST), warped(self._mask, cv2.INTER_NEAREST)
        ring = warped(self._ring, cv2.INTER_NEAREST).astype(np.float32)
        kernel = inside / max(float(inside.sum()), 1.0) - ring / max(float(ring.sum()), 1.0)
        return TurnedTemplate(warped(self._patch, cv2.INTER_LINEAR), mask, kernel.astype(np.float32), inside)

    def _contrast(self, likeness: Float32) -> float:
        return float(likeness[self._inside > 0].mean() - likeness[self._ring > 0].mean())

    def fit(
        self, image: Image, likeness: Float32, template: TurnedTemplate, driven: bool = False
    ) -> tuple[Float32, Float32]:
        """Correlation and colour contrast (rows - 2 h, cols - 2 h) of a piece of the grid, 1 for the click itself.

        Of what may have ``driven`` onto darker or lighter ground the silhouette is compared alone as well.
        """
        correlation = _correlation(image, template.image, template.mask)
        if driven:
            correlation = np.maximum(correlation, _correlation(image, template.image, template.inside) - RIMLESS)
        return correlation, self.contrast(likeness, template)

    @staticmethod
    def correlation(grey: Float32, template: TurnedTemplate) -> Float32:
        """That of a grey picture alone (rows - 2 h, cols - 2 h), normalised over a square of the mask's size."""
        inside = template.mask > 0
        shape = cv2.cvtColor(template.image, cv2.COLOR_BGR2GRAY).astype(np.float32)
        kernel = np.where(inside, shape - float(shape[inside].mean()), 0.0).astype(np.float32)
        kernel /= max(float(np.linalg.norm(kernel)), 1e-6)
        response = cv2.matchTemplate(grey, kernel, cv2.TM_CCORR)
        side, h = max(3, 2 * round(0.5 * math.sqrt(float(inside.sum()))) + 1), kernel.shape[0] // 2
        mean, square = (cv2.boxFilter(one, -1, (side, side)) for one in (grey, grey * grey))
        spread = np.sqrt(np.maximum(square - mean * mean, 1.0))[h : h + response.shape[0], h : h + response.shape[1]]
        out: Float32 = (response / (spread * math.sqrt(float(inside.sum())))).astype(np.float32)
        return out

    def contrast(self, likeness: Float32, template: TurnedTemplate) -> Float32:
        """The second of the two alone."""
        contrast = cv2.matchTemplate(likeness, template.kernel, cv2.TM_CCORR)
        return np.asarray(np.clip(contrast / self._contrast_0, -1.0, 1.0), np.float32)

    def turns_like(self, likeness: Float32, row: int, col: int, turns: tuple[float, ...]) -> tuple[float, ...]:
        """Those of the turns that lay the silhouette's long axis along that of the colour about a place."""
        r = max(3, round(0.55 * self.size_px))
        around = likeness[max(row - r, 0) : row + r + 1, max(col - r, 0) : col + r + 1]
        axis, elongation = _axis(np.where(around > 0.5, around, 0.0).astype(np.float32))
        if elongation < 1.35 or self.elongation < 1.35:
            return turns
        slack = math.radians(20.0)
        near = [t for t in turns if abs(math.remainder(t + self.axis_rad - axis, math.pi)) <= slack]
        return tuple(near)

    def blobs(self, likeness: Float32, most: int) -> list[tuple[int, int]]:
        """Places (row, column) where about as much of the target's colour lies as it has, whatever its turn."""
        side = max(3, 2 * round(0.4 * math.sqrt(self.area_px)) + 1)
        inner = cv2.boxFilter(likeness, -1, (side, side))
        outer = cv2.boxFilter(likeness, -1, (2 * self.half_px + 1, 2 * self.half_px + 1))
        score = np.asarray(inner - 0.7 * outer, np.float32)
        return peaks(score, most, max(2, round(0.3 * self.size_px)))


def _correlation(image: Image, template: Image, mask: NDArray[np.uint8]) -> Float32:
    out = cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED, mask=mask)
    return np.where(np.isfinite(out), np.clip(out, -1.0, 1.0), -1.0).astype(np.float32)


def _axis(weight: Float32) -> tuple[float, float]:
    """Direction of the long axis of a weighted shape, clockwise from the grid's right, and long over short extent."""
    v, u = np.mgrid[0 : weight.shape[0], 0 : weight.shape[1]].astype(np.float32)
    total = max(float(weight.sum()), 1e-6)
    du, dv = u - float((weight * u).sum()) / total, v - float((weight * v).sum()) / total
    uu, vv = float((weight * du * du).sum()) / total, float((weight * dv * dv).sum()) / total
    uv = float((weight * du * dv).sum()) / total
    spread = math.hypot(uu - vv, 2.0 * uv)
    long, short = 0.5 * (uu + vv + spread), 0.5 * (uu + vv - spread)
    return 0.5 * math.atan2(2.0 * uv, uu - vv), math.sqrt(long / max(short, 0.1))


def peaks(score: Float32, most: int, apart_px: int) -> list[tuple[int, int]]:
    """The ``most`` highest local maxima (row, column), at least ``apart_px`` apart, best first."""
    kernel = np.ones((2 * apart_px + 1, 2 * apart_px + 1), np.uint8)
    top = (score >= cv2.dilate(score, kernel, borderValue=-2.0)) & (score > -0.99)
    rows, cols = np.nonzero(top)
    order = np.argsort(-score[rows, cols], kind="stable")[: 4 * most]
    out: list[tuple[int, int]] = []
    for i in order:
        place = (int(rows[i]), int(cols[i]))
        if all(max(abs(place[0] - r), abs(place[1] - c)) > apart_px for r, c in out):
            out.append(place)
        if len(out) == most:
            break
    return out
