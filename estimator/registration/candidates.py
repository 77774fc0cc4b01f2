"""Candidate poses of one picture by correlation over headings and heights, the whole prior area at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.ports import ReferenceMap
from estimator.registration.alignment import CameraPose
from estimator.registration.channels import double_angle_gradients
from estimator.registration.correlation import SearchArea
from estimator.registration.ortho import Ground, Ortho, footprint_ne_m, map_area, rectify
from estimator.registration.pose_prior import PosePrior
from estimator.robust import robust_std
from estimator.types import Float, Image


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A pose worth looking at: who proposes it and how strongly, on the proposer's own scale.

    ``information`` (6, 6) is of the pose's error (position NED, rotation about NED axes) where the proposer knows.
    """

    pose: CameraPose
    source: str
    strength: float
    information: Float | None = None


@dataclass(frozen=True, slots=True)
class SweepConfig:
    """Resolution and hypotheses of the sweep.

    The picture is reduced to about ``template_px``; the area is cut into cells of ``cell_share`` of the footprint, each
    with its own terrain, where the relief is more than ``level_share`` of the height.
    """

    template_px: int = 80
    heading_step_rad: float = 0.09
    height_step: float = 0.1
    most_heights: int = 2
    cell_share: float = 0.7
    level_share: float = 0.12
    keep: int = 16
    apart_m: float = 8.0
    max_obliquity_rad: float = 1.2


