"""Rays cut with the ground, and how errors of the camera's pose move the point."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from estimator.geometry.earth import Float
from estimator.geometry.rotation import skew

DownAt = Callable[[Float, Float], Float]


def intersect_plane(origin_ned_m: Float, rays_ned: Float, down_m: float) -> Float:
    """Points (..., 3) where rays (..., 3) from an origin (3,) meet the level plane; NaN where not ahead."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (down_m - origin_ned_m[..., 2]) / rays_ned[..., 2]
    distance = np.where(distance > 0.0, distance, np.nan)
    out: Float = origin_ned_m + rays_ned * distance[..., None]
    return out


def intersect_terrain(
    origin_ned_m: Float, rays_ned: Float, down_at: DownAt, max_range_m: float = 3000.0, step_m: float = 5.0
) -> Float:
    """First points (..., 3) where unit rays (..., 3) from an origin (3,) meet the terrain; NaN on a miss.

    ``down_at(north, east)`` gives the terrain's down coordinate, NaN where unknown. The rays are marched in steps of
    ``step_m``, then the crossing is bisected to a millimetre; a ridge thinner than a step can be stepped over.
    """
    shape = rays_ned.shape[:-1]
    rays = rays_ned.reshape(-1, 3)
    origin = np.broadcast_to(origin_ned_m, rays.shape)

    def below(distance: Float, index: Float) -> Float:
        points = origin[index] + rays[index] * distance[:, None]
        out: Float = points[:, 2] - down_at(points[:, 0], points[:, 1])
        return out

    near = np.zeros(len(rays))
    far = np.full(len(rays), np.nan)
    active = np.flatnonzero(np.isfinite(rays).all(axis=1))
    if active.size:
        active = active[~(below(near[active], active) > 0.0)]
    distance = 0.0
    while active.size and distance < max_range_m:
        distance += step_m
        depth = below(np.full(active.size, distance), active)
        hit = depth > 0.0
        far[active[hit]] = distance
        active = active[~hit]
        near[active] = distance
    crossed = np.flatnonzero(np.isfinite(far))
    low, high = near[crossed], far[crossed]
    for _ in range(int(np.ceil(np.log2(max(step_m, 1e-2) / 1e-3)))):
        middle = 0.5 * (low + high)
        under = below(middle, crossed) > 0.0
        low, high = np.where(under, low, middle), np.where(under, middle, high)
    points = np.full(rays.shape, np.nan)
    points[crossed] = origin[crossed] + rays[crossed] * (0.5 * (low + high))[:, None]
    return points.reshape(*shape, 3)


def ray_ground_jacobian(origin_ned_m: Float, ray_ned: Float, point_ned_m: Float, slope_ne: Float) -> Float:
    """Derivative (2, 6) of a ground point's north and east by camera position (3) and rotation about the NED axes (3).

    ``slope_ne`` (2,) is the terrain's down coordinate per metre north and east. The ray r turns by dtheta x r.
    """
    normal = np.array([-slope_ne[0], -slope_ne[1], 1.0])
    along = float(normal @ ray_ned)
    distance = float(np.linalg.norm(point_ned_m - origin_ned_m))
    # the point slides along the ray until it is back on the plane
    slide = np.eye(3) - np.outer(ray_ned, normal) / along
    by_rotation = slide @ (-skew(ray_ned)) * distance
    return np.concatenate((slide[:2], by_rotation[:2]), axis=1)


def ground_point_covariance(
    origin_ned_m: Float, ray_ned: Float, point_ned_m: Float, slope_ne: Float, cov_camera_pose: Float,
    pixel_std_rad: float, ground_std_m: float,
) -> Float:  # fmt: skip
    """Covariance (3, 3) NED of the ground point that a ray (3,) meets.

    Parameters
    ----------
    cov_camera_pose
        (6, 6) of position (m) and rotation error about the NED axes (rad).
    pixel_std_rad
        Angular error of the pixel that was pointed at, each way.
    ground_std_m
        Error of the terrain's height.
    """
    normal = np.array([-slope_ne[0], -slope_ne[1], 1.0])
    along = float(normal @ ray_ned)
    distance = float(np.linalg.norm(point_ned_m - origin_ned_m))
    slide = np.eye(3) - np.outer(ray_ned, normal) / along
    J = np.concatenate((slide, slide @ (-skew(ray_ned)) * distance), axis=1)
    across = slide * distance
    pointing = across @ (np.eye(3) - np.outer(ray_ned, ray_ned)) @ across.T * pixel_std_rad**2
    by_height = ray_ned / along
    cov: Float = J @ cov_camera_pose @ J.T + pointing + np.outer(by_height, by_height) * ground_std_m**2
    return cov
