"""A target's coordinate computed again from its evidence, by the estimator's own function."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from backend.errors import BundleError
from backend.evidence.ground import ground_model_of
from backend.evidence.schema import Evidence, PlacementPart, StatePart
from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.geometry.local import LocalFrame
from estimator.registration.placement import Placement
from estimator.sighting import Scene, locate_click
from estimator.targets.fusion import FusionConfig
from estimator.targets.ray import locate_ray
from estimator.types import Float, Mode, NavigationState
from geodata.maps import sha256_of_file

# Far below what a coordinate of eight decimals tells, far above what another machine's arithmetic changes.
TOLERANCE_M = 1e-3
COV_TOLERANCE = 1e-6
CAMERA_PIXEL_TOLERANCE_PX = 1e-6
# Estimates are recorded with eight digits: as much may be missing of a covariance that is nearly singular.
EIGENVALUE_TOLERANCE = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Recomputed:
    """The coordinate that the evidence gives, its covariance (3, 3) in NED, and by which methods."""

    lat_rad: float
    lon_rad: float
    alt_amsl_m: float
    pos_ned_m: Float
    cov_ned_m2: Float
    ray_method: str
    method: str


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What came out. ``distance_m`` is from the stated coordinate to the recomputed, ``distance_sigmas`` by its
    covariance (Mahalanobis), ``cov_change`` the largest difference of covariances over the largest variance.
    """

    recomputed: Recomputed
    distance_m: float
    distance_sigmas: float
    cov_change: float
    same_method: bool

    @property
    def agrees(self) -> bool:
        """Whether the stated coordinate is what the evidence gives."""
        return self.same_method and self.distance_m <= TOLERANCE_M and self.cov_change <= COV_TOLERANCE


def verify(evidence: Evidence, name: str) -> Verdict:
    """Compute the coordinate of evidence again and compare.

    Raises
    ------
    BundleError
        What the evidence states is impossible: a covariance that is none, a rotation that is none, a ray that meets no
        ground. ``name`` says in it which file.
    """
    cov_stated = covariance(evidence.result.cov_ned_m2, "the result's covariance (result.cov_ned_m2)", name)
    _, frame = camera_and_frame(evidence, name)
    try:
        placed = None if evidence.placement is None else _placement(evidence.placement, name)
        found = recomputed(evidence, placed, name)
    except GeometryError as error:
        raise BundleError(name, f"gives no coordinate: {error}") from None
    except ValueError as error:
        raise BundleError(name, f"states what cannot be: {error}") from None
    cov = covariance(found.cov_ned_m2.tolist(), "the recomputed covariance", name)
    stated = evidence.result
    apart = _ned_of(frame, stated.lat_deg, stated.lon_deg, stated.alt_amsl_m) - found.pos_ned_m
    return Verdict(
        found,
        float(np.linalg.norm(apart)),
        math.sqrt(max(float(apart @ np.linalg.solve(cov, apart)), 0.0)),
        float(np.max(np.abs(cov_stated - cov)) / np.max(np.diag(cov))),
        found.ray_method == stated.ray_method,
    )


def camera_and_frame(evidence: Evidence, name: str) -> tuple[Camera, LocalFrame]:
    """The calibrated camera and the local frame; BundleError where they cannot be."""
    part, place = evidence.camera, evidence.local_frame
    try:
        camera = Camera(
            part.width_px, part.height_px, part.fx_px, part.fy_px, part.cx_px, part.cy_px, _five(part.distortion)
        )
        return camera, LocalFrame(place.lat_rad, place.lon_rad, place.alt_m)
    except ValueError as error:
        raise BundleError(name, f"states what cannot be: {error}") from None


def recomputed(evidence: Evidence, placed: Placement | None, name: str) -> Recomputed:
    """The coordinate of the click by the state's ray, and by how its picture is ``placed`` on the map, if it is.

    Raises
    ------
    GeometryError, ValueError
        There is none.
    BundleError
        The state cannot be.
    """
    _check_pixel(evidence, name)
    state = state_of(evidence.state, "state", name)
    camera, frame = camera_and_frame(evidence, name)
    click, of, part = evidence.click, evidence.ground, evidence.placement
    uv_px, ground = (click.camera_u_px, click.camera_v_px), ground_model_of(of.model)
    if part is None or placed is None:
        ray = locate_ray(
            state, camera, uv_px, ground, frame, of.std_m, click.std_px, of.target_height_m, of.max_range_m,
            of.slope_std,
        )  # fmt: skip
        return Recomputed(
            ray.lat_rad, ray.lon_rad, ray.alt_amsl_m, ray.pos_ned_m, ray.cov_ned_m2, ray.method, ray.method
        )
    fusion = FusionConfig(part.cross, part.pose_inflation)
    scene = Scene(camera, ground, frame, None, of.std_m, of.slope_std, part.map_offset_std_m, fusion=fusion)
    places = locate_click(uv_px, state, placed, scene, click.std_px, 0, of.target_height_m)
    if places.ray is None or places.registered is None:
        raise BundleError(name, f"gives no coordinate by registration: {places.refusal or 'its ray meets no ground'}")
    lat, lon, alt = frame.geodetic_from_ned(places.fused.pos_ned_m)
    return Recomputed(
        float(lat), float(lon), float(alt), places.fused.pos_ned_m, places.fused.cov_ned_m2, places.ray.method,
        places.method,
    )  # fmt: skip


