"""The camera as a gyroscope: how it turned between two pictures, from corner tracks over ground that is nearly flat.

Over flat ground a turn about a horizontal axis and a shift along the ground look alike at the picture's centre and
differ only towards its edges, so both are solved for at once: the plane's homography R + t n^T with rotation R,
translation over distance t and normal n (Hartley and Zisserman, Multiple View Geometry, 13.1), by Gauss-Newton steps on
the tracks with a robust weight. The covariance carries the confusion: the turn about the optical axis is the surest.

A plane's homography has a second solution, with normal and translation exchanged (Longuet-Higgins, Proc. R. Soc. B 227,
1986); a loose prior on the normal keeps to the right one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_q, q_from_matrix, q_from_rotvec, rotvec_from_q, skew
from estimator.odometry.tracker import CornerTracker, TrackerConfig
from estimator.types import Float, Image

MIN_TRACKS = 16
MIN_INLIER_FRACTION = 0.5
_STEPS = 8
_SETTLED = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PlanarMotion:
    """How the camera moved between two pictures of a plane.

    ``rotvec_camera_rad`` (3,) turns the camera from the first attitude to the second, in camera axes (those of both,
    for a rotation vector is the same in either); ``cov_rotvec_rad2`` (3, 3). ``translation_by_distance`` (3,) is the
    first camera's position seen from the second, in the second's axes, over the first's distance to the plane;
    ``down_camera`` (3,) the plane's normal in the first camera's axes, away from the camera.
    ``residual_std_rad`` is of the ``tracks`` that agree, in normalised coordinates.
    """

    rotvec_camera_rad: Float
    cov_rotvec_rad2: Float
    translation_by_distance: Float
    down_camera: Float
    residual_std_rad: float
    tracks: int
    inlier_fraction: float


@dataclass(frozen=True, slots=True)
class PlanarMotionConfig:
    """Noise and priors of the fit.

    ``track_std_rad`` is the least noise of a track that is believed; neighbours share the error of the relief below
    them, so that only ``independent_share`` of the tracks count. The normal lies within ``down_std_rad`` of the one
    that was said, one sigma.
    """

    track_std_rad: float = 1e-4
    independent_share: float = 1.0 / 3.0
    down_std_rad: float = 0.2


def planar_motion(
    first_xy: Float, second_xy: Float, down_camera: Float, config: PlanarMotionConfig,
    start: PlanarMotion | None = None,
) -> PlanarMotion | None:  # fmt: skip
    """Fit the camera's motion over a plane to tracks.

    Parameters
    ----------
    first_xy, second_xy
        Ideal normalised coordinates (n, 2) of the same points in both pictures.
    down_camera
        About where the ground's normal points (3,), away from the camera, in the first camera's axes.
    start
        A motion to start from, such as that of the pair before.

    Returns
    -------
    PlanarMotion or None
        None where too few tracks agree.
    """
    usable = np.isfinite(first_xy).all(axis=1) & np.isfinite(second_xy).all(axis=1)
    if usable.sum() < MIN_TRACKS:
        return None
    first = np.column_stack((first_xy[usable], np.ones(int(usable.sum()))))
    second = second_xy[usable]
    fit = _Fit(first, second, down_camera / np.linalg.norm(down_camera), start)
    prior = np.zeros((8, 8))
    prior[6, 6] = prior[7, 7] = 1.0 / config.down_std_rad**2
    weights = np.ones(len(first))
    scale = math.inf
    for step in range(_STEPS):
        residuals, J = fit.linearised()
        distance = np.hypot(residuals[:, 0], residuals[:, 1])
        # 0.8493: a median distance of two normal components is 1.1774 sigma
        scale = max(0.8493 * float(np.median(distance)), config.track_std_rad)
        if step > 0:
            weights = 1.0 / (1.0 + (distance / (3.0 * scale)) ** 2) ** 2
        N = np.einsum("n,nki,nkj->ij", weights, J, J) / scale**2 + prior
        g = np.einsum("n,nki,nk->i", weights, J, residuals) / scale**2 - prior @ fit.tilt8()
        change = np.linalg.solve(N, g)
        fit.apply(change)
        if step > 1 and float(np.abs(change[:6]).max()) < _SETTLED:
            break
    inlier = distance < 3.0 * scale
    count = int(inlier.sum())
    if count < MIN_TRACKS or count < MIN_INLIER_FRACTION * len(first):
        return None
    spread = max(float(np.sqrt(np.mean(residuals[inlier] ** 2))), config.track_std_rad)
    N = config.independent_share * np.einsum("nki,nkj->ij", J[inlier], J[inlier]) / spread**2 + prior
    cov = np.linalg.inv(N)[:3, :3]
    return PlanarMotion(
        -rotvec_from_q(q_from_matrix(fit.R)), cov, fit.t, fit.n, spread, len(first), count / len(first)
    )  # fmt: skip


class _Fit:
    """The plane's homography R + t n^T and its derivatives."""

    def __init__(self, first: Float, second_xy: Float, down: Float, start: PlanarMotion | None) -> None:
        self._first = first
        self._second = second_xy
        self.R = np.eye(3)
        self.t = np.zeros(3)
        self.n = down
        # two directions across the normal, along which it may tilt
        across = np.cross(down, np.eye(3)[int(np.argmin(np.abs(down)))])
        self._across = np.stack((across / np.linalg.norm(across), np.cross(down, across / np.linalg.norm(across))))
        self._down = down
        self._tilt = np.zeros(2)
        if start is not None:
            self.R = matrix_from_q(q_from_rotvec(-start.rotvec_camera_rad))
            self.t = start.translation_by_distance

    def tilt8(self) -> Float:
        out = np.zeros(8)
        out[6:] = self._tilt
        return out

    def linearised(self) -> tuple[Float, Float]:
        """Residuals (n, 2) and derivatives (n, 2, 8) of the second pixels by rotation, translation and tilt."""
        x = self._first
        turned = x @ self.R.T
        depth = x @ self.n
        moved = turned + depth[:, None] * self.t
        z = moved[:, 2]
        xy = moved[:, :2] / z[:, None]
        residuals = self._second - xy
        by_moved = np.zeros((len(x), 2, 3))
        by_moved[:, 0, 0] = by_moved[:, 1, 1] = 1.0 / z
        by_moved[:, :, 2] = -xy / z[:, None]
        J = np.empty((len(x), 2, 8))
        J[:, :, :3] = -by_moved @ skew(turned)
        J[:, :, 3:6] = by_moved * depth[:, None, None]
        J[:, :, 6:] = (by_moved @ self.t)[:, :, None] * (x @ self._across.T)[:, None, :]
        return residuals, J

    def apply(self, change: Float) -> None:
        self.R = matrix_from_q(q_from_rotvec(change[:3])) @ self.R
        self.t = self.t + change[3:6]
        self._tilt = self._tilt + change[6:]
        self.n = self._down + self._tilt @ self._across


