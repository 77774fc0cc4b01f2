"""Visual odometry step: follow corners from the previous picture and compare with the predicted motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_q, q_from_matrix
from estimator.history import rotation_between
from estimator.measurements.camera_attitude import CameraAttitude
from estimator.measurements.innovation import Innovation
from estimator.measurements.visual_odometry import SurfaceConfig, bare_ground, displacement
from estimator.odometry.odometers import odometer
from estimator.odometry.tracker import CornerTracker, TrackerConfig
from estimator.types import Float, Image


@dataclass(frozen=True, slots=True)
class OdometryConfig:
    """When to use a picture and how far to trust its tracks.

    ``interval_s`` thins out fast video; ``turn_relative_std`` is what clocks and scale factors leave of a turn between
    two pictures, as a share of its angle; ``frozen_difference`` is the mean grey change below which nothing moved.
    ``method`` names one of ``odometers.ODOMETERS``.
    """

    method: str = "rays"
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    interval_s: float = 0.25
    max_gap_s: float = 2.5
    pixel_std_px: float = 0.5
    relative_std: float = 0.012
    turn_relative_std: float = 0.01
    frozen_difference: float = 0.02
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)


@dataclass(frozen=True, slots=True, eq=False)
class OdometryStep:
    """What one picture says against the last: the motion, and that the surface is bare ground. None says nothing."""

    displacement: Innovation
    bare_ground: Innovation | None


class VisualOdometry:
    """Turns consecutive pictures into innovations on the filter's clone."""

    def __init__(self, camera: Camera, config: OdometryConfig) -> None:
        self.config = config
        self.took_picture = False
        self.frozen = False
        self._camera = camera
        self._odometer = odometer(config.method)
        self._tracker = CornerTracker(camera, config.tracker)
        self._t_us: int | None = None
        self._thumbnail: Image | None = None

    def step(
        self, t_us: int, image: Image, eskf: ErrorStateFilter, camera: CameraAttitude, camera_pos_ned_m: Float,
        down_at: Callable[[Float, Float], Float],
    ) -> OdometryStep | None:  # fmt: skip
        """Use a grey picture; ``took_picture`` says afterwards whether it is the one to follow from next."""
        self.took_picture = False
        if self._t_us is not None and t_us - self._t_us < self.config.interval_s * 1e6:
            return None
        if self._is_frozen(image):
            return None
        gap = self._t_us is None or t_us - self._t_us > self.config.max_gap_s * 1e6
        if gap:
            self._tracker.reset()
        clone = eskf.nominal.clone
        self.took_picture = True
        self._t_us = t_us
        if clone is None or gap:
            self._tracker.track(image)
            return None
        corners = self._tracker.corners_uv_px
        ned_from_first = matrix_from_q(clone.q_ned_from_camera)
        predicted = self._predicted_uv(corners, ned_from_first, clone.pos_ned_m, camera, camera_pos_ned_m, down_at)
        tracks = self._tracker.track(image, predicted)
        if tracks is None:
            return None
        both = self._camera.rays(np.concatenate((tracks.previous_uv_px, tracks.present_uv_px)))
        count = len(tracks.previous_uv_px)
        residual = self._odometer(
            both[:count] @ ned_from_first.T, both[count:] @ camera.ned_from_camera.T, clone.pos_ned_m,
            camera_pos_ned_m, down_at, self.config.pixel_std_px / self._camera.fx_px, self.config.relative_std,
        )  # fmt: skip
        if residual is None:
            return None
        innovation = displacement(eskf, residual, camera)
        turn_rad = np.linalg.norm(rotation_between(clone.q_ned_from_camera, q_from_matrix(camera.ned_from_camera)))
        # by the depth of the tracks' own ground, which is known where the ground below the camera may not be
        height_m = float(residual.by_rotation_second[1, 0])
        R = innovation.R + np.eye(2) * (self.config.turn_relative_std * turn_rad * height_m) ** 2
        distance_m = float(np.hypot(*(camera_pos_ned_m - clone.pos_ned_m)[:2]))
        return OdometryStep(replace(innovation, R=R), bare_ground(eskf, residual, distance_m, self.config.surface))

    def _predicted_uv(
        self, corners_uv_px: Float, ned_from_first: Float, first_pos_ned_m: Float, camera: CameraAttitude,
        camera_pos_ned_m: Float, down_at: Callable[[Float, Float], Float],
    ) -> Float | None:  # fmt: skip
        if len(corners_uv_px) == 0:
            return None
        down = float(down_at(first_pos_ned_m[0:1], first_pos_ned_m[1:2])[0])
        rays = self._camera.rays(corners_uv_px) @ ned_from_first.T
        with np.errstate(divide="ignore", invalid="ignore"):
            points = first_pos_ned_m + rays * ((down - first_pos_ned_m[2]) / rays[:, 2:])
        uv = self._camera.project((points - camera_pos_ned_m) @ camera.ned_from_camera)
        inside = (np.abs(uv - corners_uv_px) < self._camera.width_px).all(axis=1) & (rays[:, 2] > 0.05)
        return np.where(inside[:, None], uv, corners_uv_px)

    def _is_frozen(self, image: Image) -> bool:
        """Whether the picture repeats the last one: a still aircraft's pictures differ by their noise at least."""
        thumbnail = image[::4, ::4].copy()
        last, self._thumbnail = self._thumbnail, thumbnail
        if last is None or last.shape != thumbnail.shape:
            self.frozen = False
            return False
        difference = float(np.mean(np.abs(thumbnail.astype(np.int16) - last)))
        self.frozen = difference < self.config.frozen_difference
        return self.frozen
