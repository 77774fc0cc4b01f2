"""The same trial for every candidate pose: polish it, then see how it stands against the rest of the area.

Polishing climbs the similarity itself, with the prior's pull on height and tilt: the picture is rectified with a pose
that is a little turned, tilted or raised about the point it looks at, and correlated near by. That is slower than
fitting windows (``refine``) but holds where single windows show nothing, as between seasons and sensors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_q, q_from_matrix, q_from_rotvec, rotvec_from_q
from estimator.ports import ReferenceMap
from estimator.registration.alignment import CameraPose, MatcherConfig, NoMatch, Registrar
from estimator.registration.candidates import Candidate, camera_places, clutter
from estimator.registration.channels import Channels, double_angle_gradients
from estimator.registration.correlation import SearchArea
from estimator.registration.mind import self_similarity
from estimator.registration.ortho import CoarseMap, Ground, Ortho, footprint_ne_m, map_area, rectify
from estimator.registration.pose_prior import PosePrior
from estimator.registration.refine import Refinement
from estimator.registration.verify import vertex
from estimator.types import Float, Image

MIN_PIXELS = 800
MIN_PLACES = 50
CLUTTER, USUAL_RIVAL = 2.2, 4.0
"""Similarity's usual deviation times the root of the pixels, and how many of it the best wrong place reaches."""


@dataclass(frozen=True, slots=True)
class ConfirmConfig:
    """``level_px`` across the footprint is the resolution, ``second_level_px`` that of the second opinion; steps of the
    polish are halved ``rounds`` times.

    ``gain`` turns squared deviations of clutter into log likelihood. A candidate with ``sure_strength`` pairs of
    keypoints is not polished; where ``min_agreement`` of the windows agree, they have the last word.
    """

    level_px: int = 160
    second_level_px: int = 80
    rounds: int = 4
    radius_px: int = 5
    turn_step_rad: float = 0.05
    tilt_step_rad: float = 0.05
    height_step: float = 0.05
    gain: float = 0.15
    sure_strength: int = 12
    min_agreement: float = 0.4
    window_steps: int = 4
    apart_m: float = 10.0
    max_obliquity_rad: float = 1.2
    matcher: MatcherConfig = field(default_factory=lambda: MatcherConfig(max_template_px=512))


@dataclass(frozen=True, slots=True)
class Evidence:
    """What speaks for a pose.

    ``similarity`` is the correlation at the pose; ``height`` that over the area's clutter in deviations, ``rival`` the
    same of the best place elsewhere. ``agreement`` is the share of windows that find their own best place where
    the whole does. ``second_height`` and ``second_rival`` are as ``height`` and ``rival`` by self-similarity, which the
    polish did not climb. ``strain`` is the distance of height and tilt from the prior in its standard deviations.
    ``pairs`` of keypoints agree, and ``pixels`` of the picture took part.
    """

    similarity: float
    height: float
    rival: float
    agreement: float
    second_height: float
    second_rival: float
    strain: float
    pairs: int
    pixels: int


@dataclass(frozen=True, slots=True, eq=False)
class Confirmed:
    """A polished pose and what speaks for it.

    ``information`` (6, 6) of its error is that of the keypoints, where ``from_pairs``, else as the windows have it.
    ``gsd_m`` is the resolution of the trial.
    """

    pose: CameraPose
    information: Float
    from_pairs: bool
    gsd_m: float
    evidence: Evidence
    source: str


