"""Ways to a pose over a pad that are compared, and the Cramér-Rao bound of each.

The bound is that of independent errors with the sigmas below: of ellipse centres, of an edge point each two pixels, and
of tag corners.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from estimator.geometry.camera import Camera
from estimator.landing.detector import detect_circles
from estimator.landing.pad import CirclePad, Pad, TagPad
from estimator.landing.pose import (
    Edges,
    PadPose,
    TiltPrior,
    corners,
    cov_of_edges,
    joined,
    sample_rings,
    seen,
)
from estimator.landing.rings import ring_levels
from estimator.landing.sighting import NoPad
from estimator.landing.tags import detect_tags, find_tags, planar_poses
from estimator.types import Float, Image

CENTRE_STD_PX, EDGE_STD_PX, CORNER_STD_PX = 0.1, 0.3, 0.15


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A pose and the covariance (3, 3) of the camera's position, where the method gives one."""

    pose: PadPose
    cov: Float | None


@dataclass(frozen=True, slots=True)
class Method:
    """How a picture becomes a pose; on which pad; whether it takes the tilt, and what the bound counts."""

    run: Callable[[Image, Camera, Pad, TiltPrior], Answer | None]
    tags: bool
    tilt: bool
    counts: str


def _circles(tilt: bool) -> Callable[[Image, Camera, Pad, TiltPrior], Answer | None]:
    def run(image: Image, camera: Camera, pad: Pad, prior: TiltPrior) -> Answer | None:
        if not isinstance(pad, CirclePad):
            return None
        found = detect_circles(image, camera, pad, prior if tilt else None)
        return None if isinstance(found, NoPad) else Answer(found.best.pose, found.best.cov_pos_pad_m2)

    return run


def _tags(tilt: bool) -> Callable[[Image, Camera, Pad, TiltPrior], Answer | None]:
    def run(image: Image, camera: Camera, pad: Pad, prior: TiltPrior) -> Answer | None:
        if not isinstance(pad, TagPad):
            return None
        found = detect_tags(image, camera, TagPad(pad.name, pad.tags[:1]), prior if tilt else None)
        return None if isinstance(found, NoPad) else Answer(found.best.pose, found.best.cov_pos_pad_m2)

    return run


def _ippe(image: Image, camera: Camera, pad: Pad, prior: TiltPrior) -> Answer | None:
    """The better of IPPE's two poses of the largest tag; the prior is not looked at."""
    assert isinstance(pad, TagPad) and prior is not None  # noqa: S101 - as METHODS says
    for number, quad in find_tags(image):
        if number == pad.tags[0].number:
            poses = planar_poses(camera, pad.tags[0].corners_m, quad)
            return Answer(poses[0], None) if poses else None
    return None


def _centres(image: Image, camera: Camera, pad: Pad, prior: TiltPrior) -> Answer | None:
    """P3P on the centres of the three ellipses, as the thesis has it; of its solutions the one nearest to the tilt."""
    assert isinstance(pad, CirclePad)  # noqa: S101 - as METHODS says
    found = detect_circles(image, camera, pad, prior)
    if isinstance(found, NoPad) or found.triple != 0:
        return None
    points = np.array([(r.x_m, r.y_m, 0.0) for r in pad.rings[:3]])
    there = camera.project(points @ found.best.pose.camera_from_pad.T + found.best.pose.pad_in_camera_m)
    rings = list(ring_levels(image))[-1]
    pixels = []
    for uv in there:
        near = [(float(np.hypot(r.outer.u_px - uv[0], r.outer.v_px - uv[1])), r) for r in rings]
        near = [one for one in near if one[0] < 0.3 * one[1].outer.size_px + 1.0]
        if not near:
            return None
        outer = min(near, key=lambda one: one[0])[1].outer
        pixels.append((outer.u_px, outer.v_px))
    rays = camera.rays(np.array(pixels))
    count, turns, shifts = cv2.solveP3P(
        points, np.ascontiguousarray(rays[:, :2] / rays[:, 2:]), np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_P3P
    )
    poses = [
        PadPose(np.asarray(cv2.Rodrigues(turns[i])[0], np.float64), np.asarray(shifts[i], np.float64).reshape(3))
        for i in range(count)
    ]
    if not poses:
        return None
    return Answer(max(poses, key=lambda one: float(one.camera_from_pad[:, 2] @ prior.down_camera)), None)


METHODS = {
    "three centres, P3P": Method(_centres, False, False, "centres"),
    "circle edges": Method(_circles(False), False, False, "edges"),
    "circle edges, tilt known": Method(_circles(True), False, True, "edges"),
    "AprilTag, IPPE": Method(_ippe, True, False, "corners"),
    "AprilTag, tilt known": Method(_tags(True), True, True, "corners"),
}


def bound_m(
    method: Method, camera: Camera, pad: CirclePad, tags: TagPad, pose: PadPose, tilt_std_rad: float
) -> tuple[float, float]:
    """Least sigma per axis across, and down, that the method's measurements allow."""
    prior = TiltPrior(pose.camera_from_pad[:, 2], tilt_std_rad) if method.tilt else None
    if method.counts == "edges":
        edges, sigma = _ideal_edges(camera, pad, pose), EDGE_STD_PX
    else:
        centres = np.array([(r.x_m, r.y_m, 0.0) for r in pad.rings[:3]])
        points = centres if method.counts == "centres" else tags.tags[0].corners_m
        pixels = camera.project(points @ pose.camera_from_pad.T + pose.pad_in_camera_m)
        edges, sigma = corners(camera, points, pixels), CENTRE_STD_PX if method.counts == "centres" else CORNER_STD_PX
    cov = cov_of_edges(edges, pose, prior, sigma)
    return float(np.sqrt(0.5 * (cov[0, 0] + cov[1, 1]))), float(np.sqrt(cov[2, 2]))


def _ideal_edges(camera: Camera, pad: CirclePad, pose: PadPose) -> Edges:
    per_m = camera.fx_px / float(pose.pad_in_camera_m[2])
    parts = []
    for triple in range(2):
        rings = pad.rings[3 * triple : 3 * triple + 3]
        radius_px = per_m * rings[0].outer_m
        if radius_px >= 3.0:
            parts.append(sample_rings(rings, 3 * triple, max(12, round(np.pi * radius_px))))
    samples = joined(parts)
    curve = seen(camera, pose, samples)
    inside = camera.contains(curve.pixels)
    return Edges.found(samples, curve, np.zeros(len(inside)), inside)
