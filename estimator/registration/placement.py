"""How a located picture lies on the map: registered once more at its pose, with how sure each part of that is."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.ground import ground_point_by_pose, intersect_terrain
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.alignment import CameraPose, Match, MatcherConfig, NoMatch, Registrar
from estimator.registration.confirm import footprint_size_m
from estimator.registration.likelihood import likelihood
from estimator.registration.ortho import CoarseMap, Ground
from estimator.registration.refine import Refinement
from estimator.robust import largest_std
from estimator.types import Float, Image

WINDOWS, WHOLE, KEYPOINTS = "windows", "whole picture", "keypoints"


@dataclass(frozen=True, slots=True)
class PlacementConfig:
    """``turn_rad`` and ``scale`` are how far corrections of heading and height are tried, and the search reaches
    ``max_sigmas`` of the pose and the map, at most ``radius_m``. ``inflation`` multiplies the sigma that windows
    claim, because neighbours err alike; they count where ``min_agreement`` of them agree. A whole picture's likelihood
    spreads over the hill about its peak, down to ``hill_share`` of it: what else a wide search found is in the outlier
    probability. ``surface_std_m`` is of the height at which what fills a whole picture stands above the ground model:
    seen aslant it lies displaced. ``heading_floor_rad`` and ``scale_floor`` are the least that is believed of
    hypotheses tried. ``map_std_m`` is the map's own local error, None what the matcher's calibration states;
    ``windows_map_std_m`` is that of a picture laid by its windows, whose inflated scatter may already hold it, None the
    same. ``levels_px`` across the footprint are tried one after the other: a map and a picture that are not alike in
    their finest detail may be so in what is larger. A match above ``max_outlier_probability``, or more than
    ``max_sigmas`` from where the pose has it, is none.
    """

    radius_m: float = 10.0
    turn_rad: float = 0.052
    scale: float = 0.04
    inflation: float = 3.0
    hill_share: float = 0.2
    surface_std_m: float = 3.0
    min_agreement: float = 0.4
    heading_floor_rad: float = 0.01
    scale_floor: float = 0.03
    map_std_m: float | None = None
    windows_map_std_m: float | None = None
    levels_px: tuple[int, ...] = (512, 160)
    max_outlier_probability: float = 0.3
    max_sigmas: float = 3.0
    matcher: MatcherConfig = field(default_factory=lambda: MatcherConfig(max_template_px=512))


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A picture on the map, as ``estimator.targets.registered`` takes it.

    ``correction`` (6,) and ``cov`` (6, 6): displacement of ``centre_ned_m`` (3,) north and east in metres, height above
    it as a share, rotation about the NED axes in radians. ``map_std_m`` is the map's own local error that ``cov``
    holds; ``by`` says whether windows, the whole picture or keypoints carried the match.
    """

    centre_ned_m: Float
    pos_ned_m: Float
    ned_from_camera: Float
    correction: Float
    cov: Float
    map_std_m: float
    outlier_probability: float
    by: str


def place(
    image: Image, camera: Camera, reference: ReferenceMap, model: GroundModel, origin_alt_amsl_m: float,
    pose: CameraPose, cov_pose: Float, prior_cov: Float, config: PlacementConfig | None = None,
) -> Placement | NoMatch:  # fmt: skip
    """Register a grey picture (rows, cols) at a pose that is right to a few metres.

    ``cov_pose`` (6, 6) is what is known of the pose's error, ``prior_cov`` (6, 6) what was before the picture.
    """
    config = config or PlacementConfig()
    try:
        ground = Ground(model, origin_alt_amsl_m, pose.pos_ned_m[:2], config.radius_m)
    except ValueError as error:
        return NoMatch(str(error))
    size_m = footprint_size_m(camera, pose, ground, config.matcher.max_obliquity_rad)
    if size_m is None:
        return NoMatch("the camera does not see the ground below the horizon limit")
    best: Placement | NoMatch = NoMatch("the reference map is coarser than the picture's footprint")
    for level_px in config.levels_px:
        gsd_m = max(reference.gsd_m, size_m / level_px)
        registrar = Registrar(camera, CoarseMap(reference, gsd_m), model, origin_alt_amsl_m, config.matcher)
        tried = _place_by(registrar, image, pose, ground, cov_pose, prior_cov, config)
        if isinstance(tried, Placement) and tried.by == WINDOWS:
            return tried
        if isinstance(best, NoMatch):
            best = tried
    return best


