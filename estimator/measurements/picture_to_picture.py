"""Visual odometry step: follow corners from the previous picture and compare with the predicted motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from estimator.filters.eskf import ErrorStateFilter
from estimator.filters.nominal import Clone
from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_q, q_from_matrix
from estimator.history import rotation_between
from estimator.integrity.picture import Repeats
from estimator.measurements.camera_attitude import CameraAttitude, camera_rotation_jacobian
from estimator.measurements.innovation import Innovation
from estimator.measurements.visual_odometry import SurfaceConfig, bare_ground, displacement, moments, surface
from estimator.odometry.odometers import odometer
from estimator.odometry.planar import DisplacementResidual, KnownHeights, displacement_residual
from estimator.odometry.structure import FollowedPoints, Structure, StructureConfig, triangulated
from estimator.odometry.tracker import CornerTracker, TrackerConfig
from estimator.types import Float, Image


@dataclass(frozen=True, slots=True)
class OdometryConfig:
    """When to use a picture and how far to trust its tracks.

    ``interval_s`` thins out fast video; ``turn_relative_std`` is what clocks and scale factors leave of a turn between
    two pictures, as a share of its angle; ``frozen_difference`` is the mean grey change below which nothing moved.
    ``method`` names one of ``odometers.ODOMETERS``. Only ``rays`` keeps the structure of what is seen, as ``structure``
    says (ADR 0011): ``structure_relative_std`` is in place of ``relative_std`` where heights are known by it, and with
    ``use_moments`` the turn and growth of the tracks since the keyframe count besides their mean motion.
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
    structure: StructureConfig = field(default_factory=StructureConfig)
    structure_relative_std: float = 0.001
    use_moments: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class OdometryStep:
    """What one picture says against the last: the motion, and the residual and distance (m) that it comes from."""

    displacement: Innovation
    residual: DisplacementResidual
    distance_m: float