def sweep(
    image: Image, camera: Camera, reference: ReferenceMap, ground: Ground, prior: PosePrior, config: SweepConfig
) -> list[Candidate]:
    """The best places over heading and height hypotheses, far enough apart, the strongest first."""
    size_m = _footprint_m(camera, ground, prior, config)
    if size_m is None:
        return []
    gsd_m = max(reference.gsd_m, size_m / config.template_px)
    side = 2 * int(np.ceil(0.5 * size_m / gsd_m)) + 1
    found: list[tuple[float, CameraPose]] = []
    for centre_ne_m, half_m in _cells(prior, ground, size_m, config):
        area: SearchArea | None = None
        corner = middle = np.zeros(2)
        for pose in _hypotheses(prior, ground, centre_ne_m, config):
            ortho = rectify(image, camera, pose, ground, gsd_m, side, config.max_obliquity_rad, (side, side))
            if ortho is None:
                continue
            here = ortho.points_ned_m[side // 2, side // 2, :2]
            slack_m = max(2.0 * gsd_m, 0.1 * half_m)
            if area is None or np.abs(here - middle).max() > slack_m:
                middle = here
                reach = np.full(2, half_m + slack_m + (0.5 * side + 1.0) * gsd_m)
                around = map_area(reference, middle, reach, gsd_m)
                if around is None or around.valid.mean() < 0.1 or min(around.image.shape) < side:
                    area = None
                    continue
                area = SearchArea(double_angle_gradients(around.image), around.valid, (side, side))
                corner = around.corner_ne_m
            surface = area.correlate(double_angle_gradients(ortho.image), ortho.mask)
            found += _peaks(surface, ortho, corner, pose, prior, config)
    return [Candidate(pose, "correlation", strength) for strength, pose in _apart(found, config)]


def _cells(prior: PosePrior, ground: Ground, size_m: float, config: SweepConfig) -> Iterator[tuple[Float, float]]:
    """Centres (2,) of square cells that cover the prior's circle, and half their side."""
    agl_m = max(ground.down_at_m(prior.pos_ne_m) - prior.down_m, 1.0)
    half_m = prior.radius_m
    if ground.relief_m > config.level_share * agl_m:
        half_m = min(half_m, 0.5 * config.cell_share * size_m)
    count = int(np.ceil(prior.radius_m / half_m - 1e-9))
    at = half_m * (2.0 * np.arange(count) - (count - 1))
    for north in at:
        for east in at:
            if np.hypot(north, east) <= prior.radius_m + 1.42 * half_m:
                yield prior.pos_ne_m + np.array([north, east]), half_m


def _hypotheses(prior: PosePrior, ground: Ground, at_ne_m: Float, config: SweepConfig) -> Iterator[CameraPose]:
    """Poses at one place over headings, and over heights where they are open."""
    if prior.has_heading:
        count = int(np.clip(np.ceil(1.5 * prior.heading_std_rad / config.heading_step_rad), 0, 12))
        turns = config.heading_step_rad * np.arange(-count, count + 1)
    else:
        count = int(np.ceil(2.0 * np.pi / config.heading_step_rad))
        turns = 2.0 * np.pi * np.arange(count) / count
    ground_down = ground.down_at_m(at_ne_m)
    agl_m = max(ground_down - prior.down_m, 1.0)
    steps = int(np.clip(np.round(1.3 * prior.down_std_m / agl_m / config.height_step), 0, config.most_heights))
    for turn in turns:
        rotation = prior.ned_from_camera(float(turn))
        for factor in 1.0 + config.height_step * np.arange(-steps, steps + 1):
            yield CameraPose(np.array([*at_ne_m, ground_down - factor * agl_m]), rotation)


def _footprint_m(camera: Camera, ground: Ground, prior: PosePrior, config: SweepConfig) -> float | None:
    """Side of the square that holds the picture's footprint at any heading of the prior."""
    seen = footprint_ne_m(camera, prior.pose(), ground, config.max_obliquity_rad)
    if seen is None:
        return None
    if prior.has_heading:
        return float(np.ptp(seen, axis=0).max())
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    return float(1.8 * np.linalg.norm(seen - middle, axis=1).max())


def clutter(surface: NDArray[np.floating], known: NDArray[np.bool_]) -> tuple[float, float]:
    """Middle and robust standard deviation of a surface where it is known."""
    values = surface[known]
    return float(np.median(values)), max(robust_std(values), 1e-4)


def camera_places(
    ortho: Ortho, corner_ne_m: Float, pose: CameraPose, shape: tuple[int, ...]
) -> tuple[Float, Float]:  # fmt: skip
    """North (rows, 1) and east (1, cols) of the camera at each entry of the surface of an ortho over an area."""
    shift = corner_ne_m - ortho.corner_ne_m + pose.pos_ned_m[:2]
    north: Float = shift[0] - ortho.gsd_m * np.arange(shape[0])[:, None]
    east: Float = shift[1] + ortho.gsd_m * np.arange(shape[1])[None, :]
    return north, east


def _peaks(
    surface: NDArray[np.float32], ortho: Ortho, corner_ne_m: Float, pose: CameraPose, prior: PosePrior,
    config: SweepConfig,
) -> list[tuple[float, CameraPose]]:  # fmt: skip
    """The surface's best places; strength is the similarity times the root of the compared pixels.

    The clutter's deviation goes with the pixels' number, so hypotheses and cells with more or less picture compare.
    """
    north, east = camera_places(ortho, corner_ne_m, pose, surface.shape)
    log_prior = prior.log_density(np.stack(np.broadcast_arrays(north, east), axis=-1))
    known = np.isfinite(surface) & np.isfinite(log_prior)
    if known.sum() < 9:
        return []
    strength = np.where(known, surface, -np.inf) * np.sqrt(float(ortho.mask.sum()))
    out = []
    reach = max(1, round(config.apart_m / ortho.gsd_m))
    for _ in range(3):
        row, col = np.unravel_index(int(np.argmax(strength)), strength.shape)
        if not np.isfinite(strength[row, col]):
            break
        at = np.array([north[row, 0], east[0, col], pose.pos_ned_m[2]])
        out.append((float(strength[row, col]), CameraPose(at, pose.ned_from_camera)))
        strength[max(0, row - reach) : row + reach + 1, max(0, col - reach) : col + reach + 1] = -np.inf
    return out


def _apart(found: list[tuple[float, CameraPose]], config: SweepConfig) -> list[tuple[float, CameraPose]]:
    kept: list[tuple[float, CameraPose]] = []
    for strength, pose in sorted(found, key=lambda one: -one[0]):
        if all(np.hypot(*(k.pos_ned_m - pose.pos_ned_m)[:2]) >= config.apart_m for _, k in kept):
            kept.append((strength, pose))
        if len(kept) >= config.keep:
            break
    return kept