def _place_by(
    registrar: Registrar, image: Image, pose: CameraPose, ground: Ground, cov_pose: Float, prior_cov: Float,
    config: PlacementConfig,
) -> Placement | NoMatch:  # fmt: skip
    turns = _steps(config.turn_rad, config.matcher.heading_step_rad)
    scales = _steps(config.scale, config.matcher.scale_step)
    stated = registrar.calibration.likelihood
    radius_m = search_radius_m(pose, ground, cov_pose, config)
    match = registrar.register(image, pose, radius_m, turns, scales)
    if isinstance(match, NoMatch):
        return match
    if match.peak.at_edge:
        return NoMatch("the picture fits the map best at the edge of the search: its place there is not known")
    if match.outlier_probability > config.max_outlier_probability:
        return NoMatch(f"the match is too weak (outlier probability {match.outlier_probability:.2f})")
    map_std_m = stated.local_std_m(match.correlation.step_m) if config.map_std_m is None else config.map_std_m
    refined = registrar.refine(match, match.displacement_ne_m, prior_cov)
    if refined is not None and refined.agreement >= config.min_agreement:
        correction, cov, by = *_by_windows(match, pose, refined, prior_cov, config), WINDOWS
        map_std_m = map_std_m if config.windows_map_std_m is None else config.windows_map_std_m
    else:
        correction, cov, by = *_by_whole(match, pose, registrar, cov_pose, config), WHOLE
    cov[:2, :2] += np.eye(2) * map_std_m**2
    T = by_centre(match.centre_ned_m, pose.pos_ned_m)
    both = cov[:2, :2] + (T @ cov_pose @ T.T)[:2, :2]
    if correction[:2] @ np.linalg.solve(both, correction[:2]) > config.max_sigmas**2:
        away_m = float(np.hypot(*correction[:2]))
        return NoMatch(f"the match with the map contradicts the place of the photo by {away_m:.1f} m")
    return Placement(
        match.centre_ned_m, pose.pos_ned_m, pose.ned_from_camera, correction, cov, map_std_m,
        match.outlier_probability, by,
    )  # fmt: skip


def place_by_keypoints(
    model: GroundModel,
    origin_alt_amsl_m: float,
    pose: CameraPose,
    cov_pose: Float,
    config: PlacementConfig | None = None,
) -> Placement | NoMatch:
    """The placement of a picture whose pose is that of keypoints matched with the map: they are the registration.

    For where the map does not fill the picture, or differs in tone all over it. ``cov_pose`` (6, 6) is of the pose.
    """
    config = config or PlacementConfig()
    try:
        ground = Ground(model, origin_alt_amsl_m, pose.pos_ned_m[:2], config.radius_m)
    except ValueError as error:
        return NoMatch(str(error))
    axis = pose.ned_from_camera[:, 2]
    centre = intersect_terrain(pose.pos_ned_m, axis, ground.down_m)
    if not np.isfinite(centre).all():
        return NoMatch("the camera's axis meets no ground")
    stated = config.matcher.calibrated().likelihood.map_std_m
    map_std_m = stated if config.map_std_m is None else config.map_std_m
    T = by_centre(centre, pose.pos_ned_m)
    cov = T @ cov_pose @ T.T
    cov[:2, :2] += np.eye(2) * map_std_m**2
    return Placement(centre, pose.pos_ned_m, pose.ned_from_camera, np.zeros(6), cov, map_std_m, 0.0, KEYPOINTS)


def by_centre(centre_ned_m: Float, pos_ned_m: Float) -> Float:
    """A pose error (6,) as displacement of the centre, share of the height and rotation: the matrix (6, 6) for that."""
    to_centre = centre_ned_m - pos_ned_m
    matrix = np.eye(6)
    matrix[:2] = ground_point_by_pose(to_centre[:2] / to_centre[2], np.asarray(to_centre[2]))
    matrix[2, 2] = -1.0 / to_centre[2]
    return matrix


