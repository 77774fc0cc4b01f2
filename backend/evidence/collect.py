"""From a click that was located to its evidence."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import numpy as np

from backend.evidence.ground import WatchedGround, ground_part_of
from backend.evidence.piece import ground_piece, map_piece
from backend.evidence.registering import Registered, settings_part
from backend.evidence.schema import (
    CalibrationPart,
    CameraPart,
    ClickPart,
    Evidence,
    FileUsedPart,
    FramePart,
    FramePlacePart,
    GroundPart,
    MountPart,
    PicturePart,
    PieceName,
    PlacementPart,
    ProgramPart,
    RegistrationPart,
    ResultPart,
    StatePart,
    TargetPart,
)
from backend.fleet.feed import FrameIdentity
from backend.navigation.setup import NavigationSetup
from backend.store.targets import Target
from estimator.navigator_config import NavigatorConfig
from estimator.registration.placement import Placement
from estimator.targets.fusion import FusedTarget, FusionConfig
from estimator.targets.ray import MAX_RANGE_M, SLOPE_STEP_M, RayTarget
from estimator.types import Float, NavigationState


@dataclass(frozen=True, slots=True, eq=False)
class RegisteredPart:
    """How a clicked picture lies on the map, by which search; where the pixel is by ray and registration together."""

    placed: Placement
    search: Registered
    map_offset_std_m: float
    fusion: FusionConfig
    fused: FusedTarget


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A located click and what it was computed from. ``ground`` has seen where the computation looked.

    ``ray_method`` is that of the ray in a target's words; ``registered`` is there where the coordinate is not the ray's
    alone, and ``corrected`` says that the state was corrected by later fixes. ``ground_std_m`` and ``slope_std`` are
    the errors of its height and slope (one sigma) in the covariance.
    """

    target: Target
    frame: FrameIdentity
    state: NavigationState
    setup: NavigationSetup
    camera_uv_px: tuple[float, float]
    pixel_std_px: float
    ground: WatchedGround
    found: RayTarget
    assumption: str | None
    height_above_ground_m: float
    ground_std_m: float
    slope_std: float
    ray_method: str
    registered: RegisteredPart | None = None
    corrected: bool = False


def evidence_of(
    sighting: Sighting, source: str, files: list[FileUsedPart], picture: bytes | None, version: str
) -> tuple[Evidence, dict[PieceName, bytes]]:
    """The evidence of a sighting on a frame of a video ``source``, with the pieces of map and ground beside it.

    ``version`` is the program's.
    """
    target, frame, setup, found = sighting.target, sighting.frame, sighting.setup, sighting.found
    camera, mount, place = setup.camera, setup.mount, setup.frame
    u_px, v_px = sighting.camera_uv_px
    lens = sighting.state.lens_ned_m
    part = sighting.registered
    pos_ned_m = found.pos_ned_m if part is None else part.fused.pos_ned_m
    cov_ned_m2 = found.cov_ned_m2 if part is None else part.fused.cov_ned_m2
    registration, pieces = (None, {}) if part is None else _registration(part, sighting)
    evidence = Evidence(
        program=ProgramPart(name="pilotage", version=version),
        target=TargetPart(id=target.id, version=target.version, created_unix_us=target.created_unix_us),
        frame=FramePart(
            vehicle_id=target.vehicle_id or "", source=source, frame_id=frame.frame_id,
            t_unix_us=target.t_unix_us or frame.t_us, t_video_unix_us=frame.t_us, stamped=frame.stamped,
            width_px=frame.width_px, height_px=frame.height_px,
        ),
        click=ClickPart(
            u_px=target.u_px or 0.0, v_px=target.v_px or 0.0, camera_u_px=u_px, camera_v_px=v_px,
            std_px=sighting.pixel_std_px,
        ),
        state=_state(sighting.state, sighting.assumption, sighting.corrected),
        camera=CameraPart(
            width_px=camera.width_px, height_px=camera.height_px, fx_px=camera.fx_px, fy_px=camera.fy_px,
            cx_px=camera.cx_px, cy_px=camera.cy_px, distortion=list(camera.distortion),
        ),
        mount=MountPart(
            gimbal=setup.gimbal, roll_rad=mount.roll_rad, pitch_rad=mount.pitch_rad, yaw_rad=mount.yaw_rad,
            lever_arm_frd_m=mount.lever_arm_frd_m.tolist(),
        ),
        local_frame=FramePlacePart(lat_rad=place.lat_rad, lon_rad=place.lon_rad, alt_m=place.alt_m),
        ground=GroundPart(
            model=ground_part_of(sighting.ground, lens, found.pos_ned_m), std_m=sighting.ground_std_m,
            slope_std=sighting.slope_std, target_height_m=sighting.height_above_ground_m,
            slope_step_m=SLOPE_STEP_M, max_range_m=MAX_RANGE_M,
        ),
        files=files,
        calibration=_calibration(sighting.state),
        picture=_picture(picture),
        placement=None if part is None else _placement(part), registration=registration,
        result=ResultPart(
            lat_deg=target.lat_deg, lon_deg=target.lon_deg, alt_amsl_m=target.alt_amsl_m or 0.0,
            pos_ned_m=pos_ned_m.tolist(), cov_ned_m2=_matrix(cov_ned_m2), ray_method=found.method,
            method=target.method,
        ),
    )  # fmt: skip
    return evidence, pieces


