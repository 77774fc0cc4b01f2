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
MAX_RANGE_M = 3000.0


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
    ground_std_m: float, pixel_std_px: float = 1.0, height_above_ground_m: float = 0.0,
    max_range_m: float = MAX_RANGE_M,
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
    below = float(state.pos_ned_m[2] + state.alt_agl_m)
    ned_from_camera = matrix_from_q(state.q_ned_from_camera)
    return cut_ray(
        state.pos_ned_m, ned_from_camera, state.cov_camera_pose, camera, uv_px, ground, frame, ground_std_m,
        pixel_std_px, height_above_ground_m, max_range_m, below,
    )  # fmt: skip


def cut_ray(
    pos_ned_m: Float, ned_from_camera: Float, cov_camera_pose: Float, camera: Camera, uv_px: tuple[float, float],
    ground: GroundModel, frame: LocalFrame, ground_std_m: float, pixel_std_px: float = 1.0,
    height_above_ground_m: float = 0.0, max_range_m: float = 3000.0, level_down_m: float = np.nan,
) -> RayTarget:  # fmt: skip
    """The same for a camera pose: position NED (3,), rotation (3, 3) and their covariance (6, 6).

    ``level_down_m`` is the NED down of level ground for where the terrain is unknown; without it that is refused.
    Raises GeometryError as ``locate_ray`` does.
    """
    ray = ned_from_camera @ pixel_ray(camera, uv_px)

    def down_at(north_m: Float, east_m: Float) -> Float:
        down: Float = frame.alt_m - ground.alt_amsl_m(north_m, east_m) - height_above_ground_m
        return down

    point = intersect_terrain(pos_ned_m, ray, down_at, max_range_m)
    method = "ray_terrain"
    if not np.isfinite(point).all():
        point = intersect_plane(pos_ned_m, ray, level_down_m - height_above_ground_m)
        method = "ray_flat"
    if not np.isfinite(point).all() or np.linalg.norm(point - pos_ned_m) > max_range_m:
        raise GeometryError(no_ground(max_range_m))
    slope = _slope(point, down_at) if method == "ray_terrain" else np.zeros(2)
    cov = ground_point_covariance(
        pos_ned_m, ray, point, slope, cov_camera_pose, pixel_std_px / camera.fx_px, ground_std_m
    )
    lat, lon, alt = frame.geodetic_from_ned(point)
    return RayTarget(float(lat), float(lon), float(alt), point, cov, method)


def pixel_ray(camera: Camera, uv_px: tuple[float, float]) -> Float:
    """The unit ray (3,) of a pixel in the camera frame; GeometryError where picture or lens do not reach there."""
    if not bool(camera.contains(uv_px)):
        message = f"pixel ({uv_px[0]:g}, {uv_px[1]:g}) lies outside the {camera.width_px} x {camera.height_px} picture"
        raise GeometryError(message)
    ray = camera.rays(np.asarray(uv_px, dtype=np.float64))
    if not np.isfinite(ray).all():
        message = "the pixel lies outside the lens model"
        raise GeometryError(message)
    return ray


def no_ground(max_range_m: float) -> str:
    """What to say of a ray that goes on and on."""
    return f"the pixel's ray meets no ground within {max_range_m:g} m: it looks at or above the horizon"


def _slope(point_ned_m: Float, down_at: DownAt) -> Float:
    north = point_ned_m[0] + SLOPE_STEP_M * np.array([1.0, -1.0, 0.0, 0.0])
    east = point_ned_m[1] + SLOPE_STEP_M * np.array([0.0, 0.0, 1.0, -1.0])
    down = down_at(north, east)
    slope = np.array([down[0] - down[1], down[2] - down[3]]) / (2.0 * SLOPE_STEP_M)
    return np.where(np.isfinite(slope), np.clip(slope, -1.0, 1.0), 0.0)
