"""The odometer of Conte and Doherty: mean displacement of all features, at one depth, with the rotation removed.

An integrated UAV navigation system based on aerial image matching, IEEE Aerospace Conference 2008, equations 1 to 3:
every feature is put on level ground at the camera's height above it, and the displacements are averaged, outliers and
all. There is no terrain in it and no robustness; it is here to be compared with.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from estimator.odometry.planar import MIN_DOWN, MIN_TRACKS, DisplacementResidual, residual_of_points
from estimator.types import Float


def depth_average_residual(
    rays_first: Float, rays_second: Float, pos_first_ned_m: Float, pos_second_ned_m: Float,
    down_at: Callable[[Float, Float], Float], pixel_std_rad: float, relative_std: float,
) -> DisplacementResidual | None:  # fmt: skip
    """Compare the mean displacement with the motion predicted; arguments as of ``planar.displacement_residual``.

    Covariance: the scatter of the displacements over their number, at least that of ``pixel_std_rad``. The depth is the
    first camera's height above the ground below it, as a barometer gives it.
    """
    usable = (rays_first[:, 2] > MIN_DOWN) & (rays_second[:, 2] > MIN_DOWN)
    count = int(usable.sum())
    if count < MIN_TRACKS:
        return None
    down = float(down_at(pos_first_ned_m[0:1], pos_first_ned_m[1:2])[0])
    height_first, height_second = down - pos_first_ned_m[2], down - pos_second_ned_m[2]
    if not (height_first > 0.5 and height_second > 0.5):
        return None
    slope_first = rays_first[usable, :2] / rays_first[usable, 2:]
    slope_second = rays_second[usable, :2] / rays_second[usable, 2:]
    point_first = pos_first_ned_m[:2] + slope_first * height_first
    residuals = point_first - (pos_second_ned_m[:2] + slope_second * height_second)
    displacement_m = float(np.hypot(*(pos_second_ned_m - pos_first_ned_m)[:2]))
    floor_m2 = 2.0 * (pixel_std_rad * height_second) ** 2 / count
    cov = np.cov(residuals.T) / count + np.eye(2) * (floor_m2 + (relative_std * displacement_m) ** 2)
    return residual_of_points(
        residuals.mean(axis=0), cov, slope_first, (point_first - pos_second_ned_m[:2]) / height_second,
        np.full(count, height_first), np.full(count, height_second), len(rays_first),
    )  # fmt: skip