@dataclass(frozen=True, slots=True)
class ImageGyroConfig:
    """Pictures closer than ``interval_s`` are passed over, for their noise grows as the interval shrinks.

    Over more than ``max_gap_s`` nothing is followed. A picture repeats the last where the mean grey change is below
    ``frozen_difference``.
    """

    tracker: TrackerConfig = field(
        default_factory=lambda: TrackerConfig(max_corners=160, min_corners=100, window_px=15, min_distance_px=24.0)
    )
    motion: PlanarMotionConfig = field(default_factory=PlanarMotionConfig)
    interval_s: float = 0.06
    max_gap_s: float = 0.4
    frozen_difference: float = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class ImageTurn:
    """The camera's turn between two pictures by their frame times: ``rotvec_camera_rad`` (3,) in camera axes."""

    t_first_us: int
    t_second_us: int
    rotvec_camera_rad: Float
    cov_rotvec_rad2: Float

    @property
    def rate_camera_rad_s(self) -> Float:
        """Mean rate (3,) in between."""
        rate: Float = self.rotvec_camera_rad / ((self.t_second_us - self.t_first_us) / 1e6)
        return rate


class ImageGyro:
    """Turns pictures into turns; keeps the last picture it followed."""

    def __init__(self, camera: Camera, config: ImageGyroConfig | None = None) -> None:
        self.config = config or ImageGyroConfig()
        self._camera = camera
        self._tracker = CornerTracker(camera, self.config.tracker)
        self._t_us: int | None = None
        self._thumbnail: Image | None = None
        self._motion: PlanarMotion | None = None
        self._interval_s = 1.0

    def reset(self) -> None:
        """Forget the last picture, where the video does not go on from it."""
        self._tracker.reset()
        self._t_us = self._thumbnail = self._motion = None

    def step(self, t_us: int, image: Image, down_camera: Float) -> ImageTurn | None:
        """Use a grey picture with its frame time.

        ``down_camera`` (3,) is about where down is in camera axes, for the ground's normal: ``ned_from_camera[2]``. It
        may be off by 20 degrees. None for the first picture, one passed over, and where too few tracks agree.
        """
        if self._t_us is not None and not 0.0 <= (t_us - self._t_us) / 1e6 <= self.config.max_gap_s:
            self.reset()
        t_first_us = self._t_us
        if t_first_us is not None and t_us - t_first_us < self.config.interval_s * 1e6:
            return None
        if self._repeats(image):
            return None
        interval_s = 0.0 if t_first_us is None else (t_us - t_first_us) / 1e6
        start = self._expected(interval_s)
        tracks = self._tracker.track(image, None if start is None else self._predicted_uv(start))
        self._t_us, self._motion, self._interval_s = t_us, None, interval_s
        if tracks is None or t_first_us is None:
            return None
        motion = planar_motion(
            self._camera.undistort(tracks.previous_uv_px), self._camera.undistort(tracks.present_uv_px), down_camera,
            self.config.motion, start,
        )  # fmt: skip
        if motion is None:
            return None
        self._motion = motion
        return ImageTurn(t_first_us, t_us, motion.rotvec_camera_rad, motion.cov_rotvec_rad2)

    def _expected(self, interval_s: float) -> PlanarMotion | None:
        """The last motion gone on at the same rate."""
        if self._motion is None:
            return None
        ratio = interval_s / self._interval_s
        return replace(
            self._motion, rotvec_camera_rad=ratio * self._motion.rotvec_camera_rad,
            translation_by_distance=ratio * self._motion.translation_by_distance,
        )  # fmt: skip

    def _predicted_uv(self, motion: PlanarMotion) -> Float:
        xy = self._camera.undistort(self._tracker.corners_uv_px)
        points = np.column_stack((xy, np.ones(len(xy))))
        turned = points @ matrix_from_q(q_from_rotvec(motion.rotvec_camera_rad))
        return self._camera.project(turned + (points @ motion.down_camera)[:, None] * motion.translation_by_distance)

    def _repeats(self, image: Image) -> bool:
        thumbnail = image[::4, ::4].copy()
        last, self._thumbnail = self._thumbnail, thumbnail
        if last is None or last.shape != thumbnail.shape:
            return False
        return float(cv2.absdiff(thumbnail, last).mean()) < self.config.frozen_difference
