"""A pixel becomes a coordinate: its ray cut with the terrain, with the covariance of everything on the way.

Conte, Hempel, Rudol et al., High accuracy ground target geo-location using autonomous micro aerial vehicle platforms,
AIAA 2008 (thesis chapter 7), the "map-based" method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.geometry.ground import DownAt, ground_point_covariance, intersect_plane, intersect_terrain
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q
from estimator.ports import GroundModel
from estimator.types import Float, NavigationState

SLOPE_STEP_M = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class RayTarget:
    """Where a pixel's ray meets the ground, and its covariance (3, 3) in NED."""

    lat_rad: float
    lon_rad: float
    alt_amsl_m: float
    pos_ned_m: Float
    cov_ned_m2: Float
    method: str


def locate_ray(
    state: NavigationState, camera: Camera, uv_px: tuple[float, float], ground: GroundModel, frame: LocalFrame,
    ground_std_m: float, pixel_std_px: float = 1.0, height_above_ground_m: float = 0.0, max_range_m: float = 3000.0,
) -> RayTarget:  # fmt: skip
    """Coordinates of what a pixel shows.

    Parameters
    ----------
    state
        The vehicle at the time of the picture; its camera pose's covariance goes into the result.
    uv_px
        Pixel of the recorded picture, distortion included.
    ground_std_m
        Error of the ground's height.
    height_above_ground_m
        How far the thing pointed at stands above the ground.

    Returns
    -------
    RayTarget
        ``method`` is ``ray_terrain``, or ``ray_flat`` where the terrain is unknown and the height below the vehicle
        was used.

    Raises
    ------
    GeometryError
        The pixel lies outside the picture or the lens model, or its ray meets no ground within ``max_range_m``.
    """
    if not bool(camera.contains(uv_px)):
        message = f"pixel ({uv_px[0]:g}, {uv_px[1]:g}) lies outside the {camera.width_px} x {camera.height_px} picture"
        raise GeometryError(message)
    ray_camera = camera.rays(np.asarray(uv_px, dtype=np.float64))
    if not np.isfinite(ray_camera).all():
        message = "the pixel lies outside the lens model"
        raise GeometryError(message)
    ray = matrix_from_q(state.q_ned_from_camera) @ ray_camera
    origin = state.pos_ned_m

    def down_at(north_m: Float, east_m: Float) -> Float:
        down: Float = frame.alt_m - ground.alt_amsl_m(north_m, east_m) - height_above_ground_m
        return down

    point = intersect_terrain(origin, ray, down_at, max_range_m)
    method = "ray_terrain"
    if not np.isfinite(point).all():
        below = state.pos_ned_m[2] + state.alt_agl_m - height_above_ground_m
        point = intersect_plane(origin, ray, float(below))
        method = "ray_flat"
    if not np.isfinite(point).all() or np.linalg.norm(point - origin) > max_range_m:
        message = f"the pixel's ray meets no ground within {max_range_m:g} m: it looks at or above the horizon"
        raise GeometryError(message)
    slope = _slope(point, down_at) if method == "ray_terrain" else np.zeros(2)
    cov = ground_point_covariance(
        origin, ray, point, slope, state.cov_camera_pose, pixel_std_px / camera.fx_px, ground_std_m
    )
    lat, lon, alt = frame.geodetic_from_ned(point)
    return RayTarget(float(lat), float(lon), float(alt), point, cov, method)


def _slope(point_ned_m: Float, down_at: DownAt) -> Float:
    north = point_ned_m[0] + SLOPE_STEP_M * np.array([1.0, -1.0, 0.0, 0.0])
    east = point_ned_m[1] + SLOPE_STEP_M * np.array([0.0, 0.0, 1.0, -1.0])
    down = down_at(north, east)
    slope = np.array([down[0] - down[1], down[2] - down[3]]) / (2.0 * SLOPE_STEP_M)
    return np.where(np.isfinite(slope), np.clip(slope, -1.0, 1.0), 0.0)