def _state(state: NavigationState, assumption: str | None, corrected: bool) -> StatePart:
    return StatePart(
        t_unix_us=state.t_us, mode=str(state.mode), process_model=state.process_model, assumption=assumption,
        corrected_by_later_fixes=corrected,
        lat_rad=float(state.lat_rad), lon_rad=float(state.lon_rad), alt_amsl_m=float(state.alt_amsl_m),
        alt_agl_m=_known(state.alt_agl_m), pos_ned_m=state.pos_ned_m.tolist(),
        vel_ned_m_s=[_known(value) for value in state.vel_ned_m_s],
        q_ned_from_body=state.q_ned_from_body.tolist(), q_ned_from_camera=state.q_ned_from_camera.tolist(),
        cov_pos_ned_m2=_matrix(state.cov_pos_ned_m2), cov_camera_pose=_matrix(state.cov_camera_pose),
        last_fix_age_s=_known(state.last_fix_age_s), doubts=[str(doubt) for doubt in state.doubts],
        lever_ned_m=state.lever_ned_m.tolist(), ground_bias_m=float(state.ground_bias_m),
        cov_ground_bias=None if state.cov_ground_bias is None else state.cov_ground_bias.tolist(),
    )  # fmt: skip


def _placement(part: RegisteredPart) -> PlacementPart:
    placed, fusion = part.placed, part.fusion
    return PlacementPart(
        by=placed.by, centre_ned_m=placed.centre_ned_m.tolist(), pos_ned_m=placed.pos_ned_m.tolist(),
        ned_from_camera=placed.ned_from_camera.tolist(), correction=placed.correction.tolist(),
        cov=placed.cov.tolist(), map_std_m=placed.map_std_m, outlier_probability=placed.outlier_probability,
        map_offset_std_m=part.map_offset_std_m, cross=fusion.cross, pose_inflation=fusion.pose_inflation,
    )  # fmt: skip


def _registration(part: RegisteredPart, sighting: Sighting) -> tuple[RegistrationPart, dict[PieceName, bytes]]:
    search = part.search
    if search.map is None or search.ground is None:
        message = "a placement without a map is none"
        raise ValueError(message)
    of_map, of_ground = map_piece(search.map), ground_piece(search.ground)
    flat = search.ground.ground
    registration = RegistrationPart(
        state=_state(search.state, sighting.assumption, search.corrected), settings=settings_part(search.settings),
        map_offset_ne_m=list(sighting.setup.map_offset_ne_m), map=of_map.part,
        ground=None if of_ground is None else of_ground.part,
        ground_alt_amsl_m=float(flat.alt_amsl_m(np.zeros(1), np.zeros(1))[0]) if of_ground is None else None,
    )  # fmt: skip
    return registration, {**of_map.files, **({} if of_ground is None else of_ground.files)}


def _calibration(state: NavigationState) -> CalibrationPart | None:
    if state.process_model == "recorded":
        return None  # a table of estimates does not say with what it was made
    calibration = NavigatorConfig().matcher.calibrated()
    return CalibrationPart(channels=calibration.channel, version=calibration.version)


def _picture(picture: bytes | None) -> PicturePart:
    if picture is None:
        return PicturePart(file=None, sha256=None, problem="the picture was no longer held, or could not be decoded")
    return PicturePart(file="frame.jpg", sha256=hashlib.sha256(picture).hexdigest(), problem=None)


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _matrix(values: Float) -> list[list[float | None]]:
    return [[_known(value) for value in row] for row in np.asarray(values, dtype=np.float64)]
