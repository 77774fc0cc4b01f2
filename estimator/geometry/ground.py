"""Where rays meet the ground, and how sure that is.

Everything in a local north-east-down frame, metres; rays need not be unit vectors. Down is positive below the frame's
origin. A slope (..., 2) is the change of the ground's down per metre north and per metre east.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.earth import Float
from estimator.geometry.rotation import skew

DownAt = Callable[[Float, Float], Float]
"""The ground's down at north (k,) and east (k,); NaN where unknown."""

_BISECTIONS: Final = 40


def intersect_plane(origin_ned_m: Float, rays_ned: Float, down_m: float | Float) -> Float:
    """Where rays (..., 3) from ``origin_ned_m`` (..., 3) meet the level plane at ``down_m`` (...).

    NaN where the plane is not ahead of the ray. The inputs broadcast.
    """
    origin, rays = np.broadcast_arrays(
        np.asarray(origin_ned_m, dtype=np.float64), np.asarray(rays_ned, dtype=np.float64)
    )
    down = np.asarray(down_m, dtype=np.float64)
    descent = rays[..., 2]
    along = (down - origin[..., 2]) / np.where(descent == 0.0, np.nan, descent)
    along = np.where(along > 0.0, along, np.nan)
    points: Float = origin + along[..., np.newaxis] * rays
    # Exactly on the plane, whatever the rounding above.
    points[..., 2] = np.where(np.isnan(points[..., 2]), np.nan, down)
    return points


def intersect_terrain(
    origin_ned_m: Float,
    rays_ned: Float,
    down_at: DownAt,
    max_range_m: float = 3000.0,
    step_m: float = 0.5,
    *,
    max_slope: float = 3.0,
    tolerance_m: float = 1e-4,
) -> Float:
    """Where rays (..., 3) from ``origin_ned_m`` (..., 3) first go below the terrain.

    Parameters
    ----------
    down_at
        The ground's down for vectors of north and east.
    max_range_m
        Slant range at which a ray has missed.
    step_m, max_slope
        The march steps as far as a ground no steeper than ``max_slope`` allows, and at least ``step_m``. What is
        steeper and thinner than that (a mast, a corner of a roof that the ray cuts by less) can be missed.
    tolerance_m
        Length along the ray to which the bisection closes in.

    Returns
    -------
    Points (..., 3); NaN for rays that miss, start at or below the ground, or enter it where it is unknown. Unknown
    ground that a ray passes over does not stop it.
    """
    if not (step_m > 0.0 and tolerance_m > 0.0 and np.isfinite(max_range_m)):
        message = f"steps and tolerance must be positive and the range finite: {step_m}, {tolerance_m}, {max_range_m} m"
        raise ValueError(message)
    origin, rays = np.broadcast_arrays(
        np.asarray(origin_ned_m, dtype=np.float64), np.asarray(rays_ned, dtype=np.float64)
    )
    shape = rays.shape
    origin, rays = origin.reshape(-1, 3), rays.reshape(-1, 3)
    length = np.sqrt(np.sum(rays * rays, axis=-1, keepdims=True))
    rays = rays / np.where(length > 0.0, length, np.nan)

    before_m, after_m = _march(origin, rays, down_at, max_range_m, step_m, max_slope)
    points = np.full(rays.shape, np.nan)
    hit = np.flatnonzero(np.isfinite(after_m))
    if hit.size:
        points[hit] = _bisect(origin[hit], rays[hit], down_at, before_m[hit], after_m[hit], tolerance_m)
    return points.reshape(shape)


def _march(
    origin: Float, rays: Float, down_at: DownAt, max_range_m: float, step_m: float, max_slope: float
) -> tuple[Float, Float]:
    """Ranges (n,) last above and first below the ground; NaN for rays that never are."""
    before_m = np.full(len(rays), np.nan)
    after_m = np.full(len(rays), np.nan)
    active = np.flatnonzero(np.all(np.isfinite(origin) & np.isfinite(rays), axis=-1))
    # How fast, per metre along the ray, the gap closes over ground that rises towards it at the steepest.
    closing = rays[:, 2] + max_slope * np.hypot(rays[:, 0], rays[:, 1])
    range_m = np.zeros(active.size)
    gap_m = _gap(origin[active], rays[active], down_at, range_m)
    active, range_m, gap_m = _keep(~(gap_m <= 0.0), active, range_m, gap_m)
    while active.size:
        rate = closing[active]
        free_m = np.where(rate > 0.0, gap_m / np.where(rate > 0.0, rate, 1.0), max_range_m)
        advance_m = np.maximum(np.where(np.isnan(gap_m), step_m, free_m), step_m)
        next_m = np.minimum(range_m + advance_m, max_range_m)
        next_gap_m = _gap(origin[active], rays[active], down_at, next_m)
        below = next_gap_m <= 0.0
        # From unknown ground to below it: the ray went in where nobody knows.
        known = below & ~np.isnan(gap_m)
        before_m[active[known]], after_m[active[known]] = range_m[known], next_m[known]
        active, range_m, gap_m = _keep(~below & (next_m < max_range_m), active, next_m, next_gap_m)
    return before_m, after_m


