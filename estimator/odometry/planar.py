"""Visual odometry over known ground with the rotation known.

With the attitude given, every track says the same thing: where the camera has moved, once its two rays are cut with the
ground. Conte 2009, section 5.6, solves the planar homography for the translation; cutting the rays with a terrain model
instead drops the plane, and the residual stays linear in every error that matters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estimator.geometry.ground import ground_point_by_pose
from estimator.robust import NORMAL_BY_MAD, robust_std
from estimator.types import Float

MIN_TRACKS = 10
MIN_INLIER_FRACTION = 0.4
MIN_DOWN = 0.15
"""Least downward part of a ray that may count as one to the ground."""
MIN_PARALLAX = 0.005
"""Share of the height that the camera must move for its tracks to say anything of the surface's relief."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownHeights:
    """Down (n,) of points that is known better than by the ground model, and what its error has in common.

    The error of point i is ``by_error[i]`` (n, k) times k common ones, and one of its own of ``std_m[i]``.
    """

    down_m: Float
    std_m: Float
    by_error: Float


@dataclass(frozen=True, slots=True, eq=False)
class MomentResidual:
    """How the tracks turn and spread about their middle against the motion predicted, with its linear model.

    ``residual`` (2,) is the turn in radians, positive from north to east, and the growth as a share. ``by_pose_first``
    and ``by_pose_second`` (2, 6) are its derivatives by camera position NED and by the camera's rotation error about
    the NED axes, ``by_heights`` (2, k) by the common errors of known heights.
    """

    residual: Float
    by_pose_first: Float
    by_pose_second: Float
    by_heights: Float
    cov: Float


@dataclass(frozen=True, slots=True, eq=False)
class DisplacementResidual:
    """Mean disagreement of the tracks with the predicted motion, with its linear model.

    ``residual_ne_m`` (2,) is the mean over tracks of (ground point by the first ray) minus (by the second).
    ``by_pos_first``, ``by_pos_second`` (2, 3) and ``by_rotation_first``, ``by_rotation_second`` (2, 3) are its
    derivatives by camera position NED and by the camera's rotation error about the NED axes, ``by_ground`` (2, 1) by
    how far the surface lies below the ground model: it scales the motion, and of all errors lasts the longest.
    ``cov_m2`` (2, 2). ``relief_m`` is the standard deviation of the seen surface's height about the ground model, from
    how much more the tracks scatter along the motion, where height shows, than across, or from the known heights
    themselves where these tell more; infinite where that is unknown.

    Where the points' heights are known ``by_heights`` (2, k) are the derivatives by their common errors, in place of
    ``by_ground``; ``below_m`` is how far their mean lies below the ground model, with its variance and its derivatives
    ``below_by_heights`` (1, k); and ``moments``, where asked for, is what the tracks say beyond their mean.
    """

    residual_ne_m: Float
    by_pos_first: Float
    by_pos_second: Float
    by_rotation_first: Float
    by_rotation_second: Float
    by_ground: Float
    cov_m2: Float
    tracks: int
    inlier_fraction: float
    relief_m: float
    by_heights: Float | None = None
    below_m: float = float("nan")
    below_variance_m2: float = float("inf")
    below_by_heights: Float | None = None
    moments: MomentResidual | None = None


def independent(count: int) -> float:
    """How many of ``count`` tracks count: neighbours share what relief, lens and codec do to them, denser ones more."""
    return min(max(count / 3.0, 1.0), 50.0)


