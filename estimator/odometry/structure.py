"""Heights of the followed points, by their parallax since the last keyframe.

Two pictures tell motion over height, never the one without the other. But a point that has been followed for long
enough is triangulated over the way flown since then, and the height that it gets by that hands the scale of that way on
to the pictures after it, whatever stands on the ground model there: woods, roofs, a wrong model. What is left is the
slow growth of the scale's error that any visual odometry has which keeps its structure; the errors that the heights
have in common are states of the filter, so that this growth is in its covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.ground import ground_point_by_pose
from estimator.odometry.planar import MIN_DOWN, KnownHeights, independent
from estimator.robust import robust_std
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class StructureConfig:
    """When keyframes are taken, and how far to trust what they give.

    ``spacing`` is the way between keyframes as a share of the height above the ground, ``min_points`` how many points
    make a structure, and ``height_std`` what lens and drifting tracks leave of their mean height, as a share of the
    height, however many there are.
    """

    spacing: float = 0.15
    min_points: int = 20
    height_std: float = 0.0005


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """Down (n,) of points, NaN where two pictures do not give it, and the errors that they have in common.

    A wrong baseline moves all alike, a tilt that was wrong tips the whole: ``by_error`` (n, 3) are a one and the place
    of the point, slopes north and east in the second picture about their mean, so that the errors are metres down and
    metres down per slope. ``by_pose`` (3, 12) are their derivatives by the two camera poses, each position NED and the
    small rotation about the NED axes; ``cov`` (3, 3) is theirs by the noise of the pictures alone. ``std_m`` (n,) is
    what each point errs by on its own.
    """

    down_m: Float
    std_m: Float
    by_error: Float
    by_pose: Float
    cov: Float


def triangulated(rays_ned: Float, pos_ned_m: Float, pixel_std_rad: float, config: StructureConfig) -> Structure | None:
    """Heights of points seen from two places.

    Parameters
    ----------
    rays_ned
        Unit rays (2, n, 3) to the points from the two cameras; NaN where not seen.
    pos_ned_m
        Camera positions (2, 3), one a row.
    pixel_std_rad
        Angular noise of a ray.

    Returns
    -------
    Structure or None
        None where fewer than ``min_points`` have a height.

    Notes
    -----
    With a point's slope s = (north, east) / down and the cameras at p, z, s1 (d - z1) + p1 = s2 (d - z2) + p2, and
    least squares its down d = (s1 - s2) . k / |s1 - s2|^2 with k = p2 - p1 + s1 z1 - s2 z2. An error of a pose moves d
    by (s1 - s2) / |s1 - s2|^2 times the difference by which it moves the two ground points.
    """
    down = np.where(rays_ned[:, :, 2:] > MIN_DOWN, rays_ned[:, :, 2:], np.nan)
    slope = rays_ned[:, :, :2] / down
    apart = slope[0] - slope[1]
    square = np.sum(apart**2, axis=1)
    # a parallax of less than a third of what a keyframe's distance gives is mostly noise
    per_m = apart / np.where(square > (config.spacing / 3.0) ** 2, square, np.nan)[:, None]
    across = pos_ned_m[1, :2] - pos_ned_m[0, :2] + slope[0] * pos_ned_m[0, 2] - slope[1] * pos_ned_m[1, 2]
    down_m = np.sum(per_m * across, axis=1)
    height_m = down_m - pos_ned_m[:, 2, None]
    sound = (height_m > 0.5).all(axis=0)
    if sound.sum() < config.min_points:
        return None
    middle_m = float(np.median(down_m[sound]))
    with np.errstate(invalid="ignore"):
        sound &= np.abs(down_m - middle_m) <= 4.0 * robust_std(down_m[sound]) + 0.02 * height_m[1]
    count = int(sound.sum())
    if count < config.min_points:
        return None
    place = slope[1] - slope[1, sound].mean(axis=0)
    by_error = np.column_stack((np.ones(len(place)), place))
    fit = np.linalg.pinv(by_error[sound])
    by_pose = np.concatenate([
        sign * np.einsum(
            "kn,ni,nij->kj", fit, per_m[sound],
            ground_point_by_pose(slope[camera, sound], height_m[camera, sound]),
        )
        for camera, sign in ((0, -1.0), (1, 1.0))
    ], axis=1)  # fmt: skip
    height = float(height_m[1, sound].mean())
    std_m = np.where(sound, np.sqrt(2.0 / np.where(sound, square, 1.0)) * pixel_std_rad * height, np.nan)
    cov = (
        count / independent(count) * float(np.nanmean(std_m**2)) * (fit @ fit.T)
        + np.eye(3) * (config.height_std * height) ** 2
    )
    return Structure(np.where(sound, down_m, np.nan), std_m, by_error, by_pose, cov)


class FollowedPoints:
    """What is known of the corners that a tracker follows, in its order: pixel in the last keyframe, and structure.

    NaN where a corner is newer than the keyframe, or than the one before.
    """

    def __init__(self) -> None:
        self.keyframe_uv_px: Float = np.empty((0, 2))
        self.down_m: Float = np.empty(0)
        self.std_m: Float = np.empty(0)
        self.by_error: Float = np.empty((0, 3))

    def follow(self, kept: NDArray[np.intp], count: int) -> None:
        """Of the corners those with the indices ``kept`` are left; they are the first of ``count`` now."""

        def kept_of(values: Float) -> Float:
            left = np.full((count, *values.shape[1:]), np.nan)
            left[: len(kept)] = values[kept]
            return left

        self.keyframe_uv_px = kept_of(self.keyframe_uv_px)
        self.down_m, self.std_m, self.by_error = kept_of(self.down_m), kept_of(self.std_m), kept_of(self.by_error)

    def take(self, uv_px: Float, structure: Structure | None) -> None:
        """The corners' pixels (n, 2) in a new keyframe, and what is known of their heights then."""
        self.keyframe_uv_px = uv_px
        if structure is None:
            nothing = np.full(len(uv_px), np.nan)
            self.down_m, self.std_m, self.by_error = nothing, nothing, np.full((len(uv_px), 3), np.nan)
        else:
            self.down_m, self.std_m, self.by_error = structure.down_m, structure.std_m, structure.by_error

    def heights(self, count: int, errors_m: Float, min_points: int) -> tuple[NDArray[np.bool_], KnownHeights | None]:
        """Which of the first ``count`` points have a height, and these with the common errors (3,) as now estimated.

        All points, and None, where fewer than ``min_points`` do.
        """
        known = np.isfinite(self.down_m[:count])
        if known.sum() < min_points:
            return np.ones(count, dtype=bool), None
        by_error = self.by_error[:count][known]
        down_m = self.down_m[:count][known] + by_error @ errors_m
        return known, KnownHeights(down_m, self.std_m[:count][known], by_error)
