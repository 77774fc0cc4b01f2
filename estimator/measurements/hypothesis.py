"""A hypothesis of where a mosaic lies on the map, followed from one piece of ground to the next.

The hypothesis is a similarity: true = anchor + ratio (mosaic - anchor in the mosaic), in complex numbers, north + i
east, so that turn and scale are one factor. Over relief the scale changes: pictures follow the camera's climb and not
the ground's. How high the ground lies is known where the hypothesis places it, so that its scale there is predicted.
What is left is a random walk, and a Kalman filter over anchor and ratio (both noises are circular, so that covariances
are real) says within what reach the next piece of ground must be found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estimator.registration.global_search import Slice, Template
from estimator.registration.near_match import NearMatcher
from estimator.registration.verify import vertex
from estimator.types import Float

TURN_STEP_RAD = 0.035  # and as much of the scale's logarithm: what a piece's rim forgives


@dataclass(frozen=True, slots=True)
class FollowConfig:
    """Noises of a followed hypothesis, and what a piece of ground says.

    Of the search: ``first_std_m`` and ``first_ratio_std``. Between pieces: ``walk_std_m`` and ``walk_ratio_std``, a
    share. Of a match: ``match_std_m`` and ``match_ratio_std``. ``typical_height`` is that of a true match in the
    clutter's deviations, with which distance from what was predicted is weighed against similarity.
    The log likelihood ratio of a piece is ``slope`` (height - ``even_height``) between ``min_log_ratio`` and
    ``max_log_ratio``: a lake, or what was built since, must not decide. ``unseen_log_ratio`` counts where the map holds
    nothing to compare.
    """

    first_std_m: float = 5.0
    first_ratio_std: float = 0.04
    walk_std_m: float = 2.0
    walk_ratio_std: float = 0.02
    match_std_m: float = 3.0
    match_ratio_std: float = 0.03
    typical_height: float = 4.0
    even_height: float = 3.2
    slope: float = 1.3
    min_log_ratio: float = -2.5
    max_log_ratio: float = 5.0
    unseen_log_ratio: float = -1.0


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A piece of ground of the mosaic to be compared: its centre there, north + i east, and the camera's heights.

    ``height_m`` is the mosaic's above ground, ``pressure_alt_m`` the barometer's; ``clutter`` is what
    `NearMatcher.clutter` says of it.
    """

    template: Template
    centre_m: complex
    height_m: float
    pressure_alt_m: float
    clutter: float


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Where the mosaic lies, about one of its places, and the covariance (2, 2) of anchor and ratio.

    ``height_m``, ``pressure_alt_m`` are those with which that place was seen, ``ground_alt_m`` the map's ground there.
    """

    anchor_ne_m: complex
    anchor_mosaic_m: complex
    ratio: complex
    cov: Float
    height_m: float
    pressure_alt_m: float
    ground_alt_m: float

    @property
    def scale(self) -> float:
        """True over the mosaic's lengths."""
        return abs(self.ratio)

    @property
    def turn_rad(self) -> float:
        """What turns the mosaic's frame to north."""
        return float(np.angle(self.ratio))

    def ne_m(self, mosaic_m: complex) -> complex:
        """Where a place of the mosaic near the anchor lies."""
        return self.anchor_ne_m + self.ratio * (mosaic_m - self.anchor_mosaic_m)


Ground = Callable[[complex], float]  # altitude at north + i east, NaN where it is unknown


def first_fit(
    centre_ne_m: complex, what: Slice, piece: tuple[complex, float, float], ground: Ground, config: FollowConfig
) -> Fit:
    """What a search says of a mosaic whose centre, height and pressure altitude are ``piece``."""
    ratio = what.scale * complex(np.exp(1j * what.heading_rad))
    cov = np.diag([config.first_std_m**2, (config.first_ratio_std * what.scale) ** 2])
    return Fit(centre_ne_m, piece[0], ratio, cov, piece[1], piece[2], ground(centre_ne_m))


def predicted(
    fit: Fit, mosaic_m: complex, height_m: float, pressure_alt_m: float, ground: Ground, config: FollowConfig
) -> Fit:
    """The fit about another place of the mosaic, seen from other heights, before that place is compared."""
    step = mosaic_m - fit.anchor_mosaic_m
    ground_alt_m = ground(fit.ne_m(mosaic_m))
    growth = 1.0
    if np.isfinite(ground_alt_m) and np.isfinite(fit.ground_alt_m):
        before_m = fit.scale * fit.height_m
        now_m = before_m + (pressure_alt_m - fit.pressure_alt_m) - (ground_alt_m - fit.ground_alt_m)
        growth = float(np.clip(now_m / height_m / fit.scale, 0.8, 1.25))
    ratio = fit.ratio * growth
    anchor = fit.anchor_ne_m + 0.5 * (fit.ratio + ratio) * step
    way = abs(step)
    move = np.array([[1.0, way], [0.0, 1.0]])
    walk = (config.walk_ratio_std * abs(ratio)) ** 2
    noise = walk * np.array([[way**2 / 3.0, 0.5 * way], [0.5 * way, 1.0]])
    noise[0, 0] += config.walk_std_m**2
    cov = move @ fit.cov @ move.T + noise
    return Fit(anchor, mosaic_m, ratio, cov, height_m, pressure_alt_m, ground_alt_m)