def residual_of_points(
    mean_ne_m: Float, cov_m2: Float, slope_first: Float, slope_second: Float, height_first_m: Float,
    height_second_m: Float, offered: int, used: int | None = None, relief_m: float = float("inf"),
) -> DisplacementResidual:  # fmt: skip
    """A residual (2,) with its linear model at ground points, by their slopes (n, 2) and depths (n,) in both cameras.

    ``offered`` tracks there were, and ``used`` of them (the number of points unless said) agree.
    """
    by_first = ground_point_by_pose(slope_first, height_first_m).mean(axis=0)
    by_second = -ground_point_by_pose(slope_second, height_second_m).mean(axis=0)
    count = len(slope_first) if used is None else used
    return DisplacementResidual(
        mean_ne_m, by_first[:, :3], by_second[:, :3], by_first[:, 3:], by_second[:, 3:],
        (slope_first - slope_second).mean(axis=0)[:, None],
        cov_m2, count, count / offered, relief_m,
    )  # fmt: skip


def displacement_residual(
    rays_first: Float, rays_second: Float, pos_first_ned_m: Float, pos_second_ned_m: Float,
    down_at: Callable[[Float, Float], Float], pixel_std_rad: float, relative_std: float,
    known: KnownHeights | None = None, with_moments: bool = False,
) -> DisplacementResidual | None:  # fmt: skip
    """Compare the motion that tracks show with the motion predicted.

    Parameters
    ----------
    rays_first, rays_second
        Unit rays (n, 3) in NED of the same points from the first and the second camera.
    pos_first_ned_m, pos_second_ned_m
        Predicted camera positions (3,).
    down_at
        Down coordinate of the ground at (north, east).
    pixel_std_rad
        Angular noise of one track.
    relative_std
        Part of the displacement that relief and lens leave unmodelled.
    known
        Heights of the n points where they are known better than by the ground model.
    with_moments
        Whether to fit what known points say beyond their mean too.

    Returns
    -------
    DisplacementResidual or None
        None when too few tracks agree.
    """
    usable = (rays_first[:, 2] > MIN_DOWN) & (rays_second[:, 2] > MIN_DOWN)
    if usable.sum() < MIN_TRACKS:
        return None
    first, second = rays_first[usable], rays_second[usable]
    slope_first = first[:, :2] / first[:, 2:]
    slope_second = second[:, :2] / second[:, 2:]
    # the first ray's ground point, its height looked up twice: the slope of the ground is small
    down = down_at(np.full(len(first), pos_first_ned_m[0]), np.full(len(first), pos_first_ned_m[1]))
    for _ in range(2):
        ground_ne = pos_first_ned_m[:2] + slope_first * (down - pos_first_ned_m[2])[:, None]
        looked_up = down_at(ground_ne[:, 0], ground_ne[:, 1])
        down = np.where(np.isfinite(looked_up), looked_up, down)
    below_m = np.zeros(len(down)) if known is None else known.down_m[usable] - down
    down = down + below_m
    height_first = down - pos_first_ned_m[2]
    height_second = down - pos_second_ned_m[2]
    if not (height_first > 0.5).all() or not (height_second > 0.5).all():
        return None
    point_first = pos_first_ned_m[:2] + slope_first * height_first[:, None]
    point_second = pos_second_ned_m[:2] + slope_second * height_second[:, None]
    residuals = point_first - point_second
    inlier = _inliers(residuals, pixel_std_rad * float(np.median(height_second)))
    count = int(inlier.sum())
    if count < MIN_TRACKS or count < MIN_INLIER_FRACTION * len(residuals):
        return None
    mean = residuals[inlier].mean(axis=0)
    scatter = np.cov(residuals[inlier].T)
    displacement = float(np.hypot(*(pos_second_ned_m - pos_first_ned_m)[:2]))
    cov = scatter / independent(count) + np.eye(2) * ((relative_std * displacement) ** 2 + 1e-4)
    # The derivatives are taken where the second rays are predicted, not where they were measured: a noise that stands
    # in both residual and Jacobian would drag height and ground, a little with every picture, to one side. So for known
    # heights: to raise cameras and surface together must change nothing, or that direction, never observed, drifts.
    expected = (point_first - pos_second_ned_m[:2]) / height_second[:, None]
    # the relief is that about the ground model: what was known of each point's height is put back
    by_model = residuals - (slope_first - slope_second) * below_m[:, None]
    relief_m = _relief_m(by_model, pos_second_ned_m - pos_first_ned_m, float(np.median(height_second)))
    residual = residual_of_points(
        mean, cov, slope_first[inlier], expected[inlier], height_first[inlier], height_second[inlier],
        len(residuals), relief_m=relief_m,
    )  # fmt: skip
    if known is None:
        return residual
    by_error = known.by_error[usable][inlier]
    by_heights = (slope_first - expected)[inlier][:, :, None] * by_error[:, None]
    variance_m2 = float(np.var(below_m[inlier]))
    own_m2 = float(np.mean(known.std_m[usable][inlier] ** 2))
    return replace(
        residual,
        by_heights=by_heights.mean(axis=0),
        below_m=float(below_m[inlier].mean()),
        below_variance_m2=variance_m2 / independent(count),
        relief_m=max(relief_m, float(np.sqrt(max(variance_m2 - own_m2, 0.0)))),
        below_by_heights=by_error.mean(axis=0)[None],
        moments=_moments(
            point_first[inlier], residuals[inlier], ground_point_by_pose(slope_first[inlier], height_first[inlier]),
            ground_point_by_pose(expected[inlier], height_second[inlier]), by_heights, relative_std * displacement,
        ) if with_moments else None,
    )  # fmt: skip


