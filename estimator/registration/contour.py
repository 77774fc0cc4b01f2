"""The published registration for target geo-location: contours correlated after an alignment by straight lines.

Conte, Vision-based localization and guidance for unmanned aerial vehicles, 2009, sections 7.3.1 and 7.3.3 (algorithm
1); Conte, Hempel, Rudol et al., High accuracy ground target geo-location using autonomous micro aerial vehicle
platforms, AIAA Guidance, Navigation and Control 2008. Median filter, scaling to the map's resolution, Sobel, a turn by
the angle between the Hough lines of picture and map where that is below 45 degrees, correlation of the contours.

Two things differ. Scaling comes before Sobel: a derivative at the camera's resolution is mostly the sensor's noise. And
the angle between "corresponding" lines is the peak of the correlation of their length over bearing (``lines``), as the
paper does not say how lines correspond and a mean over wrong pairs is no angle. ``Alignment.HYPOTHESES`` goes beyond:
lines have no direction and streets cross at right angles, so several angles are tried and the contours choose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

import cv2
import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_euler
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.alignment import CameraPose, MatcherConfig, NoMatch, Registrar
from estimator.registration.confirm import footprint_size_m
from estimator.registration.lines import headings_by_lines
from estimator.registration.ortho import CoarseMap, Ground, map_area, rectify
from estimator.registration.placement import Placement, PlacementConfig, place, search_radius_m
from estimator.types import Float, Image

CONTOURS = "contours"
CHANNELS = "edge_overlap"


class Alignment(StrEnum):
    """Which heading the picture is laid on the map with.

    ``telemetry`` is the pose's own, ``lines`` what algorithm 1 makes of it, ``hypotheses`` the one of both and of the
    lesser angles at which picture and map are most alike. ``sweep`` asks no lines: it tries every heading in reach.
    """

    TELEMETRY = "telemetry"
    LINES = "lines"
    HYPOTHESES = "hypotheses"
    SWEEP = "sweep"


@dataclass(frozen=True, slots=True)
class AlignmentConfig:
    """``reach_rad`` is algorithm 1's bound on the heading's error, within ``max_sigmas`` of what is known of it;
    ``most`` the number of the lines' angles tried, each with a neighbour ``step_rad`` to either side, and a sweep goes
    in steps of ``sweep_step_rad``. ``max_px`` across the footprint are compared, and ``std_rad`` is how well an aligned
    heading is known."""

    by: Alignment = Alignment.HYPOTHESES
    reach_rad: float = math.radians(45.0)
    most: int = 6
    step_rad: float = 0.035
    sweep_step_rad: float = math.radians(3.0)
    max_sigmas: float = 3.0
    max_px: int = 512
    std_rad: float = 0.05


def _contour_placement() -> PlacementConfig:
    # windows are of another method: no share of them ever agrees
    return PlacementConfig(
        radius_m=30.0, min_agreement=math.inf, levels_px=(512,),
        matcher=MatcherConfig(channels=CHANNELS, max_template_px=512),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class ContourConfig:
    """``median_px`` (odd; 0 for none) is the median filter's side at the camera's own resolution.

    The paper takes the best place whatever it is like, and leaves false ones to the filter over many sightings: that is
    ``placement.max_outlier_probability`` of 1. One picture alone must be judged, and by default is.
    """

    median_px: int = 5
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    placement: PlacementConfig = field(default_factory=_contour_placement)

    def __post_init__(self) -> None:
        if self.median_px != 0 and (self.median_px < 3 or self.median_px % 2 == 0):
            message = f"median_px must be 0 or an odd number from 3, not {self.median_px}"
            raise ValueError(message)


def place_by_contours(
    image: Image, camera: Camera, reference: ReferenceMap, model: GroundModel, origin_alt_amsl_m: float,
    pose: CameraPose, cov_pose: Float, prior_cov: Float, config: ContourConfig | None = None,
) -> Placement | NoMatch:  # fmt: skip
    """Register a grey picture (rows, cols) by its contours at a pose whose heading may be 45 degrees off.

    ``cov_pose`` (6, 6) is what is known of the pose's error, ``prior_cov`` (6, 6) what was before the picture, as for
    ``placement.place``. The placement's rotation is the aligned one.
    """
    config = config or ContourConfig()
    smooth = image
    if config.median_px:
        smooth = np.asarray(cv2.medianBlur(image, config.median_px), dtype=np.uint8)
    placed = place_aligned(
        smooth, camera, reference, model, origin_alt_amsl_m, pose, cov_pose, prior_cov, config.alignment,
        config.placement,
    )  # fmt: skip
    return placed if isinstance(placed, NoMatch) else replace(placed, by=CONTOURS)


def place_aligned(
    image: Image, camera: Camera, reference: ReferenceMap, model: GroundModel, origin_alt_amsl_m: float,
    pose: CameraPose, cov_pose: Float, prior_cov: Float, alignment: AlignmentConfig, placement: PlacementConfig,
) -> Placement | NoMatch:  # fmt: skip
    """``placement.place`` at the pose turned by its alignment, whose heading is known as well as that is."""
    if alignment.by is Alignment.TELEMETRY:
        return place(image, camera, reference, model, origin_alt_amsl_m, pose, cov_pose, prior_cov, placement)
    turn_rad = align(image, camera, reference, model, origin_alt_amsl_m, pose, cov_pose, alignment, placement)
    if isinstance(turn_rad, NoMatch):
        return turn_rad
    known, before = (_heading_known(cov, alignment.std_rad) for cov in (cov_pose, prior_cov))
    aligned = turned(pose, turn_rad)
    return place(image, camera, reference, model, origin_alt_amsl_m, aligned, known, before, placement)


def align(
    image: Image, camera: Camera, reference: ReferenceMap, model: GroundModel, origin_alt_amsl_m: float,
    pose: CameraPose, cov_pose: Float, config: AlignmentConfig, placement: PlacementConfig,
) -> float | NoMatch:  # fmt: skip
    """Correction of the heading, radians: what the telemetry's lacks, 0 where the lines do not say.

    ``cov_pose`` (6, 6) bounds heading and place; among several headings the ``placement``'s matcher chooses.
    """
    if config.by is Alignment.TELEMETRY:
        return 0.0
    try:
        ground = Ground(model, origin_alt_amsl_m, pose.pos_ned_m[:2], placement.radius_m)
    except ValueError as error:
        return NoMatch(str(error))
    matcher = placement.matcher
    size_m = footprint_size_m(camera, pose, ground, matcher.max_obliquity_rad)
    if size_m is None:
        return NoMatch("the camera does not see the ground below the horizon limit")
    coarse = CoarseMap(reference, size_m / config.max_px)
    reach_rad = min(config.reach_rad, config.max_sigmas * float(np.sqrt(cov_pose[5, 5])))
    if config.by is Alignment.SWEEP:
        count = math.ceil(reach_rad / config.sweep_step_rad)
        tried = config.sweep_step_rad * np.arange(-count, count + 1, dtype=np.float64)
    else:
        turns = line_turns(image, camera, coarse, ground, pose, reach_rad, config.most, matcher.max_obliquity_rad)
        if config.by is Alignment.LINES:
            return float(turns[0]) if len(turns) else 0.0
        around = config.step_rad * np.array([-1.0, 0.0, 1.0])
        tried = np.unique(np.concatenate(([0.0], turns))[:, None] + around)
    registrar = Registrar(camera, coarse, model, origin_alt_amsl_m, matcher)
    match = registrar.register(image, pose, search_radius_m(pose, ground, cov_pose, placement), tried, np.zeros(1))
    if isinstance(match, NoMatch):
        return match
    return max(match.by_heading, key=lambda one: float(np.nanmax(one[1])))[0]


def line_turns(
    image: Image, camera: Camera, reference: ReferenceMap, ground: Ground, pose: CameraPose, reach_rad: float,
    most: int, max_obliquity_rad: float, max_px: int = 1024,
) -> Float:  # fmt: skip
    """Corrections (n,) of the heading within reach that turn the picture's lines onto the map's, best first.

    Algorithm 1, steps 1 to 5: the picture north up as the pose has it, the map cut to its size about the same place.
    None where there is too little of either, which is for the match itself to say.
    """
    ortho = rectify(image, camera, pose, ground, reference.gsd_m, max_px, max_obliquity_rad)
    if ortho is None:
        return np.zeros(0)
    rows, cols = ortho.mask.shape
    middle = ortho.points_ned_m[rows // 2, cols // 2, :2]
    half = 0.5 * np.array([rows, cols]) * ortho.gsd_m
    area = map_area(reference, middle, half, ortho.gsd_m)
    if area is None:
        return np.zeros(0)
    return headings_by_lines(ortho.image, ortho.mask, area.image, area.valid, reach_rad, most)


def turned(pose: CameraPose, turn_rad: float) -> CameraPose:
    """A pose with its heading corrected: turned about the vertical through the camera."""
    about_down = matrix_from_euler(0.0, 0.0, turn_rad)
    return CameraPose(pose.pos_ned_m, np.asarray(about_down @ pose.ned_from_camera, dtype=np.float64))


def _heading_known(cov: Float, std_rad: float) -> Float:
    """A covariance (6, 6) of a pose with the heading's standard deviation cut down to this; correlations stay."""
    shrink = np.ones(6)
    shrink[5] = min(1.0, std_rad / max(float(np.sqrt(cov[5, 5])), 1e-9))
    return cov * np.outer(shrink, shrink)