@dataclass(frozen=True, slots=True, eq=False)
class _Match:
    """The best place found: where, with which ratio, how high, and that less what distance costs."""

    ne_m: complex
    ratio: complex
    height: float
    worth: float


def followed(
    fit: Fit, piece: Piece, matcher: NearMatcher, ground: Ground, config: FollowConfig
) -> tuple[Fit, float] | None:
    """The fit after a piece of ground, and the log likelihood ratio of "here" against "elsewhere" by that piece.

    None where the piece would lie off the map.
    """
    prior = predicted(fit, piece.centre_m, piece.height_m, piece.pressure_alt_m, ground, config)
    if not matcher.map.holds(prior.anchor_ne_m):
        return None
    loose = float(np.sqrt(prior.cov[1, 1])) / prior.scale > 0.6 * TURN_STEP_RAD
    match = _best_match(fit, prior, piece, matcher, config, loose)
    if match is None:
        return replace(prior, ground_alt_m=ground(prior.anchor_ne_m)), config.unseen_log_ratio
    gain = config.slope * (match.worth - config.even_height)
    gain = float(np.clip(gain, config.min_log_ratio, config.max_log_ratio))
    after = _updated(prior, match, config, loose)
    return replace(after, ground_alt_m=ground(after.anchor_ne_m)), gain


def _best_match(
    before: Fit, prior: Fit, piece: Piece, matcher: NearMatcher, config: FollowConfig, loose: bool
) -> _Match | None:
    """The match that is worth most about the prior, over a few turns and scales where those are loose."""
    cell_m = matcher.map.cell_m
    half = matcher.half_cells(piece.template, prior.scale * (1.0 + TURN_STEP_RAD))
    std_m = float(np.sqrt(prior.cov[0, 0]))
    reach = int(np.clip(np.ceil(2.5 * std_m / cell_m), 2, 6))
    off_m = np.arange(-reach, reach + 1) * cell_m
    far = (off_m[:, None] ** 2 + off_m[None, :] ** 2) / (std_m**2 + config.match_std_m**2)
    ratio_var = float(prior.cov[1, 1]) / prior.scale**2 + config.match_ratio_std**2
    steps = (-TURN_STEP_RAD, 0.0, TURN_STEP_RAD) if loose else (0.0,)
    best: _Match | None = None
    for turn in steps:
        for growth in steps:
            ratio = prior.ratio * complex(np.exp(growth + 1j * turn))
            # another ratio would have led elsewhere
            centre = prior.anchor_ne_m + 0.5 * (ratio - prior.ratio) * (piece.centre_m - before.anchor_mosaic_m)
            what = Slice(float(np.angle(ratio)), abs(ratio))
            found = matcher.surface(piece.template, what, np.array([centre.real, centre.imag]), reach, half)
            if found is None or float(found.similarity[reach, reach]) <= -0.999:
                continue
            height = found.similarity * (np.sqrt(found.cells) / piece.clutter)
            cost = 0.5 * (far + (turn**2 + growth**2) / ratio_var) / config.typical_height
            worth = height - cost
            r, c = (int(i) for i in np.unravel_index(int(np.argmax(worth)), worth.shape))
            if best is not None and worth[r, c] <= best.worth:
                continue
            d_r = d_c = 0.0
            if 0 < r < 2 * reach and 0 < c < 2 * reach:
                d_r = vertex(float(height[r - 1, c]), float(height[r, c]), float(height[r + 1, c]))
                d_c = vertex(float(height[r, c - 1]), float(height[r, c]), float(height[r, c + 1]))
            north_m, east_m = matcher.map.ne_m(found.row - reach + r + d_r, found.col - reach + c + d_c)
            best = _Match(complex(north_m, east_m), ratio, float(height[r, c]), float(worth[r, c]))
    return best


def _updated(prior: Fit, match: _Match, config: FollowConfig, loose: bool) -> Fit:
    """Kalman update with the place of a match and, where it was free, its ratio; a weak match counts less."""
    trust = 1.0 if match.height > 3.0 else 4.0 if match.height > 1.5 else 25.0
    variances = [config.match_std_m**2, (config.match_ratio_std * prior.scale) ** 2]
    off = np.array([match.ne_m - prior.anchor_ne_m, match.ratio - prior.ratio])
    used = 2 if loose else 1
    H = np.eye(2)[:used]
    S = H @ prior.cov @ H.T + trust * np.diag(variances[:used])
    K = prior.cov @ H.T @ np.linalg.inv(S)
    anchor_step, ratio_step = K @ off[:used]
    cov = (np.eye(2) - K @ H) @ prior.cov
    return replace(
        prior, anchor_ne_m=prior.anchor_ne_m + complex(anchor_step), ratio=prior.ratio + complex(ratio_step),
        cov=0.5 * (cov + cov.T),
    )  # fmt: skip
