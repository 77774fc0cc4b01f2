"""Registration of one picture to the reference map: rectify, correlate over hypotheses, judge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.geometry.ground import ground_point_by_pose, intersect_plane
from estimator.ports import Correlation, GroundModel, ReferenceMap
from estimator.registration.calibration import Calibration, calibration_of
from estimator.registration.channels import CHANNELS, Channels
from estimator.registration.correlation import SearchArea
from estimator.registration.likelihood import LikelihoodCalibration, log_matched
from estimator.registration.lines import headings_by_lines
from estimator.registration.mind import self_similarity
from estimator.registration.refine import RefineConfig, Refinement, cut_windows, refine
from estimator.registration.verify import MatchEvidence, Peak, find_peak, outlier_probability
from estimator.types import Float, Image

COMPARED: dict[str, Callable[[Image], Channels]] = {**CHANNELS, "mind": self_similarity}
"""The channel functions a matcher can be configured with."""

OTHER = {name: "double_angle" if name == "intensity" else "intensity" for name in COMPARED}
"""By which channels a match is looked at once more: by the tones where it was found by edges, and the other way."""
OTHER_REACH_PX = 2


class HeadingSource(StrEnum):
    """Which headings are tried: a grid about the prediction, or also those that straight lines suggest."""

    GRID = "grid"
    LINES = "lines"


@dataclass(frozen=True, slots=True)
class MatcherConfig:
    """What to compare and how finely.

    ``max_template_px`` bounds the rectified picture; ``max_obliquity_rad`` leaves out ground seen at a grazing angle.
    With ``heading_from`` lines the grid shrinks to its middle, and headings up to ``line_reach_rad`` off that the lines
    of picture and map suggest are tried as well, each with a neighbour to either side. Without a ``calibration`` the
    matcher has that of its channels which comes with the package.
    """

    channels: str = "double_angle"
    heading_from: HeadingSource = HeadingSource.GRID
    line_reach_rad: float = 0.35
    max_template_px: int = 224
    max_search_px: int = 320
    min_template_px: int = 24
    max_obliquity_rad: float = 1.2
    heading_step_rad: float = 0.026
    scale_step: float = 0.02
    calibration: Calibration | None = None
    refinement: RefineConfig = field(default_factory=RefineConfig)

    def calibrated(self) -> Calibration:
        """The calibration that counts: its own, or the one of its channels that comes with the package."""
        return self.calibration or calibration_of(self.channels)


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Position NED (3,) in metres and rotation (3, 3) of the camera."""

    pos_ned_m: Float
    ned_from_camera: Float


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """A registered picture.

    ``centre_ned_m`` (3,) is the ground point about which heading and scale are taken; ``correlation`` is over the
    displacement (true minus predicted) of that point. ``heading_rad`` and ``scale`` are the corrections of the best
    hypothesis with their standard deviations, infinite where the hypotheses do not tell. ``evidence`` is what the
    outlier probability was made of, ``by_heading`` the surface of each heading, at the predicted height. ``template``
    is what was compared, for ``Registrar.refine``.
    """

    correlation: Correlation
    peak: Peak
    displacement_ne_m: Float
    centre_ned_m: Float
    evidence: MatchEvidence
    heading_rad: float
    heading_std_rad: float
    scale: float
    scale_std: float
    outlier_probability: float
    footprint_m: float
    template: MatchedTemplate
    by_heading: tuple[tuple[float, NDArray[np.float32]], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class MatchedTemplate:
    """The template of a match and where its pixels come from.

    ``points_ned_m`` (rows, cols, 3) is where the predicted camera sees each pixel, ``offsets_ne_m`` (rows, cols, 2) its
    place on the map about the patch's centre before displacement, and the search area reaches ``radius_px`` further.
    """

    channels: Channels
    mask: NDArray[np.bool_]
    points_ned_m: Float
    offsets_ne_m: Float
    centre_ned_m: Float
    camera_pos_ned_m: Float
    search: Channels
    radius_px: int
    gsd_m: float


@dataclass(frozen=True, slots=True)
class NoMatch:
    """Why a picture could not be registered."""

    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class _Patch:
    """Where on the ground to look: grid of offsets about a centre, rows to the south, columns to the east."""

    centre_ned_m: Float
    offsets_ne_m: Float
    gsd_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.offsets_ne_m.shape[0], self.offsets_ne_m.shape[1]


@dataclass(frozen=True, slots=True, eq=False)
class _MapArea:
    """The map on the patch's grid, with a margin to search in, and where it is known."""

    image: Image
    known: NDArray[np.bool_]


class Registrar:
    """Registers pictures of one camera to one reference map."""

    def __init__(
        self, camera: Camera, reference: ReferenceMap, ground: GroundModel, origin_alt_amsl_m: float,
        config: MatcherConfig | None = None,
    ) -> None:  # fmt: skip
        self.config = config or MatcherConfig()
        if self.config.channels not in COMPARED:
            message = f"unknown channels {self.config.channels!r}; known: {', '.join(COMPARED)}"
            raise ValueError(message)
        self.calibration = self.config.calibrated()
        if self.calibration.channel != self.config.channels:
            message = f"the calibration {self.calibration.version!r} is not of the channels {self.config.channels!r}"
            raise ValueError(message)
        self._camera = camera
        self._reference = reference
        self._ground = ground
        self._origin_alt_amsl_m = origin_alt_amsl_m
        self._channels = COMPARED[self.config.channels]

    def register(
        self, image: Image, pose: CameraPose, search_radius_m: float, headings_rad: Float, scales: Float
    ) -> Match | NoMatch:
        """Find a grey picture (rows, cols) on the map around where ``pose`` puts it.

        ``headings_rad`` and ``scales`` are the corrections to try, one after the other about the best of the first;
        both must hold zero (or one value).
        """
        patch = self._patch(pose)
        if isinstance(patch, NoMatch):
            return patch
        half_ne = np.abs(patch.offsets_ne_m[0, 0]) + 0.5 * patch.gsd_m
        radius_px = int(np.clip(np.ceil(search_radius_m / patch.gsd_m), 4, self.config.max_search_px))
        area = self._map_area(patch, half_ne, radius_px)
        if isinstance(area, NoMatch):
            return area
        search = SearchArea(self._channels(area.image), area.known, patch.shape)
        source = _reduced(image, self._camera, pose, patch)
        if self.config.heading_from is HeadingSource.LINES:
            template, mask, _ = self._rectified(source, patch, pose, 0.0, 0.0)
            turns = headings_by_lines(template, mask, area.image, area.known, self.config.line_reach_rad)
            step = self.config.heading_step_rad
            headings_rad = np.unique(np.concatenate(([-step, 0.0, step], *(turns + k * step for k in (-1, 0, 1)))))

        def attempt(heading_rad: float, scale: float) -> _Attempt | None:
            return self._attempt(source, search, patch, pose, heading_rad, scale)

        return self._best(attempt, headings_rad, scales, patch, search, radius_px, half_ne, pose, area)

    def refine(self, match: Match, displacement_ne_m: Float, prior_cov: Float) -> Refinement | None:
        """The camera pose error that the picture tells, near a displacement (2,) of the match's centre.

        ``prior_cov`` (6, 6) is the covariance of the pose error before the picture. None where the windows do not say.
        """
        template, config = match.template, self.config.refinement
        step = template.gsd_m
        row = round(template.radius_px - displacement_ne_m[0] / step)
        col = round(template.radius_px + displacement_ne_m[1] / step)
        windows = cut_windows(template.channels, template.mask, template.search, row, col, config)
        if windows is None:
            return None
        at = np.round(windows.row).astype(int), np.round(windows.col).astype(int)
        to_point = template.points_ned_m[at] - template.camera_pos_ned_m
        J = ground_point_by_pose(to_point[:, :2] / to_point[:, 2:], to_point[:, 2])
        # where the map has a window's pixels less where the predicted camera sees them, at the surface's middle
        seen = template.points_ned_m[at][:, :2] - template.centre_ned_m[:2]
        middle = np.array([(template.radius_px - row) * step, (col - template.radius_px) * step])
        moved = template.offsets_ne_m[at] - seen + middle
        rows_cols = np.array([[-1.0 / step, 0.0], [0.0, 1.0 / step]])
        flat = J.reshape(-1, 6)
        gain = prior_cov @ flat.T @ np.linalg.inv(flat @ prior_cov @ flat.T + np.eye(len(flat)) * (2.0 * step) ** 2)
        start, prior_information = gain @ moved.reshape(-1), np.asarray(np.linalg.inv(prior_cov), dtype=np.float64)
        return refine(windows, rows_cols @ J, moved @ rows_cols.T, start, prior_information, config)

    def _best(
        self, attempt: Callable[[float, float], _Attempt | None], headings_rad: Float, scales: Float, patch: _Patch,
        search: SearchArea, radius_px: int, half_ne: Float, pose: CameraPose,
        area: _MapArea,
    ) -> Match | NoMatch:  # fmt: skip
        tried = [a for a in (attempt(float(h), 0.0) for h in headings_rad) if a is not None]
        if not tried:
            return NoMatch("the picture does not cover enough mapped ground")
        best = max(tried, key=lambda a: a.peak.value)
        c = self.calibration.likelihood
        heading, heading_std = _vertex(tried, best, lambda a: a.heading_rad, c)
        others = [a for a in (attempt(best.heading_rad, float(s)) for s in scales if s != 0.0) if a is not None]
        best_scale = max([best, *others], key=lambda a: a.peak.value)
        scale, scale_std = _vertex([best, *others], best_scale, lambda a: a.scale, c)
        best = best_scale
        step = patch.gsd_m
        correlation = Correlation(best.surface, radius_px * step, -radius_px * step, step, best.pixels)
        displacement = np.array(
            [correlation.north_max_m - best.peak.row * step, correlation.east_min_m + best.peak.col * step]
        )
        template = MatchedTemplate(
            best.template, best.mask, best.points_ned_m, patch.offsets_ne_m, patch.centre_ned_m, pose.pos_ned_m,
            search.channels, radius_px, step,
        )  # fmt: skip
        evidence = MatchEvidence(
            best.peak, _share(best.heading_rad, [a.heading_rad for a in tried]), self._other_similarity(best, area)
        )
        return Match(
            correlation, best.peak, displacement, patch.centre_ned_m, evidence, heading, heading_std, scale, scale_std,
            outlier_probability(evidence, self.calibration.outlier), float(2.0 * np.sqrt(half_ne[0] * half_ne[1])),
            template, tuple((a.heading_rad, a.surface) for a in tried),
        )  # fmt: skip

    def _other_similarity(self, best: _Attempt, area: _MapArea) -> float:
        """How alike the best attempt and the map are within ``OTHER_REACH_PX`` of its peak, by the other channels."""
        measure = COMPARED[OTHER[self.config.channels]]
        rows, cols = best.mask.shape
        window = tuple(
            slice(max(round(at) - OTHER_REACH_PX, 0), min(round(at) + OTHER_REACH_PX, size - own) + own)
            for at, own, size in (
                (best.peak.row, rows, area.known.shape[0]),
                (best.peak.col, cols, area.known.shape[1]),
            )
        )
        around = SearchArea(measure(area.image[window]), area.known[window], best.mask.shape)
        surface = around.correlate(measure(best.image), best.mask)
        return float(np.nanmax(surface)) if np.isfinite(surface).any() else 0.0

    def _patch(self, pose: CameraPose) -> _Patch | NoMatch:
        footprint = self._footprint(pose)
        if footprint is None:
            return NoMatch("the camera does not see the ground below the horizon limit")
        north_min, east_min = footprint.min(axis=0)
        north_max, east_max = footprint.max(axis=0)
        centre_ne = footprint.mean(axis=0)
        gsd_m = self._reference.gsd_m
        extent = max(north_max - north_min, east_max - east_min)
        # coarser by powers of two while the template would be larger than twice the bound; cropped below that
        while extent / gsd_m > 2.0 * self.config.max_template_px:
            gsd_m *= 2.0
        half = 0.5 * gsd_m * self.config.max_template_px
        rows = int(min(half, north_max - centre_ne[0], centre_ne[0] - north_min) / gsd_m)
        cols = int(min(half, east_max - centre_ne[1], centre_ne[1] - east_min) / gsd_m)
        if min(rows, cols) * 2 + 1 < self.config.min_template_px:
            return NoMatch(
                f"the picture covers only {2 * rows + 1} x {2 * cols + 1} map pixels, "
                f"{self.config.min_template_px} are needed"
            )
        north = gsd_m * np.arange(rows, -rows - 1, -1, dtype=np.float64)
        east = gsd_m * np.arange(-cols, cols + 1, dtype=np.float64)
        offsets = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1)
        down = self._down(centre_ne[0:1], centre_ne[1:2], pose)
        return _Patch(np.array([centre_ne[0], centre_ne[1], down[0]]), offsets, gsd_m)

    def _down(self, north_m: Float, east_m: Float, pose: CameraPose) -> Float:
        alt = self._ground.alt_amsl_m(north_m, east_m)
        down: Float = self._origin_alt_amsl_m - alt
        if np.isnan(down).any():
            known = down[~np.isnan(down)]
            below = self._origin_alt_amsl_m - self._ground.alt_amsl_m(pose.pos_ned_m[0:1], pose.pos_ned_m[1:2])
            down = np.where(np.isnan(down), known.mean() if known.size else below, down)
        return down

    def _footprint(self, pose: CameraPose) -> Float | None:
        """Ground points (n, 2) seen by the picture's border and middle, within the obliquity limit; None if too few."""
        camera = self._camera
        u = np.linspace(0.0, camera.width_px - 1.0, 9)
        v = np.linspace(0.0, camera.height_px - 1.0, 7)
        uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        rays = camera.rays(uv) @ pose.ned_from_camera.T
        usable = rays[:, 2] > np.cos(self.config.max_obliquity_rad)
        if usable.sum() < 0.25 * len(rays):
            return None
        down = self._down(pose.pos_ned_m[0:1], pose.pos_ned_m[1:2], pose)[0]
        points = intersect_plane(pose.pos_ned_m, rays[usable], float(down))
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 8:
            return None
        # once more on the plane through the ground that is really looked at
        down = float(np.mean(self._down(points[:, 0], points[:, 1], pose)))
        points = intersect_plane(pose.pos_ned_m, rays[usable], down)
        points = points[np.isfinite(points).all(axis=1)]
        return points[:, :2] if len(points) >= 8 else None

    def _map_area(self, patch: _Patch, half_ne: Float, radius_px: int) -> _MapArea | NoMatch:
        margin = radius_px * patch.gsd_m
        centre = patch.centre_ned_m
        shape = patch.shape
        window = self._reference.window(
            centre[0] - half_ne[0] - margin - patch.gsd_m, centre[1] - half_ne[1] - margin - patch.gsd_m,
            centre[0] + half_ne[0] + margin + patch.gsd_m, centre[1] + half_ne[1] + margin + patch.gsd_m,
        )  # fmt: skip
        if not window.valid.any():
            return NoMatch("outside the reference map")
        rows, cols = shape[0] + 2 * radius_px, shape[1] + 2 * radius_px
        north_first = centre[0] + patch.offsets_ne_m[0, 0, 0] + margin
        east_first = centre[1] + patch.offsets_ne_m[0, 0, 1] - margin
        image, valid = window.image, window.valid.astype(np.uint8)
        ratio = patch.gsd_m / window.gsd_m
        if ratio > 1.5:
            sigma = 0.4 * ratio
            image = _uint8(cv2.GaussianBlur(image, (0, 0), sigma))
        # bring the window onto the template's own grid, so that zero displacement is a whole pixel
        matrix = np.array(
            [
                [ratio, 0.0, (east_first - window.east_min_m) / window.gsd_m],
                [0.0, ratio, (window.north_max_m - north_first) / window.gsd_m],
            ]
        )
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        picture = cv2.warpAffine(image, matrix, (cols, rows), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        covered = cv2.warpAffine(valid, matrix, (cols, rows), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
        known = np.asarray(covered > 0)
        if known.mean() < 0.2:
            return NoMatch("too little of the reference map around the prediction")
        return _MapArea(_uint8(picture), known)

    def _rectified(
        self, source: _Source, patch: _Patch, pose: CameraPose, heading_rad: float, scale: float
    ) -> tuple[Image, NDArray[np.bool_], Float]:
        """The picture on the patch's grid with a corrected heading and height, where it exists, and its points."""
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        # a true map offset o shows where the predicted camera expects Rot(-heading) o / (1 + scale)
        turn = np.array([[cos, sin], [-sin, cos]]) / (1.0 + scale)
        ne = patch.centre_ned_m[:2] + patch.offsets_ne_m @ turn.T
        down = self._down(ne[..., 0].ravel(), ne[..., 1].ravel(), pose).reshape(ne.shape[:2])
        points = np.concatenate((ne, down[..., None]), axis=-1)
        template, mask = source.sample((points - pose.pos_ned_m) @ pose.ned_from_camera)
        return template, mask, points

    def _attempt(
        self, source: _Source, search: SearchArea, patch: _Patch, pose: CameraPose, heading_rad: float,
        scale: float,
    ) -> _Attempt | None:  # fmt: skip
        template, mask, points = self._rectified(source, patch, pose, heading_rad, scale)
        if mask.sum() < self.config.min_template_px**2:
            return None
        channels = self._channels(template)
        surface = search.correlate(channels, mask)
        peak = find_peak(surface)
        if peak is None:
            return None
        return _Attempt(surface, peak, heading_rad, scale, int(mask.sum()), channels, mask, points, template)


@dataclass(frozen=True, slots=True, eq=False)
class _Attempt:
    surface: NDArray[np.float32]
    peak: Peak
    heading_rad: float
    scale: float
    pixels: int
    template: Channels
    mask: NDArray[np.bool_]
    points_ned_m: Float
    image: Image


@dataclass(frozen=True, slots=True, eq=False)
class _Source:
    """A picture reduced to about the map's resolution, and its camera."""

    image: Image
    camera: Camera

    def sample(self, points_camera_m: Float) -> tuple[Image, NDArray[np.bool_]]:
        """The picture at points (rows, cols, 3) of the camera frame, and where it exists."""
        uv = self.camera.project(points_camera_m)
        inside = (
            (uv[..., 0] >= 1.0) & (uv[..., 0] <= self.camera.width_px - 2.0)
            & (uv[..., 1] >= 1.0) & (uv[..., 1] <= self.camera.height_px - 2.0)
        )  # fmt: skip
        uv32 = np.nan_to_num(uv, nan=-10.0).astype(np.float32)
        image = cv2.remap(self.image, uv32[..., 0], uv32[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        # gradients at the rim of the mask see replicated pixels
        eroded = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
        return _uint8(image), np.asarray(eroded)


def _reduced(image: Image, camera: Camera, pose: CameraPose, patch: _Patch) -> _Source:
    """Area-average the picture so that its pixels on the ground are about as large as the map's."""
    distance = float(np.linalg.norm(patch.centre_ned_m - pose.pos_ned_m))
    factor = min(1.0, (distance / camera.fx_px) / patch.gsd_m * 1.15)
    if factor > 0.75:
        return _Source(_uint8(cv2.GaussianBlur(image, (0, 0), 0.6)), camera)
    scaled = camera.scaled(factor)
    size = (scaled.width_px, scaled.height_px)
    return _Source(_uint8(cv2.resize(image, size, interpolation=cv2.INTER_AREA)), scaled)


def _uint8(image: np.ndarray) -> Image:
    # OpenCV's stubs forget the type of a picture that keeps it
    return np.asarray(image, dtype=np.uint8)


def _share(correction: float, tried: list[float]) -> float:
    """A correction as a share of the largest that was tried; 0 where only none was."""
    return abs(correction) / max((abs(c) for c in tried), default=0.0) if any(tried) else 0.0


def _vertex(
    tried: list[_Attempt],
    best: _Attempt,
    parameter: Callable[[_Attempt], float],
    calibration: LikelihoodCalibration,
) -> tuple[float, float]:
    """Best value of a hypothesis parameter and its standard deviation, from a parabola through the log likelihoods."""
    values = sorted(tried, key=parameter)
    index = values.index(best)
    if len(values) < 3:
        return parameter(best), float("inf")
    if index in (0, len(values) - 1):
        # the best lies beyond the hypotheses: a step towards it is known, no more
        return parameter(best), abs(parameter(values[1]) - parameter(values[0]))
    around = values[index - 1 : index + 2]
    x = np.array([parameter(a) for a in around])
    log_p = log_matched(np.array([a.peak.value for a in around]), best.peak, calibration)
    a, b, _ = np.polyfit(x - x[1], log_p, 2)
    if a >= -1e-9:
        return parameter(best), float("inf")
    offset = float(np.clip(-b / (2.0 * a), x[0] - x[1], x[2] - x[1]))
    # the curvature of a few smooth samples is optimistic: the hypotheses' own step bounds it from below
    std = max(float(np.sqrt(-1.0 / (2.0 * a))), 0.15 * float(x[2] - x[1]))
    return float(x[1] + offset), std
