"""How well can each place of a map be matched? Predicted from the map alone.

A picture of a place is compared with the map by double-angle gradients, and the similarity becomes a likelihood
(``likelihood``). What a good picture would give is the map's own piece compared with its neighbourhood: a sharp hill
where there is structure in every direction, a ridge along a lone road, several hills where a pattern repeats. Between
two epochs edges persist and grain does not, so the expected similarity is the share of the structure that is strong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.registration.calibration import calibration_of
from estimator.registration.channels import double_angle_gradients
from estimator.registration.correlation import SearchArea
from estimator.registration.likelihood import LikelihoodCalibration
from estimator.robust import largest_std, robust_std
from estimator.types import Float, Image


@dataclass(frozen=True, slots=True)
class MatchabilityConfig:
    """``footprint_m`` is the side of what a picture shows, ``radius_m`` how far off the prediction may be.

    ``template_px`` bounds the resolution. ``persistence`` is the similarity that an area of nothing but strong edges
    would have with another epoch; ``clutter`` the deviation of chance similarities times the root of the pixels.
    A piece with ``ambiguous`` of its probability elsewhere is called ambiguous, one whose expected peak is lower than
    ``weak_peak`` deviations of the clutter is called weak in texture.
    """

    footprint_m: float = 100.0
    radius_m: float = 40.0
    step_share: float = 0.25
    template_px: int = 64
    main_mode_px: float = 6.0
    persistence: float = 0.9
    clutter: float = 2.2
    ambiguous: float = 0.2
    weak_peak: float = 5.0
    calibration: LikelihoodCalibration = field(default_factory=lambda: calibration_of("double_angle").likelihood)

    def __post_init__(self) -> None:
        if not (self.footprint_m > 0.0 and self.radius_m > 0.0 and 0.0 < self.step_share <= 1.0):
            message = "footprint, radius and step must be positive"
            raise ValueError(message)


GOOD, AMBIGUOUS, WEAK = 0, 1, 2

GRAIN = 600.0
"""Squared Sobel response of an edge of about eight grey levels; the grain of bare ground stays below."""


@dataclass(frozen=True, slots=True, eq=False)
class Matchability:
    """One value for each place; grids (rows, cols), NaN or 255 where too little of the map is known.

    ``sigma_m`` is the expected standard deviation of the position along the worst axis, ``elsewhere`` the expected
    probability of other places than the right one, ``peak`` the expected height of the peak in deviations of
    the clutter, and ``kind`` is GOOD, AMBIGUOUS (repetition) or WEAK (lack of texture). The centre of entry (i, j) lies
    ``first_px`` + i ``step_px`` pixels of the map down and as many across.
    """

    sigma_m: NDArray[np.float32]
    elsewhere: NDArray[np.float32]
    peak: NDArray[np.float32]
    kind: NDArray[np.uint8]
    first_px: float
    step_px: float


def matchability(
    image: Image, valid: NDArray[np.bool_], gsd_m: float, config: MatchabilityConfig | None = None,
    progress: Callable[[float], None] | None = None,
) -> Matchability:  # fmt: skip
    """Predict for every place of a grey map (rows, cols) of square pixels.

    Raises
    ------
    ValueError
        The map is smaller than a footprint with its surroundings, or the footprint spans fewer than 16 pixels.
    """
    config = config or MatchabilityConfig()
    ratio = max(1.0, config.footprint_m / config.template_px / gsd_m)
    step_m = gsd_m * ratio
    side, reach = round(config.footprint_m / step_m), max(4, round(config.radius_m / step_m))
    if side < 16:
        message = f"a footprint of {config.footprint_m:g} m spans {side} pixels of {step_m:g} m; 16 are needed"
        raise ValueError(message)
    picture, known = _reduced(image, valid, ratio)
    if min(picture.shape) < side:
        message = f"the map is {min(picture.shape) * step_m:.0f} m wide, a footprint {config.footprint_m:g} m"
        raise ValueError(message)
    # what lies off the map is unknown, not an obstacle: places at its rim see what is left of their surroundings
    picture = np.asarray(cv2.copyMakeBorder(picture, reach, reach, reach, reach, cv2.BORDER_REPLICATE), dtype=np.uint8)
    known = cv2.copyMakeBorder(known.astype(np.uint8), reach, reach, reach, reach, cv2.BORDER_CONSTANT, value=0) > 0
    channels, lasting = double_angle_gradients(picture), _lasting(picture)
    stride = max(1, round(side * config.step_share))
    tops = np.arange(0, picture.shape[0] - side - 2 * reach + 1, stride)
    lefts = np.arange(0, picture.shape[1] - side - 2 * reach + 1, stride)
    shape = (len(tops), len(lefts))
    sigma, elsewhere, peak = (np.full(shape, np.nan, dtype=np.float32) for _ in range(3))
    for i, top in enumerate(tops):
        for j, left in enumerate(lefts):
            size = side + 2 * reach
            around = channels[:, top : top + size, left : left + size]
            there = known[top : top + size, left : left + size]
            inner = (slice(reach, reach + side), slice(reach, reach + side))
            if there[inner].mean() < 0.7:
                continue
            place = (slice(top, top + size), slice(left, left + size))
            sigma[i, j], elsewhere[i, j], peak[i, j] = _expected(around, there, lasting[place], inner, step_m, config)
        if progress is not None:
            progress((i + 1) / len(tops))
    kind = np.where(peak < config.weak_peak, WEAK, np.where(elsewhere > config.ambiguous, AMBIGUOUS, GOOD))
    kind = np.where(np.isnan(sigma), 255, kind).astype(np.uint8)
    return Matchability(sigma, elsewhere, peak, kind, (0.5 * side) * ratio - 0.5, stride * ratio)


def _expected(
    around: NDArray[np.float32], known: NDArray[np.bool_], lasting: NDArray[np.float32], inner: tuple[slice, slice],
    step_m: float, config: MatchabilityConfig,
) -> tuple[float, float, float]:  # fmt: skip
    """Expected sigma, probability elsewhere, and peak of a piece in its surroundings."""
    template, mask = around[(slice(None), *inner)], known[inner]
    area = SearchArea(around, known, (template.shape[1], template.shape[2]))
    surface = area.correlate(template, mask).astype(np.float64)
    strength = np.sqrt((template * template).sum(axis=0))[mask]
    energy = float((strength**2).sum())
    # a pixel's chance to show the same edge in another epoch goes with its strength among its like, and over grain
    same = float((strength**3 * lasting[inner][mask]).sum())
    expected = config.persistence * same / energy if energy > 0.0 else 0.0
    middle = surface.shape[0] // 2
    rows, cols = np.mgrid[: surface.shape[0], : surface.shape[1]]
    offset_m = np.stack((middle - rows, cols - middle), axis=-1) * step_m
    distance_px = np.linalg.norm(offset_m, axis=-1) / step_m
    usable = np.isfinite(surface) & (distance_px <= middle)
    away = usable & (distance_px > config.main_mode_px)
    chance = config.clutter / np.sqrt(max(float(mask.sum()), 1.0))
    # lines and repetition add to chance what the surface itself shows away from its hill
    own = robust_std(surface[away]) if away.sum() > 20 else 0.0
    clutter = float(np.hypot(chance, expected * own))
    peak = expected / clutter
    log_p = (
        config.calibration.temperature
        * peak ** (1.0 + config.calibration.power)
        * np.where(usable, surface - 1.0, -np.inf)
    )
    p = np.exp(log_p)
    spread_px = float(np.hypot(config.calibration.map_std_m / step_m, config.calibration.map_std_px))
    blurred = cv2.GaussianBlur(p, (0, 0), spread_px, borderType=cv2.BORDER_CONSTANT)
    p = np.asarray(blurred / blurred.sum(), dtype=np.float64)
    mean = np.einsum("ij,ijk->k", p, offset_m)
    d = offset_m - mean
    cov = np.einsum("ij,ijk,ijl->kl", p, d, d)
    return largest_std(cov), float(p[away].sum()), peak


def _lasting(picture: Image) -> NDArray[np.float32]:
    """How far gradients (rows, cols) stand over a map's own grain, 0 to 1."""
    smooth = cv2.GaussianBlur(picture, (0, 0), 1.0).astype(np.float32)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *order, ksize=3) for order in ((1, 0), (0, 1)))
    magnitude = gx * gx + gy * gy
    return np.asarray(magnitude / (magnitude + GRAIN), dtype=np.float32)