def _keep(
    which: NDArray[np.bool_], active: NDArray[np.intp], range_m: Float, gap_m: Float
) -> tuple[NDArray[np.intp], Float, Float]:
    return active[which], range_m[which], gap_m[which]


def _gap(origin: Float, rays: Float, down_at: DownAt, range_m: Float) -> Float:
    """Height above the ground (n,) at ranges (n,) along rays; NaN where the ground is unknown."""
    points = origin + range_m[:, np.newaxis] * rays
    gap: Float = down_at(points[:, 0], points[:, 1]) - points[:, 2]
    return gap


def _bisect(origin: Float, rays: Float, down_at: DownAt, before_m: Float, after_m: Float, tolerance_m: float) -> Float:
    """Points (n, 3) where rays cross the ground between two ranges."""
    for _ in range(_BISECTIONS):
        if np.all(after_m - before_m <= tolerance_m):
            break
        middle_m = 0.5 * (before_m + after_m)
        gap_m = _gap(origin, rays, down_at, middle_m)
        # Unknown counts as above, so that the bracket closes on where the known ground is crossed.
        below = gap_m <= 0.0
        before_m, after_m = np.where(below, before_m, middle_m), np.where(below, middle_m, after_m)
    gap_before_m = _gap(origin, rays, down_at, before_m)
    gap_after_m = _gap(origin, rays, down_at, after_m)
    fraction = gap_before_m / np.where(gap_before_m > gap_after_m, gap_before_m - gap_after_m, np.nan)
    range_m = before_m + fraction * (after_m - before_m)
    return origin + range_m[:, np.newaxis] * rays


def terrain_slope(down_at: DownAt, pos_ne_m: Float, step_m: float) -> Float:
    """Slope (..., 2) of the terrain at north and east (..., 2), by central differences over ``2 step_m``."""
    ne = np.asarray(pos_ne_m, dtype=np.float64)
    north, east = np.ravel(ne[..., 0]), np.ravel(ne[..., 1])
    along_north = down_at(north + step_m, east) - down_at(north - step_m, east)
    along_east = down_at(north, east + step_m) - down_at(north, east - step_m)
    return np.stack((along_north, along_east), axis=-1).reshape(ne.shape) / (2.0 * step_m)


def ray_ground_jacobian(
    origin_ned_m: Float, ray_ned: Float, point_ned_m: Float, slope_ne: Float | None = None
) -> Float:
    """How the place where a ray meets the ground moves with the camera's pose.

    Parameters
    ----------
    origin_ned_m, ray_ned, point_ned_m
        The camera (..., 3), its ray (..., 3) of any length and the point (..., 3) on the ground that the ray meets.
    slope_ne
        Slope (..., 2) of the ground there; level when absent.

    Returns
    -------
    (..., 2, 6): d(north, east) by the camera's north, east, down and by a small rotation about the NED axes, in the
    sense R_true = Exp(dtheta_ned) R. NaN where the ray does not go down into the ground.
    """
    return _point_jacobian(origin_ned_m, ray_ned, point_ned_m, slope_ne)[0][..., :2, :]


