"""Where was this picture taken? One still picture, a map, and a rough idea.

Proposers (keypoints of three kinds, correlation over headings and heights) name candidate poses; every candidate
stands the same trial (``confirm``), and the best answer is given or refused by one outlier probability
(``acceptance``). The likely proposer comes first, the next only while no answer is sure.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.ground import ground_point_by_pose
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.acceptance import AcceptanceWeights, outlier_probability
from estimator.registration.alignment import CameraPose
from estimator.registration.candidates import Candidate, SweepConfig, sweep
from estimator.registration.confirm import ConfirmConfig, Confirmed, Evidence, Trial
from estimator.registration.features import FeatureConfig, propose
from estimator.registration.ortho import Ground
from estimator.registration.pose_prior import PosePrior, heading_of
from estimator.types import Float, Image

PROPOSERS = ("sift", "akaze", "orb", "correlation")


@dataclass(frozen=True, slots=True)
class LocateConfig:
    """``sure_below`` ends the search early. ``gsd_share`` and ``map_std_m`` make up a match's own sigma; ``inflation``
    and ``pair_inflation`` multiply the sigma that windows and keypoints claim, because neighbours err alike.
    ``ground_slope_std`` is of what the ground model leaves of the land's slope, rise over run: a picture fitted to land
    that is level only in the model is tilted by it, and the camera moved aside by as much of its height."""

    sweep: SweepConfig = field(default_factory=SweepConfig)
    features: FeatureConfig = field(default_factory=FeatureConfig)
    confirm: ConfirmConfig = field(default_factory=ConfirmConfig)
    acceptance: AcceptanceWeights = field(default_factory=AcceptanceWeights)
    proposers: tuple[str, ...] = PROPOSERS
    sure_below: float = 0.005
    inflation: float = 3.0
    pair_inflation: float = 1.0
    min_agreement: float = 0.4
    gsd_share: float = 1.0
    map_std_m: float = 0.15
    ground_slope_std: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """An answer. ``cov_ne_m2`` (2, 2) is of the camera's horizontal position if the place is right; ``reason`` says
    why it is not ``accepted``. ``cov_pose`` (6, 6) is of the whole pose, position NED, then rotation about the NED
    axes, and its first block is ``cov_ne_m2``."""

    accepted: bool
    reason: str
    pose: CameraPose
    heading_rad: float
    cov_pose: Float
    outlier_probability: float
    evidence: Evidence
    source: str

    @property
    def cov_ne_m2(self) -> Float:
        """Covariance (2, 2) of the camera's horizontal position."""
        return self.cov_pose[:2, :2]


@dataclass(frozen=True, slots=True)
class NotLocated:
    """Why there is no answer at all."""

    reason: str


def locate(
    image: Image, camera: Camera, reference: ReferenceMap, model: GroundModel, origin_alt_amsl_m: float,
    prior: PosePrior, config: LocateConfig | None = None,
) -> Located | NotLocated:  # fmt: skip
    """Find the camera pose of a grey picture (rows, cols).

    ``model`` gives the ground's height, on the datum of ``origin_alt_amsl_m``, the local frame's origin.
    """
    config = config or LocateConfig()
    if image.shape != (camera.height_px, camera.width_px):
        message = f"picture of {image.shape[::-1]} pixels, camera of {camera.width_px, camera.height_px}"
        raise ValueError(message)
    unknown = sorted(set(config.proposers) - set(PROPOSERS))
    if unknown:
        message = f"unknown proposers {', '.join(unknown)}; known: {', '.join(PROPOSERS)}"
        raise ValueError(message)
    try:
        ground = Ground(model, origin_alt_amsl_m, prior.pos_ne_m, prior.radius_m)
    except ValueError as error:
        return NotLocated(str(error))
    if float(image.std()) < 2.0:
        return NotLocated("the picture shows nothing: it is of one brightness")
    judged = judge(image, camera, reference, ground, prior, config)
    if not judged:
        return NotLocated("nothing on the map resembles the picture, or the map does not reach there")
    probability, best = min(judged, key=lambda one: one[0])
    return _answer(probability, best, judged, ground, prior, config)


