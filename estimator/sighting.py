"""One click on one picture by every method: the ray from the pose, the place by the picture's own registration."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.alignment import CameraPose, NoMatch
from estimator.registration.placement import Placement, PlacementConfig, place
from estimator.targets.fusion import FusedTarget, FusionConfig, TargetSighting, fuse
from estimator.targets.ray import Lowered, RayTarget, locate_ray, pose_above_ground
from estimator.targets.registered import RegisteredTarget, TargetErrors, locate_registered
from estimator.types import Float, Image, NavigationState

POSITION_STD_M = 10.0
"""What the registration is told of the pose's position beyond the pose's own: next to nothing."""
SEARCH_SIGMAS, MAX_RADIUS_M = 3.0, 60.0
TRY_SIGMAS, MAX_TURN_RAD, MAX_SCALE = 2.0, 0.2, 0.12
ALIKE_SHARE = 0.5
"""Of the footprint: over such distances the errors of registrations, and of poses made of them, stay alike."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What pictures look at: the camera, the ground with its errors at a point and per metre away, the map if any."""

    camera: Camera
    ground: GroundModel
    frame: LocalFrame
    reference: ReferenceMap | None
    ground_std_m: float
    slope_std: float
    map_offset_std_m: float = 0.0
    placement: PlacementConfig = field(default_factory=lambda: PlacementConfig(windows_map_std_m=0.0))
    fusion: FusionConfig = field(default_factory=FusionConfig)


@dataclass(frozen=True, slots=True, eq=False)
class ClickPlaces:
    """What a click shows by each method, and by all; ``refusal`` says why there is no registered place."""

    ray: RayTarget | None
    registered: RegisteredTarget | None
    refusal: str
    sightings: tuple[TargetSighting, ...]
    fused: FusedTarget

    @property
    def method(self) -> str:
        """In the words of ``targets.csv``."""
        if self.ray is not None and self.registered is not None:
            return "fused"
        return self.registered.method if self.registered is not None else self.ray.method if self.ray else ""


def lay_on_map(image: Image, state: NavigationState, scene: Scene) -> Placement | NoMatch:
    """Register a grey picture (rows, cols) to the map, of ``state`` only the attitude and the height being believed."""
    if scene.reference is None:
        return NoMatch("there is no map")
    cov, _ = pose_above_ground(state)
    prior = cov.copy()
    prior[:2, :2] += np.eye(2) * POSITION_STD_M**2
    pose = CameraPose(state.lens_ned_m, matrix_from_q(state.q_ned_from_camera))
    ground = Lowered(scene.ground, state.ground_bias_m)
    config = _reaching(scene.placement, cov, state.alt_agl_m)
    return place(image, scene.camera, scene.reference, ground, scene.frame.alt_m, pose, cov, prior, config)


def _reaching(config: PlacementConfig, cov_pose: Float, height_m: float) -> PlacementConfig:
    """The search as wide as the pose's covariance (6, 6) asks for, at least as configured."""
    std = np.sqrt(np.diag(cov_pose))
    height_m = height_m if np.isfinite(height_m) else 0.0
    radius_m = SEARCH_SIGMAS * float(np.hypot(np.hypot(*std[:2]), height_m * np.hypot(*std[3:5])))
    turn_rad = TRY_SIGMAS * float(std[5])
    scale = TRY_SIGMAS * float(std[2]) / max(height_m, 1.0)
    return replace(
        config, radius_m=float(np.clip(radius_m, config.radius_m, MAX_RADIUS_M)),
        turn_rad=float(np.clip(turn_rad, config.turn_rad, MAX_TURN_RAD)),
        scale=float(np.clip(scale, config.scale, MAX_SCALE)),
    )  # fmt: skip


def locate_click(
    uv_px: tuple[float, float], state: NavigationState, placed: Placement | NoMatch, scene: Scene,
    pixel_std_px: float, click: int, height_above_ground_m: float = 0.0,
) -> ClickPlaces:  # fmt: skip
    """Coordinates of what a pixel shows, by the ray and by how the picture was laid on the map.

    ``click`` numbers the clicks of a target.

    Raises
    ------
    GeometryError
        No method has a place: the pixel lies outside the picture, shows the sky, or ground that is not known.
    """
    ray, registered, refusal = None, None, placed.reason if isinstance(placed, NoMatch) else ""
    problem: GeometryError | None = None
    try:
        ray = locate_ray(
            state, scene.camera, uv_px, scene.ground, scene.frame, scene.ground_std_m, pixel_std_px,
            height_above_ground_m, slope_std=scene.slope_std,
        )  # fmt: skip
    except GeometryError as error:
        problem = error
    if isinstance(placed, Placement):
        bias_var_m2 = 0.0 if state.cov_ground_bias is None else float(state.cov_ground_bias[6])
        errors = TargetErrors(
            pixel_std_px, scene.ground_std_m, scene.slope_std, 0.0, scene.map_offset_std_m, float(np.sqrt(bias_var_m2))
        )
        try:
            registered = locate_registered(
                placed, scene.camera, uv_px, Lowered(scene.ground, state.ground_bias_m), scene.frame, errors,
                height_above_ground_m,
            )  # fmt: skip
        except GeometryError as error:
            refusal = str(error)
    sightings = tuple(_sighting(each, state, scene, click) for each in (ray, registered) if each is not None)
    if not sightings:
        raise problem if problem is not None else GeometryError(refusal)
    fused = fuse(sightings, scene.map_offset_std_m, scene.fusion)
    return ClickPlaces(ray, registered, refusal, sightings, fused)


def _sighting(found: RayTarget | RegisteredTarget, state: NavigationState, scene: Scene, click: int) -> TargetSighting:
    lens = state.lens_ned_m
    footprint_m = float(np.linalg.norm(found.pos_ned_m - lens)) * scene.camera.width_px / scene.camera.fx_px
    return TargetSighting.of(found, lens, ALIKE_SHARE * footprint_m, click)