def _placement(part: PlacementPart, name: str) -> Placement:
    rotation = np.array(part.ned_from_camera)
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise BundleError(name, "placement.ned_from_camera is no rotation")
    cov = covariance([list(row) for row in part.cov], "the placement's covariance (placement.cov)", name)
    return Placement(
        np.array(part.centre_ned_m), np.array(part.pos_ned_m), rotation, np.array(part.correction), cov,
        part.map_std_m, part.outlier_probability, part.by,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class FileMatch:
    """Which file of the evidence one on the disk is; ``is_source`` where it is what that was imported from."""

    path: Path
    role: Literal["reference", "elevation"]
    file: str
    is_source: bool

    @property
    def words(self) -> str:
        """For people."""
        if self.is_source:
            return f"the file that the {self.role} was imported from, '{self.file}'"
        return f"the {self.role} in use, '{self.file}'"


def matching_file(evidence: Evidence, path: Path) -> FileMatch | None:
    """Which file of the evidence a file on the disk is; None where it is none of them.

    Raises
    ------
    BundleError
        The file cannot be read.
    """
    try:
        found = sha256_of_file(path)
    except OSError as error:
        raise BundleError(str(path), f"cannot be read: {error.strerror or error}") from None
    for file in evidence.files:
        if found == file.sha256:
            return FileMatch(path, file.role, file.file, is_source=False)
        if found == file.source_sha256:
            return FileMatch(path, file.role, file.source_file or file.file, is_source=True)
    return None


def covariance(rows: list[list[float | None]], what: str, name: str) -> Float:
    """A covariance (n, n); BundleError where the numbers are not one."""
    if any(value is None for row in rows for value in row):
        raise BundleError(name, f"{what} is not known: how sure the coordinate is cannot be said")
    cov = np.array(rows, dtype=np.float64)
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    if not np.all(np.isfinite(cov)) or not np.all(std > 0.0):
        raise BundleError(name, f"{what} is not positive definite: its variances are {np.diag(cov).tolist()}")
    correlation = cov / std[:, np.newaxis] / std
    if not np.allclose(correlation, correlation.T, rtol=0.0, atol=EIGENVALUE_TOLERANCE):
        raise BundleError(name, f"{what} is not symmetric")
    least = float(np.linalg.eigvalsh(correlation)[0])
    if least < -EIGENVALUE_TOLERANCE:
        raise BundleError(name, f"{what} is not positive definite: an eigenvalue of its correlations is {least:.3g}")
    return cov


def _check_ground_bias(state: StatePart, cov_pose: Float, where: str, name: str) -> None:
    """The ground's bias must be as uncertain as goes with the pose's covariance (6, 6)."""
    last = state.cov_ground_bias
    if last is not None:
        joint: list[list[float | None]] = [[*row, last[n]] for n, row in enumerate(cov_pose.tolist())]
        what = f"the covariance of pose and ground bias ({where}.cov_camera_pose, {where}.cov_ground_bias)"
        covariance([*joint, list(last)], what, name)


def _check_pixel(evidence: Evidence, name: str) -> None:
    click, frame, camera = evidence.click, evidence.frame, evidence.camera
    # Pixel centres are whole numbers, so the picture's edge lies at -0.5.
    u_px = (click.u_px + 0.5) * camera.width_px / frame.width_px - 0.5
    v_px = (click.v_px + 0.5) * camera.height_px / frame.height_px - 0.5
    if not math.hypot(u_px - click.camera_u_px, v_px - click.camera_v_px) <= CAMERA_PIXEL_TOLERANCE_PX:
        raise BundleError(
            name,
            f"the click ({click.u_px:g}, {click.v_px:g}) is pixel ({u_px:g}, {v_px:g}) of the camera, "
            f"not ({click.camera_u_px:g}, {click.camera_v_px:g}) as stated",
        )


def state_of(state: StatePart, where: str, name: str) -> NavigationState:
    """The state that evidence has at ``where``; BundleError where it cannot be."""
    cov_pose = covariance(state.cov_camera_pose, f"the camera pose's covariance ({where}.cov_camera_pose)", name)
    _check_ground_bias(state, cov_pose, where, name)
    q = np.array(state.q_ned_from_camera)
    if not abs(float(np.linalg.norm(q)) - 1.0) < 1e-6:
        raise BundleError(name, f"{where}.q_ned_from_camera is no rotation: its length is {np.linalg.norm(q):g}")
    try:
        mode = Mode(state.mode)
    except ValueError as error:
        raise BundleError(name, f"states what cannot be: {error}") from None
    return NavigationState(
        t_us=state.t_unix_us, mode=mode, process_model=state.process_model, lat_rad=state.lat_rad,
        lon_rad=state.lon_rad, alt_amsl_m=state.alt_amsl_m, alt_agl_m=_number(state.alt_agl_m),
        pos_ned_m=np.array(state.pos_ned_m), vel_ned_m_s=np.array([_number(value) for value in state.vel_ned_m_s]),
        q_ned_from_body=np.array(state.q_ned_from_body), q_ned_from_camera=q,
        cov_pos_ned_m2=np.array([[_number(value) for value in row] for row in state.cov_pos_ned_m2]),
        cov_vel_ned_m2_s2=np.full((3, 3), np.nan), cov_attitude_rad2=cov_pose[3:, 3:],
        cov_camera_pose=cov_pose, last_fix_age_s=_number(state.last_fix_age_s),
        lever_ned_m=np.array(state.lever_ned_m), ground_bias_m=state.ground_bias_m,
        cov_ground_bias=None if state.cov_ground_bias is None else np.array(state.cov_ground_bias),
    )  # fmt: skip


def _ned_of(frame: LocalFrame, lat_deg: float, lon_deg: float, alt_m: float) -> Float:
    return frame.ned_from_geodetic(math.radians(lat_deg), math.radians(lon_deg), alt_m)


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _five(values: list[float]) -> tuple[float, float, float, float, float]:
    k1, k2, p1, p2, k3 = values
    return k1, k2, p1, p2, k3