class Trial:
    """Tries candidates of one picture."""

    def __init__(
        self, image: Image, camera: Camera, reference: ReferenceMap, ground: Ground, prior: PosePrior,
        config: ConfirmConfig | None = None,
    ) -> None:  # fmt: skip
        self.config = config or ConfirmConfig()
        self._image, self._camera, self._reference, self._ground, self._prior = image, camera, reference, ground, prior

    def confirm(self, candidate: Candidate) -> Confirmed | None:
        """Polish a candidate and weigh it; None where it leaves the map or the prior."""
        size_m = footprint_size_m(self._camera, candidate.pose, self._ground, self.config.max_obliquity_rad)
        if size_m is None:
            return None
        gsd_m = max(self._reference.gsd_m, size_m / self.config.level_px)
        pose = candidate.pose
        pairs = int(candidate.strength) if candidate.source != "correlation" else 0
        from_pairs = candidate.information is not None and pairs >= self.config.sure_strength
        if not from_pairs:
            polished = self._polish(pose, gsd_m)
            if polished is None:
                return None
            pose = polished
        if not np.isfinite(self._prior.log_density(pose.pos_ned_m[:2])):
            return None
        refined = self._windows(pose, gsd_m)
        agreement = 0.0 if refined is None else refined.agreement
        if refined is not None and not from_pairs and agreement >= self.config.min_agreement:
            pose, refined = self._by_windows(pose, refined, gsd_m)
        evidence = self._evidence(pose, gsd_m, agreement, pairs)
        if evidence is None:
            return None
        information = np.zeros((6, 6)) if refined is None else refined.information
        if from_pairs and candidate.information is not None:
            information = candidate.information
        return Confirmed(pose, information, from_pairs, gsd_m, evidence, candidate.source)

    def strain(self, pose: CameraPose) -> float:
        """Distance of a pose's height and tilt from the prior, in its standard deviations."""
        prior = self._prior
        agl = max(self._ground.down_at_m(prior.pos_ne_m) - prior.down_m, 1.0)
        down_error = (pose.pos_ned_m[2] - prior.down_m) / np.hypot(prior.down_std_m, 0.01 * agl)
        tilt, turn = _tilt_and_turn_rad(pose, prior)
        squares = down_error**2 + float(np.sum((tilt / prior.tilt_std_rad) ** 2))
        if prior.has_heading:
            squares += (turn / prior.heading_std_rad) ** 2
        return float(np.sqrt(squares))

    def _polish(self, pose: CameraPose, gsd_m: float) -> CameraPose | None:
        config = self.config
        around = self._near_area(pose, gsd_m)
        if around is None:
            return None
        start = self._score(pose, around, gsd_m)
        if start is None:
            return None
        best, score = start
        height_m = self._ground.down_at_m(pose.pos_ned_m[:2]) - pose.pos_ned_m[2]
        steps = np.array([config.tilt_step_rad, config.tilt_step_rad, config.turn_step_rad, config.height_step])
        for _ in range(config.rounds):
            for axis in range(4):
                for sign in (1.0, -1.0):
                    change = np.zeros(4)
                    change[axis] = sign * steps[axis]
                    tried = self._score(self._about_aim(best, change, height_m), around, gsd_m)
                    if tried is not None and tried[1] > score:
                        best, score = tried
                        break
            steps = 0.5 * steps
        return best

    def _about_aim(self, pose: CameraPose, change: Float, height_m: float) -> CameraPose:
        """Tilt about the picture's right and down, turn and raise (share of the height), the aim kept in place."""
        rotation = pose.ned_from_camera
        tilt = matrix_from_q(q_from_rotvec(np.array([change[0], change[1], 0.0])))
        turn = matrix_from_q(q_from_rotvec(np.array([0.0, 0.0, change[2]])))
        turned = turn @ rotation @ tilt
        raised_m = height_m * (1.0 + change[3])
        before, after = rotation[:, 2], turned[:, 2]
        if after[2] < 0.2 or before[2] < 0.2:
            return pose
        aim = pose.pos_ned_m[:2] + before[:2] / before[2] * height_m
        ne = aim - after[:2] / after[2] * raised_m
        return CameraPose(np.array([*ne, pose.pos_ned_m[2] - height_m * change[3]]), turned)

    def _near_area(self, pose: CameraPose, gsd_m: float) -> _Near | None:
        config = self.config
        ortho = rectify(self._image, self._camera, pose, self._ground, gsd_m, 2 * config.level_px,
                        config.max_obliquity_rad)  # fmt: skip
        if ortho is None:
            return None
        ortho = on_map_only(ortho, self._reference)
        if ortho.mask.sum() < MIN_PIXELS:
            return None
        shape = ortho.image.shape
        middle = ortho.points_ned_m[shape[0] // 2, shape[1] // 2, :2]
        slack_px = 3 * config.radius_px
        around = map_area(self._reference, middle, (0.5 * np.array(shape) + slack_px) * gsd_m, gsd_m)
        if around is None or min(np.subtract(around.image.shape, shape)) < 4:
            return None
        area = SearchArea(double_angle_gradients(around.image), around.valid, (shape[0], shape[1]))
        deviation = 1.0 / np.sqrt(float(ortho.mask.sum()))
        return _Near(area, around.corner_ne_m, (shape[0], shape[1]), CLUTTER * deviation)

    def _score(self, pose: CameraPose, near: _Near, gsd_m: float) -> tuple[CameraPose, float] | None:
        """The pose moved to the best place near by, and its log posterior up to a constant."""
        config = self.config
        ortho = rectify(self._image, self._camera, pose, self._ground, gsd_m, 2 * config.level_px,
                        config.max_obliquity_rad, near.shape)  # fmt: skip
        if ortho is None:
            return None
        surface = near.area.correlate(double_angle_gradients(ortho.image), ortho.mask)
        north, east = camera_places(ortho, near.corner_ne_m, pose, surface.shape)
        moved_m = np.maximum(np.abs(north - pose.pos_ned_m[0]), np.abs(east - pose.pos_ned_m[1]))
        close = np.where((moved_m <= config.radius_px * gsd_m) & np.isfinite(surface), surface, -1.0)
        row, col = np.unravel_index(int(np.argmax(close)), close.shape)
        value = float(close[row, col])
        if value <= 0.0:
            return None
        ne = np.array([north[row, 0] - gsd_m * _vertex(close, row, col, 0),
                       east[0, col] + gsd_m * _vertex(close, row, col, 1)])  # fmt: skip
        there = CameraPose(np.array([*ne, pose.pos_ned_m[2]]), pose.ned_from_camera)
        return there, config.gain * (value / near.clutter) ** 2 - 0.5 * self.strain(there) ** 2

    def _windows(self, pose: CameraPose, gsd_m: float) -> Refinement | None:
        """What the windows say of a pose."""
        registrar = Registrar(
            self._camera, CoarseMap(self._reference, gsd_m), self._ground, self._ground.origin_alt_amsl_m,
            self.config.matcher,
        )  # fmt: skip
        match = registrar.register(self._image, pose, 8.0 * gsd_m, np.zeros(1), np.zeros(1))
        return None if isinstance(match, NoMatch) else registrar.refine(match, np.zeros(2), self._prior.covariance())

    def _by_windows(self, pose: CameraPose, refined: Refinement, gsd_m: float) -> tuple[CameraPose, Refinement]:
        """The pose that the windows agree on, as long as the whole picture fits better with every step."""
        near = self._near_area(pose, gsd_m)
        before = None if near is None else self._score(pose, near, gsd_m)
        if near is None or before is None:
            return pose, refined
        score = before[1]
        for _ in range(self.config.window_steps):
            there = moved(pose, refined.x)
            after = self._score(there, near, gsd_m)
            again = self._windows(there, gsd_m)
            if after is None or again is None or after[1] < score:
                break
            pose, refined, score = there, again, after[1]
        return pose, refined

    def _evidence(self, pose: CameraPose, gsd_m: float, agreement: float, pairs: int) -> Evidence | None:
        first = self._standing(pose, gsd_m, double_angle_gradients)
        coarse_m = gsd_m * self.config.level_px / self.config.second_level_px
        second = self._standing(pose, max(self._reference.gsd_m, coarse_m), self_similarity)
        if first is None or second is None:
            return None
        return Evidence(
            first.similarity, first.height, first.rival, agreement, second.height, second.rival, self.strain(pose),
            pairs, first.pixels,
        )  # fmt: skip

    def _standing(self, pose: CameraPose, gsd_m: float, channels: Callable[[Image], Channels]) -> _Standing | None:
        """How the picture at a pose stands against the rest of the prior's area."""
        config = self.config
        ortho = rectify(
            self._image, self._camera, pose, self._ground, gsd_m, 2 * config.level_px, config.max_obliquity_rad
        )
        if ortho is None:
            return None
        ortho = on_map_only(ortho, self._reference)
        pixels = int(ortho.mask.sum())
        if pixels < MIN_PIXELS * (config.second_level_px / config.level_px) ** 2:
            return None
        surface, north, east = area_surface(ortho, self._reference, self._prior, pose, channels)
        place = np.stack(np.broadcast_arrays(north, east), axis=-1)
        known = np.isfinite(surface) & np.isfinite(self._prior.log_density(place))
        distance = np.linalg.norm(place - pose.pos_ned_m[:2], axis=-1)
        near, far = np.isfinite(surface) & (distance <= 2.5 * gsd_m), known & (distance > config.apart_m)
        if not near.any():
            return None
        own = float(surface[near].max())
        if far.sum() < MIN_PLACES:
            # hardly another place to compare with: what clutter and its highest peak usually are
            middle, spread = 0.0, CLUTTER / float(np.sqrt(pixels))
            other = USUAL_RIVAL * spread
        else:
            middle, spread = clutter(surface, far)
            other = float(surface[far].max())
        return _Standing(own, (own - middle) / spread, (other - middle) / spread, pixels)


@dataclass(frozen=True, slots=True)
class _Standing:
    similarity: float
    height: float
    rival: float
    pixels: int


@dataclass(frozen=True, slots=True, eq=False)
class _Near:
    area: SearchArea
    corner_ne_m: Float
    shape: tuple[int, int]
    clutter: float


def moved(pose: CameraPose, x: Float) -> CameraPose:
    """A pose corrected by an error (6,): position NED, rotation about the NED axes."""
    rotation = matrix_from_q(q_from_rotvec(np.asarray(x[3:], dtype=np.float64))) @ pose.ned_from_camera
    return CameraPose(pose.pos_ned_m + x[:3], rotation)


def _tilt_and_turn_rad(pose: CameraPose, prior: PosePrior) -> tuple[Float, float]:
    """How a pose is tilted (2,) about north and east from the prior's tilt at its own heading; and its turn from it."""
    m = pose.ned_from_camera @ prior.ned_from_camera().T
    turn = float(np.arctan2(m[1, 0] - m[0, 1], m[0, 0] + m[1, 1]))
    rest = rotvec_from_q(q_from_matrix(pose.ned_from_camera @ prior.ned_from_camera(turn).T))
    return np.asarray(rest[:2], dtype=np.float64), turn


def footprint_size_m(camera: Camera, pose: CameraPose, ground: Ground, max_obliquity_rad: float) -> float | None:
    """The longer side of the footprint's north-up rectangle."""
    seen = footprint_ne_m(camera, pose, ground, max_obliquity_rad)
    return None if seen is None else float(np.ptp(seen, axis=0).max())


def on_map_only(ortho: Ortho, reference: ReferenceMap) -> Ortho:
    """A rectified picture without what lies off the map, which cannot be compared."""
    low, high = ortho.points_ned_m[-1, 0, :2], ortho.points_ned_m[0, -1, :2]
    window = reference.window(float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    if window.valid.all():
        return ortho
    ne = ortho.points_ned_m[..., :2]
    row = np.rint((window.north_max_m - ne[..., 0]) / window.gsd_m).astype(int).clip(0, window.valid.shape[0] - 1)
    col = np.rint((ne[..., 1] - window.east_min_m) / window.gsd_m).astype(int).clip(0, window.valid.shape[1] - 1)
    return replace(ortho, mask=ortho.mask & window.valid[row, col])


def area_surface(
    ortho: Ortho, reference: ReferenceMap, prior: PosePrior, pose: CameraPose, channels: Callable[[Image], Channels]
) -> tuple[Float, Float, Float]:
    """Similarity of a rectified picture all over the prior's area, with the camera's north and east at each entry."""
    rows, cols = ortho.image.shape
    gsd_m = ortho.gsd_m
    centre = ortho.points_ned_m[rows // 2, cols // 2, :2] - pose.pos_ned_m[:2] + prior.pos_ne_m
    around = map_area(reference, centre, prior.radius_m + (0.5 * np.array([rows, cols]) + 2.0) * gsd_m, gsd_m)
    if around is None or around.image.shape[0] < rows or around.image.shape[1] < cols:
        return np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    area = SearchArea(channels(around.image), around.valid, (rows, cols))
    surface = area.correlate(channels(ortho.image), ortho.mask)
    north, east = camera_places(ortho, around.corner_ne_m, pose, surface.shape)
    return np.asarray(surface, dtype=np.float64), north, east


def _vertex(surface: Float, row: int | np.intp, col: int | np.intp, axis: int) -> float:
    """Offset of the parabola's top from an entry along an axis, at most half a pixel."""
    index = row if axis == 0 else col
    if index in (0, surface.shape[axis] - 1):
        return 0.0
    line = surface[index - 1 : index + 2, col] if axis == 0 else surface[row, index - 1 : index + 2]
    return vertex(float(line[0]), float(line[1]), float(line[2]))