def _reduced(image: Image, valid: NDArray[np.bool_], ratio: float) -> tuple[Image, NDArray[np.bool_]]:
    if ratio <= 1.0:
        return image, valid
    size = (max(1, int(image.shape[1] / ratio)), max(1, int(image.shape[0] / ratio)))
    matrix = np.array([[ratio, 0.0, 0.5 * (ratio - 1.0)], [0.0, ratio, 0.5 * (ratio - 1.0)]])
    smooth = cv2.GaussianBlur(image, (0, 0), max(0.4 * ratio, 0.3))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    picture = cv2.warpAffine(smooth, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    known = cv2.warpAffine(valid.astype(np.uint8), matrix, size, flags=flags) > 0
    return np.asarray(picture, dtype=np.uint8), np.asarray(known)


def at_place(layer: NDArray[np.float32], result: Matchability, row_px: Float, col_px: Float) -> Float:
    """A layer's values (...) at pixels of the map, of the nearest entry; NaN beyond the grid."""
    i = np.rint((np.asarray(row_px) - result.first_px) / result.step_px).astype(int)
    j = np.rint((np.asarray(col_px) - result.first_px) / result.step_px).astype(int)
    inside = (i >= 0) & (j >= 0) & (i < layer.shape[0]) & (j < layer.shape[1])
    found = layer[np.clip(i, 0, layer.shape[0] - 1), np.clip(j, 0, layer.shape[1] - 1)]
    return np.asarray(np.where(inside, found, np.nan), dtype=np.float64)