class VisualOdometry:
    """Turns consecutive pictures into innovations on the filter's clone."""

    def __init__(self, camera: Camera, config: OdometryConfig) -> None:
        self.config = config
        self.took_picture = False
        self.frozen = False
        self._camera = camera
        self._odometer = odometer(config.method)
        self._tracker = CornerTracker(camera, config.tracker)
        self._points = FollowedPoints()
        self._height_m = float("inf")
        self._t_us: int | None = None
        self._repeats = Repeats(config.frozen_difference)

    def step(
        self, t_us: int, image: Image, eskf: ErrorStateFilter, camera: CameraAttitude, camera_pos_ned_m: Float,
        down_at: Callable[[Float, Float], Float],
    ) -> OdometryStep | None:  # fmt: skip
        """Use a grey picture; ``took_picture`` says afterwards whether it is the one to follow from next."""
        self.took_picture = False
        if self._t_us is not None and t_us - self._t_us < self.config.interval_s * 1e6:
            return None
        self.frozen = self._repeats.last(image)
        if self.frozen:
            return None
        gap = self._t_us is None or t_us - self._t_us > self.config.max_gap_s * 1e6
        if gap:
            self._tracker.reset()
        clone = eskf.nominal.clone
        self.took_picture = True
        self._t_us = t_us
        if clone is None or gap:
            self._tracker.track(image)
            self._follow(np.empty(0, dtype=np.intp))
            return None
        corners = self._tracker.corners_uv_px
        ned_from_first = matrix_from_q(clone.q_ned_from_camera)
        predicted = self._predicted_uv(corners, ned_from_first, clone.pos_ned_m, camera, camera_pos_ned_m, down_at)
        tracks = self._tracker.track(image, predicted)
        self._follow(np.empty(0, dtype=np.intp) if tracks is None else tracks.kept)
        if tracks is None:
            return None
        use, known = self._known_heights(eskf, len(tracks.kept))
        residual = self._residual(
            tracks.previous_uv_px[use], tracks.present_uv_px[use], clone, camera, camera_pos_ned_m, down_at, known
        )
        if residual is None:
            return None
        innovation = displacement(eskf, residual, camera)
        # by the depth of the tracks' own ground, which is known where the ground below the camera may not be
        self._height_m = height_m = float(residual.by_rotation_second[1, 0])
        R = innovation.R + np.eye(2) * (self._turn_std_rad(clone, camera) * height_m) ** 2
        distance_m = float(np.hypot(*(camera_pos_ned_m - clone.pos_ned_m)[:2]))
        return OdometryStep(replace(innovation, R=R), residual, distance_m)

    def fuse(
        self, t_us: int, image: Image, eskf: ErrorStateFilter,
        camera_now: Callable[[ErrorStateFilter], tuple[CameraAttitude, Float]],
        down_at: Callable[[Float, Float], Float], apply: Callable[[str, Innovation | None], bool],
    ) -> None:  # fmt: skip
        """Use a grey picture on the filter.

        ``camera_now`` gives the camera's attitude and position by the filter as it stands, ``down_at`` the ground model
        as corrected by it, and ``apply`` fuses an innovation under a name and says whether it was accepted.
        """
        camera, position = camera_now(eskf)
        if camera.being_turned:
            self.took_picture, self._t_us = False, None
            return
        step = self.step(t_us, image, eskf, camera, position, down_at)
        if step is not None and apply("odometry", step.displacement):
            # each in turn: the surface's height is what the next is about
            apply("surface", surface(eskf, step.residual, self.config.surface))
            apply("bare_ground", bare_ground(eskf, step.residual, step.distance_m, self.config.surface))
        if not self.took_picture:
            return
        camera, position = camera_now(eskf)
        keyframe = self._keyframe_due(eskf, position)
        if keyframe and apply("keyframe", self.since_keyframe(eskf, camera, position, down_at)):
            camera, position = camera_now(eskf)
        pose = Clone(position, q_from_matrix(camera.ned_from_camera))
        rotation = camera_rotation_jacobian(camera, eskf)
        if keyframe:
            structure = self.take_keyframe(eskf, camera, position)
            by_pose, cov = (None, None) if structure is None else (structure.by_pose, structure.cov)
            eskf.take_keyframe(pose, rotation, by_pose, cov)
        eskf.clone(pose, rotation)

    def _keyframe_due(self, eskf: ErrorStateFilter, camera_pos_ned_m: Float) -> bool:
        """Whether the picture just taken is far enough from the keyframe to be the next."""
        if not self._keeps_structure(eskf):
            return False
        keyframe = eskf.nominal.keyframe
        if keyframe is None:
            return True
        moved_m = float(np.hypot(*(camera_pos_ned_m - keyframe.pos_ned_m)[:2]))
        return moved_m >= self.config.structure.spacing * self._height_m

    def since_keyframe(
        self, eskf: ErrorStateFilter, camera: CameraAttitude, camera_pos_ned_m: Float,
        down_at: Callable[[Float, Float], Float],
    ) -> Innovation | None:  # fmt: skip
        """Motion from the keyframe to the picture just taken by the points whose height is known; None for too few."""
        keyframe = eskf.nominal.keyframe
        use, known = self._known_heights(eskf, len(self._points.down_m))
        if keyframe is None or known is None:
            return None
        residual = self._residual(
            self._points.keyframe_uv_px[use], self._tracker.corners_uv_px[use], keyframe, camera, camera_pos_ned_m,
            down_at, known, with_moments=self.config.use_moments,
        )  # fmt: skip
        if residual is None:
            return None
        motion = displacement(eskf, residual, camera, "keyframe")
        turn_std_rad = self._turn_std_rad(keyframe, camera)
        R = motion.R + np.eye(2) * (turn_std_rad * float(residual.by_rotation_second[1, 0])) ** 2
        if residual.moments is None:
            return replace(motion, R=R)
        turned = moments(eskf, residual.moments, camera, "keyframe")
        return Innovation(
            np.concatenate((motion.z, turned.z)), np.concatenate((motion.H, turned.H)),
            block_diag(R, turned.R + np.eye(2) * turn_std_rad**2),
        )  # fmt: skip

    def _turn_std_rad(self, first: Clone, camera: CameraAttitude) -> float:
        """What clocks and scale factors leave of the turn since an earlier picture."""
        turn_rad = np.linalg.norm(rotation_between(first.q_ned_from_camera, q_from_matrix(camera.ned_from_camera)))
        return self.config.turn_relative_std * float(turn_rad)

    def take_keyframe(
        self, eskf: ErrorStateFilter, camera: CameraAttitude, camera_pos_ned_m: Float
    ) -> Structure | None:
        """Triangulate the points anew between the keyframe and the picture just taken, which is the keyframe then."""
        keyframe, corners = eskf.nominal.keyframe, self._tracker.corners_uv_px
        structure = None
        if keyframe is not None and len(corners):
            seen = np.isfinite(self._points.keyframe_uv_px[:, 0])
            rays = np.full((2, len(corners), 3), np.nan)
            rays[0, seen] = (
                self._camera.rays(self._points.keyframe_uv_px[seen]) @ matrix_from_q(keyframe.q_ned_from_camera).T
            )
            rays[1] = self._camera.rays(corners) @ camera.ned_from_camera.T
            structure = triangulated(
                rays, np.stack((keyframe.pos_ned_m, camera_pos_ned_m)), self.config.pixel_std_px / self._camera.fx_px,
                self.config.structure,
            )  # fmt: skip
        self._points.take(corners, structure)
        return structure

    def _residual(
        self, first_uv_px: Float, second_uv_px: Float, first: Clone, camera: CameraAttitude, camera_pos_ned_m: Float,
        down_at: Callable[[Float, Float], Float], known: KnownHeights | None, with_moments: bool = False,
    ) -> DisplacementResidual | None:  # fmt: skip
        both = self._camera.rays(np.concatenate((first_uv_px, second_uv_px)))
        rays_first = both[: len(first_uv_px)] @ matrix_from_q(first.q_ned_from_camera).T
        rays_second = both[len(first_uv_px) :] @ camera.ned_from_camera.T
        pixel_std_rad = self.config.pixel_std_px / self._camera.fx_px
        if known is None:
            return self._odometer(
                rays_first, rays_second, first.pos_ned_m, camera_pos_ned_m, down_at, pixel_std_rad,
                self.config.relative_std,
            )  # fmt: skip
        return displacement_residual(
            rays_first, rays_second, first.pos_ned_m, camera_pos_ned_m, down_at, pixel_std_rad,
            self.config.structure_relative_std, known, with_moments,
        )  # fmt: skip

    def _known_heights(self, eskf: ErrorStateFilter, count: int) -> tuple[NDArray[np.bool_], KnownHeights | None]:
        """Which of the first ``count`` points to use, and their heights; see ``FollowedPoints.heights``."""
        if not self._keeps_structure(eskf):
            return np.ones(count, dtype=bool), None
        return self._points.heights(count, eskf.nominal.structure_m, self.config.structure.min_points)

    def _keeps_structure(self, eskf: ErrorStateFilter) -> bool:
        return self.config.method == "rays" and eskf.layout.has("structure")

    def _follow(self, kept: NDArray[np.intp]) -> None:
        self._points.follow(kept, len(self._tracker.corners_uv_px))

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