def _moments(
    points_ne_m: Float, residuals_ne_m: Float, by_first: Float, by_second: Float, by_heights: Float, floor_m: float
) -> MomentResidual | None:
    """Turn and growth that fit the residuals (n, 2) of points (n, 2) best, about the points' middle.

    Least squares of r = a + w (east, north)' x + s x: about the middle the three are independent of each other.
    """
    x = points_ne_m - points_ne_m.mean(axis=0)
    square = float(np.sum(x**2))
    if square < 1.0:
        return None
    weights = np.stack((np.column_stack((-x[:, 1], x[:, 0])), x)) / square
    residual = np.einsum("kni,ni->k", weights, residuals_ne_m)
    left = residuals_ne_m - residuals_ne_m.mean(axis=0)
    left = left - square * np.einsum("kni,k->ni", weights, residual)
    count = len(x)
    # as for the mean, and something is left unmodelled that they have in common
    variance = count / independent(count) * float(np.mean(left**2)) / square + (floor_m**2 + 1e-4) * count / square
    return MomentResidual(
        residual, np.einsum("kni,nij->kj", weights, by_first), -np.einsum("kni,nij->kj", weights, by_second),
        np.einsum("kni,nij->kj", weights, by_heights), np.eye(2) * variance,
    )  # fmt: skip


def _relief_m(residuals_ne_m: Float, motion_ned_m: Float, height_m: float) -> float:
    """Scatter of the surface's height: a point higher by z moves by a share z / h more, along the motion alone."""
    distance_m = float(np.hypot(*motion_ned_m[:2]))
    if distance_m < MIN_PARALLAX * height_m:
        return float("inf")
    along = motion_ned_m[:2] / distance_m
    by_height = robust_std(residuals_ne_m @ along)
    noise = robust_std(residuals_ne_m @ np.array([-along[1], along[0]]))
    # the difference of two measured variances is known to about a tenth of them
    excess = max(by_height**2 - noise**2, (0.3 * noise) ** 2)
    return float(np.sqrt(excess)) * height_m / distance_m


def _inliers(residuals: Float, noise_m: float) -> np.ndarray:
    centre = np.median(residuals, axis=0)
    for _ in range(2):
        distance = np.hypot(*(residuals - centre).T)
        limit = max(3.0 * NORMAL_BY_MAD * float(np.median(distance)), 3.0 * noise_m)
        inlier = distance <= limit
        centre = residuals[inlier].mean(axis=0)
    return np.asarray(inlier)
