"""The odometer of Conte's thesis: a robust homography, the rotation known, the ground a plane of known slope.

Conte 2009, section 5.6. With the rays turned into the navigation frame, X2 = (I - t n' / d) X1 for ground points seen
from two cameras a translation t apart, the ground a plane of unit normal n (downwards) at the distance d from the first
(equation 5.8). Then t = d (I - H / s) n: equation 5.9 read along the normal, with s the scale that a homography leaves
open. The thesis divides by H's last element; here s is what H does to directions in the plane, which it leaves alone
but for the scale. In level flight that is the same, and it stays right in a climb.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from estimator.odometry.planar import (
    MIN_DOWN,
    MIN_INLIER_FRACTION,
    MIN_TRACKS,
    DisplacementResidual,
    residual_of_points,
)
from estimator.types import Float

SLOPE_REACH = 0.4
"""Half the distance, as a share of the height, over which the terrain's slope is taken."""


def homography_residual(
    rays_first: Float, rays_second: Float, pos_first_ned_m: Float, pos_second_ned_m: Float,
    down_at: Callable[[Float, Float], Float], pixel_std_rad: float, relative_std: float,
) -> DisplacementResidual | None:  # fmt: skip
    """Compare the homography's translation with the motion predicted; arguments as of ``planar.displacement_residual``.

    Covariance: that of the eight elements from the tracks' scatter about the homography, carried to the translation.
    """
    usable = (rays_first[:, 2] > MIN_DOWN) & (rays_second[:, 2] > MIN_DOWN)
    if usable.sum() < MIN_TRACKS:
        return None
    plane = _ground_plane(pos_first_ned_m, down_at)
    if plane is None:
        return None
    normal, distance_m = plane
    first = rays_first[usable, :2] / rays_first[usable, 2:]
    second = rays_second[usable, :2] / rays_second[usable, 2:]
    H, inlier = _robust_homography(first, second, pixel_std_rad)
    count = int(inlier.sum())
    if H is None or count < MIN_TRACKS or count < MIN_INLIER_FRACTION * len(first):
        return None
    cov_h = _covariance(H, first[inlier], second[inlier], pixel_std_rad)
    if cov_h is None:
        return None
    moved_m = distance_m * (normal - H @ normal / _in_plane_scale(H, normal))[:2]
    # of the small change of H by its elements; the scale follows that of the last one, which is held at one
    G = np.zeros((2, 8))
    G[0, :3] = G[1, 3:6] = -distance_m * normal
    displacement_m = float(np.hypot(*(pos_second_ned_m - pos_first_ned_m)[:2]))
    cov = G @ cov_h @ G.T + np.eye(2) * ((relative_std * displacement_m) ** 2 + 1e-4)
    # the translation is that seen straight down: rotation errors act there, not at the tracks' middle
    height_first = np.array([distance_m / normal[2]])
    height_second = height_first - (pos_second_ned_m[2] - pos_first_ned_m[2])
    if not height_second[0] > 0.5:
        return None
    expected = (pos_first_ned_m - pos_second_ned_m)[None, :2] / height_second[:, None]
    return residual_of_points(
        pos_first_ned_m[:2] - pos_second_ned_m[:2] + moved_m, cov, np.zeros((1, 2)), expected, height_first,
        height_second, len(first), count,
    )  # fmt: skip


def _ground_plane(pos_ned_m: Float, down_at: Callable[[Float, Float], Float]) -> tuple[Float, float] | None:
    """Unit normal (3,), downwards, of the ground below a camera, and its distance; None where it is not known below."""
    north, east, down_camera = pos_ned_m
    below = float(down_at(np.array([north]), np.array([east]))[0])
    height_m = below - down_camera
    if not height_m > 0.5:
        return None
    reach = SLOPE_REACH * height_m
    around = down_at(north + reach * np.array([1.0, -1.0, 0.0, 0.0]), east + reach * np.array([0.0, 0.0, 1.0, -1.0]))
    slope = np.array([around[0] - around[1], around[2] - around[3]]) / (2.0 * reach)
    slope = np.where(np.isfinite(slope), slope, 0.0)
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope @ slope)
    return normal, float(height_m * normal[2])


def _robust_homography(first: Float, second: Float, noise_rad: float) -> tuple[Float | None, np.ndarray]:
    """RANSAC, then least squares over the inliers; slopes (n, 2) take the place of pixels."""
    # OpenCV seeds its generator itself: the same tracks give the same homography
    # annotated because OpenCV's stubs do not know that it gives None where it finds nothing
    found: tuple[np.ndarray | None, np.ndarray] = cv2.findHomography(
        first, second, cv2.RANSAC, 4.0 * noise_rad, maxIters=500, confidence=0.995
    )
    H, mask = found
    if H is None or abs(H[2, 2]) < 1e-6:
        return None, np.zeros(len(first), dtype=bool)
    return np.asarray(H / H[2, 2], dtype=np.float64), np.asarray(mask.ravel() > 0)


def _in_plane_scale(H: Float, normal: Float) -> float:
    """Scale s of s (I - t n' / d): the mean of v' H v over unit vectors v in the plane.

    Its double eigenvalue is s as well, but is torn apart by the least error of the rotation.
    """
    return float(np.trace(H) - normal @ H @ normal) / 2.0


def _covariance(H: Float, first: Float, second: Float, noise_rad: float) -> Float | None:
    """Covariance (8, 8) of the elements of H but the last, from transfer errors that scatter at least by the noise."""
    count = len(first)
    ones = np.ones((count, 1))
    X = np.concatenate((first, ones), axis=1)
    transferred = X @ H.T
    w = transferred[:, 2:]
    uv = transferred[:, :2] / w
    J = np.zeros((count, 2, 8))
    J[:, 0, :3] = J[:, 1, 3:6] = X / w
    J[:, :, 6:] = -uv[:, :, None] * first[:, None, :] / w[:, None]
    flat = J.reshape(-1, 8)
    information = flat.T @ flat
    if np.linalg.cond(information) > 1e12:
        return None
    error = second - uv
    # both pictures' noise stands in the transfer; neighbouring tracks share the error of the relief below them
    variance = max(float((error**2).sum()) / max(2 * count - 8, 1), 2.0 * noise_rad**2)
    return np.asarray(3.0 * variance * np.linalg.inv(information), dtype=np.float64)
