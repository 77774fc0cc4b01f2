"""A pixel becomes a coordinate: its ray cut with the terrain, with the covariance of everything on the way.

Conte, Hempel, Rudol et al., High accuracy ground target geo-location using autonomous micro aerial vehicle platforms,
AIAA 2008 (thesis chapter 7), the "map-based" method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.geometry.ground import DownAt, intersect_plane, intersect_terrain, ray_ground_jacobian
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q
from estimator.ports import GroundModel
from estimator.types import Float, NavigationState

SLOPE_STEP_M = 2.0
MAX_RANGE_M = 3000.0


@dataclass(frozen=True, slots=True, eq=False)
class RayTarget:
    """Where a pixel's ray meets the ground, and its covariance (3, 3) in NED.

    Of that, ``cov_pixel_m2`` (3, 3) is the click's own, and ``height_way_m`` (3,) is how one standard deviation of the
    ground's height there moves the place; the rest is the pose's.
    """

    lat_rad: float
    lon_rad: float
    alt_amsl_m: float
    pos_ned_m: Float
    cov_ned_m2: Float
    method: str
    cov_pixel_m2: Float
    height_way_m: Float


def locate_ray(
    state: NavigationState, camera: Camera, uv_px: tuple[float, float], ground: GroundModel, frame: LocalFrame,
    ground_std_m: float, pixel_std_px: float = 1.0, height_above_ground_m: float = 0.0,
    max_range_m: float = MAX_RANGE_M, slope_std: float = 0.0,
) -> RayTarget:  # fmt: skip
    """Coordinates of what a pixel shows.

    Parameters
    ----------
    state
        The vehicle at the time of the picture; its camera pose's covariance goes into the result.
    uv_px
        Pixel of the recorded picture, distortion included.
    ground_std_m
        Error of the ground's height at a point, beside the bias that ``state`` has learned of it.
    slope_std
        What the ground model leaves of the land's slope between the vehicle and the point, rise over run.
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
    lens = state.lens_ned_m
    seen = Lowered(ground, state.ground_bias_m)
    return cut_ray(
        lens, matrix_from_q(state.q_ned_from_camera), state.cov_camera_pose, camera, uv_px, seen, frame, ground_std_m,
        pixel_std_px, height_above_ground_m, max_range_m, below, slope_std, state.cov_ground_bias,
    )  # fmt: skip


def pose_above_ground(state: NavigationState) -> tuple[Float, float]:
    """Covariance (6, 6) of the camera's pose with its height taken above what is seen, and the ground bias's variance.

    A bias of all the ground in sight moves the places of rays as much as the camera's height does, and where the map
    has told the height above ground the two errors all but cancel.
    """
    cov: Float = state.cov_camera_pose.copy()
    if state.cov_ground_bias is None:
        return cov, 0.0
    cross, var = state.cov_ground_bias[:6], float(state.cov_ground_bias[6])
    cov[2] -= cross
    cov[:, 2] -= cross
    cov[2, 2] += var
    return cov, var


@dataclass(frozen=True, slots=True, eq=False)
class Lowered:
    """Ground that lies lower than a model has it."""

    ground: GroundModel
    by_m: float

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        """Altitude of what is seen."""
        return self.ground.alt_amsl_m(north_m, east_m) - self.by_m


def cut_ray(
    pos_ned_m: Float, ned_from_camera: Float, cov_camera_pose: Float, camera: Camera, uv_px: tuple[float, float],
    ground: GroundModel, frame: LocalFrame, ground_std_m: float, pixel_std_px: float = 1.0,
    height_above_ground_m: float = 0.0, max_range_m: float = 3000.0, level_down_m: float = np.nan,
    slope_std: float = 0.0, cov_ground_bias: Float | None = None,
) -> RayTarget:  # fmt: skip
    """The same for a camera pose: position NED (3,), rotation (3, 3) and their covariance (6, 6).

    ``cov_ground_bias`` (7,) is as in ``NavigationState``, of how far all the ground lies below where ``ground`` is.
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
    ground_std_m = float(np.hypot(ground_std_m, slope_std * np.hypot(*(point - pos_ned_m)[:2])))
    level = ray_ground_jacobian(pos_ned_m, ray, point, slope)
    per_down = ray / float(ray[2] - slope @ ray[:2])
    by = np.column_stack((np.vstack((level, slope @ level)), per_down))
    joint = np.zeros((7, 7))
    joint[:6, :6] = cov_camera_pose
    if cov_ground_bias is not None:
        joint[6] = joint[:, 6] = cov_ground_bias
    # a turn of the ray about itself moves nothing: all three axes are the two across
    by_pixel = (pixel_std_px / camera.fx_px) ** 2 * by[:, 3:6] @ by[:, 3:6].T
    way = ground_std_m * per_down
    cov = by @ joint @ by.T + by_pixel + np.outer(way, way)
    cov = 0.5 * (cov + cov.T)
    lat, lon, alt = frame.geodetic_from_ned(point)
    return RayTarget(float(lat), float(lon), float(alt), point, cov, method, by_pixel, way)


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