def ground_point_covariance(
    origin_ned_m: Float,
    ray_ned: Float,
    point_ned_m: Float,
    slope_ne: Float | None,
    cov_camera_pose: Float,
    pixel_std_rad: float | Float,
    ground_std_m: float | Float,
) -> Float:
    """Covariance (..., 3, 3), NED in square metres, of the point where a ray meets the ground.

    Parameters
    ----------
    origin_ned_m, ray_ned, point_ned_m, slope_ne
        As for ``ray_ground_jacobian``.
    cov_camera_pose
        (..., 6, 6): the camera's position NED (m), then its small rotation error about the NED axes (rad).
    pixel_std_rad
        Standard deviation (...) of the ray's direction, each of the two ways across it: pixels over focal length.
    ground_std_m
        Standard deviation (...) of the ground's height. An error of it moves the point along the ray.

    Notes
    -----
    First order: P = J C J^T + sigma_px^2 A A^T + sigma_g^2 u u^T, with A the derivative by a turn of the ray and u the
    displacement per metre of ground height. NaN where the ray does not go down into the ground.
    """
    jacobian, per_down = _point_jacobian(origin_ned_m, ray_ned, point_ned_m, slope_ne)
    # Turning the ray about itself moves nothing, so an isotropic turn is exactly the two across.
    turn = jacobian[..., 3:]
    pixel_var = np.asarray(pixel_std_rad, dtype=np.float64)[..., np.newaxis, np.newaxis] ** 2
    ground_var = np.asarray(ground_std_m, dtype=np.float64)[..., np.newaxis, np.newaxis] ** 2
    cov: Float = jacobian @ cov_camera_pose @ np.swapaxes(jacobian, -1, -2)
    cov = cov + pixel_var * (turn @ np.swapaxes(turn, -1, -2))
    cov = cov + ground_var * (per_down[..., :, np.newaxis] * per_down[..., np.newaxis, :])
    return 0.5 * (cov + np.swapaxes(cov, -1, -2))


def _point_jacobian(
    origin_ned_m: Float, ray_ned: Float, point_ned_m: Float, slope_ne: Float | None
) -> tuple[Float, Float]:
    """d(point)/d(pose) (..., 3, 6) and d(point)/d(ground down) (..., 3).

    The ground is the plane m . x = c with m = (-slope, 1). With x = o + s r, and do and dtheta of the pose, follows
    dx = (I - r m^T / (m . r)) (do + s dtheta x r) + r / (m . r) dc.
    """
    ray = np.asarray(ray_ned, dtype=np.float64)
    ray = ray / np.sqrt(np.sum(ray * ray, axis=-1, keepdims=True))
    offset = np.asarray(point_ned_m, dtype=np.float64) - np.asarray(origin_ned_m, dtype=np.float64)
    range_m = np.sqrt(np.sum(offset * offset, axis=-1))[..., np.newaxis, np.newaxis]
    upright = np.array((0.0, 0.0, 1.0)) if slope_ne is None else _normal(np.asarray(slope_ne, dtype=np.float64))
    descent = np.sum(upright * ray, axis=-1, keepdims=True)
    per_down = ray / np.where(descent > 0.0, descent, np.nan)
    onto_ground = np.eye(3) - per_down[..., :, np.newaxis] * upright[..., np.newaxis, :]
    by_turn = -range_m * (onto_ground @ skew(ray))
    onto_ground = np.broadcast_to(onto_ground, by_turn.shape)
    return np.concatenate((onto_ground, by_turn), axis=-1), per_down


def _normal(slope_ne: Float) -> Float:
    """The vector (..., 3) across ground of a slope (..., 2), with a down component of 1."""
    return np.concatenate((-slope_ne, np.ones((*slope_ne.shape[:-1], 1))), axis=-1)


def ground_point_by_pose(slope_ne: Float, height_m: Float) -> Float:
    """Derivatives (..., 2, 6) of the ground points that rays meet by an error of the camera's pose.

    ``slope_ne`` (..., 2) is north and east per unit down of the rays, ``height_m`` (...) the camera's height above the
    points. The pose error is position NED in metres, then the small rotation about the NED axes. A ray r turns by
    dtheta x r; its slope s = r_ne / r_d changes by (dtheta x r)_ne / r_d - s (dtheta x r)_d / r_d, and a camera that
    sinks by a metre moves the point by -s.
    """
    north, east = slope_ne[..., 0], slope_ne[..., 1]
    out = np.zeros((*north.shape, 2, 6))
    out[..., 0, 0] = out[..., 1, 1] = 1.0
    out[..., 0, 2], out[..., 1, 2] = -north, -east
    out[..., 0, 3], out[..., 1, 4] = -north * east, north * east
    out[..., 0, 4], out[..., 1, 3] = 1.0 + north**2, -(1.0 + east**2)
    out[..., 0, 5], out[..., 1, 5] = -east, north
    out[..., 3:] *= np.asarray(height_m)[..., None, None]
    return out