def judge(
    image: Image, camera: Camera, reference: ReferenceMap, ground: Ground, prior: PosePrior, config: LocateConfig
) -> list[tuple[float, Confirmed]]:
    """Every candidate that stood its trial, with its outlier probability."""
    trial = Trial(image, camera, reference, ground, prior, config.confirm)
    judged: list[tuple[float, Confirmed]] = []
    for proposer in _order(prior, config):
        for candidate in _propose(proposer, image, camera, reference, ground, prior, config):
            confirmed = trial.confirm(candidate)
            if confirmed is not None:
                judged.append((outlier_probability(confirmed.evidence, config.acceptance), confirmed))
        if judged and min(p for p, _ in judged) < config.sure_below:
            break
    return judged


def _order(prior: PosePrior, config: LocateConfig) -> list[str]:
    """Correlation first where the heading is known, when it is cheap; last where it is not."""
    first = [p for p in config.proposers if p == "correlation"]
    rest = [p for p in config.proposers if p != "correlation"]
    return [*first, *rest] if prior.has_heading else [*rest, *first]


def _propose(
    proposer: str, image: Image, camera: Camera, reference: ReferenceMap, ground: Ground, prior: PosePrior,
    config: LocateConfig,
) -> list[Candidate]:  # fmt: skip
    if proposer == "correlation":
        return sweep(image, camera, reference, ground, prior, config.sweep)
    return propose(image, camera, reference, ground, prior, replace(config.features, kinds=(proposer,)))


def _answer(
    probability: float, best: Confirmed, judged: list[tuple[float, Confirmed]], ground: Ground, prior: PosePrior,
    config: LocateConfig,
) -> Located:  # fmt: skip
    pose = best.pose
    limit = config.acceptance.accept_below
    reason = ""
    if probability >= limit:
        reason = f"not sure enough: the best place is wrong with probability {probability:.2f}"
        others = [c for _, c in judged if np.hypot(*(c.pose.pos_ned_m - pose.pos_ned_m)[:2]) > 25.0]
        if others and max(c.evidence.height for c in others) > 0.9 * best.evidence.height:
            reason = f"ambiguous: places as good lie apart (outlier probability {probability:.2f})"
    return Located(
        not reason, reason, pose, heading_of(pose.ned_from_camera), _covariance(best, ground, prior, config),
        probability, best.evidence, best.source,
    )  # fmt: skip


def _covariance(best: Confirmed, ground: Ground, prior: PosePrior, config: LocateConfig) -> Float:
    """Covariance (6, 6) of the camera's pose: picture, prior of height and tilt, and the map's own error."""
    spread = prior.covariance()
    spread[5, 5] = min(spread[5, 5], prior.heading_std_rad**2)
    information = np.asarray(np.linalg.inv(spread), dtype=np.float64)
    if best.from_pairs:
        information = information + best.information / config.pair_inflation**2
    elif best.evidence.agreement >= config.min_agreement:
        information = information + best.information / config.inflation**2
    axis = best.pose.ned_from_camera[:, 2]
    slope = axis[:2] / max(float(axis[2]), 0.2)
    height_m = max(ground.down_at_m(best.pose.pos_ned_m[:2]) - float(best.pose.pos_ned_m[2]), 1.0)
    J = ground_point_by_pose(slope, np.asarray(height_m))
    own_m = config.gsd_share * best.gsd_m
    information = information + J.T @ J / own_m**2
    cov = np.asarray(np.linalg.inv(information), dtype=np.float64)
    aside_m = config.ground_slope_std * height_m
    cov[:2, :2] += np.eye(2) * (config.map_std_m**2 + aside_m**2)
    return cov