def search_radius_m(pose: CameraPose, ground: Ground, cov_pose: Float, config: PlacementConfig) -> float:
    """How far about the pose's middle a match is sought: the sigmas of pose (6, 6) and map, within the radius."""
    aim = pose.ned_from_camera[:, 2]
    height_m = float(ground.down_at_m(pose.pos_ned_m[:2]) - pose.pos_ned_m[2])
    T = by_centre(pose.pos_ned_m + aim * (height_m / max(float(aim[2]), 0.2)), pose.pos_ned_m)
    std_m = largest_std((T @ cov_pose @ T.T)[:2, :2])
    map_std_m = config.matcher.calibrated().likelihood.map_std_m
    return min(config.radius_m, config.max_sigmas * float(np.hypot(std_m, map_std_m)))


def _by_windows(
    match: Match, pose: CameraPose, refined: Refinement, prior_cov: Float, config: PlacementConfig
) -> tuple[Float, Float]:
    prior = np.asarray(np.linalg.inv(prior_cov), dtype=np.float64)
    cov_x = np.linalg.inv(prior + refined.information / config.inflation**2)
    T = by_centre(match.centre_ned_m, pose.pos_ned_m)
    return T @ refined.x, T @ cov_x @ T.T


def _by_whole(
    match: Match, pose: CameraPose, registrar: Registrar, cov_pose: Float, config: PlacementConfig
) -> tuple[Float, Float]:
    """Displacement by the likelihood's own spread; heading and scale weighed with what the pose had of them."""
    T = by_centre(match.centre_ned_m, pose.pos_ned_m)
    known = np.sqrt(np.diag(T @ cov_pose @ T.T))
    correction, std = np.zeros(6), known.copy()
    correction[:2] = match.displacement_ne_m
    found = (
        (2, match.scale, match.scale_std, config.scale_floor),
        (5, match.heading_rad, match.heading_std_rad, config.heading_floor_rad),
    )
    for index, value, value_std, floor in found:
        if np.isfinite(value_std):
            variance = value_std**2 + floor**2
            # both are of the same picture: their mean is believed no more than the better of them
            correction[index] = value * known[index] ** 2 / (variance + known[index] ** 2)
            std[index] = min(np.sqrt(variance), known[index])
    cov = np.diag(std**2)
    axis = pose.ned_from_camera[:, 2]
    by_height = config.surface_std_m * axis[:2] / max(float(axis[2]), 0.2)
    cov[:2, :2] = _spread_m2(match, registrar, config.hill_share) + np.outer(by_height, by_height)
    return correction, cov


def _spread_m2(match: Match, registrar: Registrar, hill_share: float) -> Float:
    """Covariance (2, 2) of the displacement about its peak, without the map's own error, which comes on top.

    It is of the cells that a path above ``hill_share`` of the peak leads to.
    """
    step_m = match.correlation.step_m
    calibration = registrar.calibration.likelihood
    values, north_max_m, east_min_m = likelihood(match.correlation, match.peak, calibration, 0.0, step_m)
    density = np.maximum(values - values.min(), 0.0)
    north = north_max_m - step_m * np.arange(values.shape[0]) - match.displacement_ne_m[0]
    east = east_min_m + step_m * np.arange(values.shape[1]) - match.displacement_ne_m[1]
    at_peak = int(np.abs(north).argmin()), int(np.abs(east).argmin())
    _, hills = cv2.connectedComponents((density >= hill_share * density[at_peak]).astype(np.uint8))
    density[hills != hills[at_peak]] = 0.0
    total = float(density.sum())
    if not total > 0.0:
        return np.eye(2) * float(north.max() - north.min()) ** 2 / 12.0
    n2, e2 = float((density.sum(axis=1) * north**2).sum()), float((density.sum(axis=0) * east**2).sum())
    ne = float(north @ density @ east)
    cov = np.array([[n2, ne], [ne, e2]]) / total
    # the likelihood is blurred by the map's error already; half a pixel is the least that a peak is good to
    own = calibration.local_std_m(step_m)
    eigenvalues, axes = np.linalg.eigh(cov)
    spread: Float = (axes * np.maximum(eigenvalues - own**2, (0.5 * step_m) ** 2)) @ axes.T
    return spread


def _steps(reach: float, step: float) -> Float:
    count = int(reach / step)
    return step * np.arange(-count, count + 1, dtype=np.float64)
