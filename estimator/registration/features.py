"""Candidate poses by local features: SIFT, ORB and AKAZE of the rectified picture against those of the map.

A pair of keypoints gives not only two places but two directions and sizes, so one pair alone is a hypothesis of the
picture's place, heading and height on the map. Each pair's hypothesis is tried against all others, within what the
prior allows, which finds the few right pairs among hundreds of wrong ones where a random choice of four would not
(one-point RANSAC; Civera et al., 1-point RANSAC for EKF filtering, Journal of Field Robotics 27(5), 2010). The best
hypotheses become camera poses by least squares over the pairs that agree, with the terrain under them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.ports import ReferenceMap
from estimator.registration.alignment import CameraPose
from estimator.registration.candidates import Candidate
from estimator.registration.ortho import Ground, MapArea, Ortho, map_area, rectify
from estimator.registration.pose_prior import PosePrior
from estimator.types import Float, Image

KINDS = ("sift", "orb", "akaze")


@dataclass(frozen=True, slots=True)
class FeatureConfig:
    """Detectors and the geometric check. ``ratio`` is Lowe's, loose because the check is strict."""

    kinds: tuple[str, ...] = ("sift", "orb")
    most_in_picture: int = 1500
    most_in_map: int = 12000
    most_map_pixels: int = 6_000_000
    max_px: int = 640
    ratio: float = 0.92
    tolerance_px: float = 3.0
    tolerance_share: float = 0.05
    min_inliers: int = 6
    keep: int = 3
    iterations: int = 12
    max_obliquity_rad: float = 1.2


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Matched keypoints: ``seen_ne_m`` (n, 2) on the ground where the prior's camera sees them, ``map_ne_m`` (n, 2) on
    the map, ``turn_rad`` (n,) and ``ratio`` (n,) from the first to the second, ``uv_px`` (n, 2) in the picture."""

    seen_ne_m: Float
    map_ne_m: Float
    turn_rad: Float
    ratio: Float
    uv_px: Float


def propose(
    image: Image, camera: Camera, reference: ReferenceMap, ground: Ground, prior: PosePrior, config: FeatureConfig
) -> list[Candidate]:
    """Camera poses that many pairs of keypoints agree on, the best first; strength is the number of pairs."""
    pose = prior.pose()
    gsd_m = reference.gsd_m
    ortho = rectify(image, camera, pose, ground, gsd_m, config.max_px, config.max_obliquity_rad)
    if ortho is None:
        return []
    middle = ortho.points_ned_m[ortho.image.shape[0] // 2, ortho.image.shape[1] // 2, :2]
    half_m = prior.radius_m + 0.5 * gsd_m * np.array(ortho.image.shape)
    coarse_m = max(gsd_m, float(np.sqrt(4.0 * half_m[0] * half_m[1] / config.most_map_pixels)))
    area = map_area(reference, middle, half_m, coarse_m)
    if area is None:
        return []
    found: list[Candidate] = []
    for kind in config.kinds:
        pairs = _pairs(kind, ortho, area, camera, pose, config)
        if pairs is not None:
            found += _agreeing(kind, pairs, camera, ground, prior, pose, gsd_m, config)
    return sorted(found, key=lambda one: -one.strength)


def _detector(kind: str, most: int) -> cv2.Feature2D:
    match kind:
        case "sift":
            return cv2.SIFT.create(most, contrastThreshold=0.02)
        case "orb":
            return cv2.ORB.create(most, scaleFactor=1.2, nlevels=6, fastThreshold=7)
        case "akaze":
            return cv2.AKAZE.create(threshold=3e-4)
    message = f"unknown features {kind!r}; known: {', '.join(KINDS)}"
    raise ValueError(message)


def _pairs(
    kind: str, ortho: Ortho, area: MapArea, camera: Camera, pose: CameraPose, config: FeatureConfig
) -> Pairs | None:
    equalise = cv2.createCLAHE(3.0, (8, 8))
    in_picture = _detector(kind, config.most_in_picture).detectAndCompute(
        equalise.apply(ortho.image), ortho.mask.astype(np.uint8)
    )
    in_map = _detector(kind, config.most_in_map).detectAndCompute(
        equalise.apply(area.image), area.valid.astype(np.uint8)
    )
    if in_picture[1] is None or in_map[1] is None or len(in_map[1]) < 3:
        return None
    norm = cv2.NORM_L2 if kind == "sift" else cv2.NORM_HAMMING
    matches = [m for m in cv2.BFMatcher(norm).knnMatch(in_picture[1], in_map[1], k=2) if len(m) == 2]
    good = [a for a, b in matches if a.distance < config.ratio * b.distance]
    if len(good) < config.min_inliers:
        return None
    ours, theirs = [in_picture[0][m.queryIdx] for m in good], [in_map[0][m.trainIdx] for m in good]
    at, there = np.array([k.pt for k in ours]), np.array([k.pt for k in theirs])
    seen = ortho.corner_ne_m + ortho.gsd_m * np.stack((-at[:, 1], at[:, 0]), axis=-1)
    on_map = area.corner_ne_m + area.gsd_m * np.stack((-there[:, 1], there[:, 0]), axis=-1)
    turn = np.radians([b.angle - a.angle for a, b in zip(ours, theirs, strict=True)])
    ratio = np.array([b.size * area.gsd_m / (a.size * ortho.gsd_m) for a, b in zip(ours, theirs, strict=True)])
    rows, cols = at[:, 1].round().astype(int), at[:, 0].round().astype(int)
    points = np.concatenate((seen, ortho.points_ned_m[rows, cols, 2:]), axis=-1)
    uv = camera.project((points - pose.pos_ned_m) @ pose.ned_from_camera)
    kept = np.isfinite(uv).all(axis=1)
    return Pairs(seen[kept], on_map[kept], turn[kept], ratio[kept], uv[kept])


def _agreeing(
    kind: str, pairs: Pairs, camera: Camera, ground: Ground, prior: PosePrior, pose: CameraPose, gsd_m: float,
    config: FeatureConfig,
) -> list[Candidate]:  # fmt: skip
    agl_m = max(ground.down_at_m(prior.pos_ne_m) - prior.down_m, 1.0)
    slack = 1.0 + 3.0 * prior.down_std_m / agl_m
    cos, sin = np.cos(pairs.turn_rad), np.sin(pairs.turn_rad)
    # picture angles run clockwise from east, so do turns from north to east
    turned = np.stack((np.stack((cos, -sin), -1), np.stack((sin, cos), -1)), -2) * pairs.ratio[:, None, None]
    offset = pairs.map_ne_m - np.einsum("kij,kj->ki", turned, pairs.seen_ne_m)
    camera_ne = offset + np.einsum("kij,j->ki", turned, pose.pos_ned_m[:2])
    allowed = (pairs.ratio < 1.15 * slack) & (pairs.ratio > 1.0 / (1.15 * slack))
    allowed &= np.linalg.norm(camera_ne - prior.pos_ne_m, axis=1) < prior.radius_m + 0.2 * agl_m
    if prior.has_heading:
        allowed &= np.abs(np.angle(np.exp(1j * pairs.turn_rad))) < 3.0 * prior.heading_std_rad + 0.2
    index = np.flatnonzero(allowed)
    if not index.size:
        return []
    moved = np.einsum("kij,nj->kni", turned[index], pairs.seen_ne_m) + offset[index, None, :]
    miss = np.linalg.norm(moved - pairs.map_ne_m, axis=-1)
    reach = np.linalg.norm(pairs.map_ne_m[None] - pairs.map_ne_m[index, None], axis=-1)
    agree = miss < config.tolerance_px * gsd_m + config.tolerance_share * reach
    votes = _distinct(agree, pairs.map_ne_m, gsd_m)
    out: list[Candidate] = []
    taken: list[Float] = []
    for k in np.argsort(-votes)[:40]:
        place = camera_ne[index[k]]
        if votes[k] < config.min_inliers - 2 or len(out) >= config.keep:
            break
        if any(np.hypot(*(place - other)) < 15.0 for other in taken):
            continue
        taken.append(place)
        rotated = prior.ned_from_camera(float(pairs.turn_rad[index[k]]))
        ground_down = ground.down_at_m(place)
        start = CameraPose(np.array([*place, ground_down - agl_m * pairs.ratio[index[k]]]), rotated)
        fitted = fit_pose(pairs, agree[k], camera, ground, start, prior, gsd_m, config)
        if fitted is not None:
            out.append(Candidate(fitted[0], kind, float(fitted[1]), fitted[2]))
    return out


def _distinct(agree: NDArray[np.bool_], map_ne_m: Float, gsd_m: float) -> NDArray[np.intp]:
    """How many different places of the map agree (k,): several keypoints on one corner count once."""
    cell = np.floor(map_ne_m / (4.0 * gsd_m)).astype(np.int64)
    _, place = np.unique(cell, axis=0, return_inverse=True)
    place = np.asarray(place).reshape(-1)
    counts = np.zeros((len(agree), place.max() + 1), dtype=bool)
    for row, ok in zip(counts, agree, strict=True):
        row[place[ok]] = True
    return np.asarray(counts.sum(axis=1))


def fit_pose(
    pairs: Pairs, agree: NDArray[np.bool_], camera: Camera, ground: Ground, start: CameraPose, prior: PosePrior,
    gsd_m: float, config: FeatureConfig,
) -> tuple[CameraPose, int, Float] | None:  # fmt: skip
    """The camera pose from pairs (n,) marked as agreeing, how many do in the end, and its information (6, 6).

    None where too few do.

    Iterated least squares on the pixels with Cauchy weights whose width shrinks, the height and the tilt held by the
    prior.
    """
    points = np.concatenate((pairs.map_ne_m, ground.down_m(*pairs.map_ne_m.T)[:, None]), axis=-1)
    # pixels of the picture that a pixel of the map spans
    distance_m = float(np.median(np.linalg.norm(points - start.pos_ned_m, axis=1)[agree]))
    px = gsd_m * camera.fx_px / max(distance_m, 1.0)
    position, rotation, x_prior = start.pos_ned_m.copy(), start.ned_from_camera, np.zeros(6)
    information = np.diag(1.0 / np.diag(prior.covariance())) * (np.arange(6) >= 2) * (np.arange(6) < 5)
    use, H, noise = agree.copy(), information, 1.5 * px
    for step in range(config.iterations):
        width = px * max(1.5, 12.0 * 0.6**step)
        in_camera = (points - position) @ rotation
        residual = pairs.uv_px - camera.project(in_camera)
        good = use & np.isfinite(residual).all(axis=1)
        if good.sum() < config.min_inliers - 2:
            return None
        J = _pixel_jacobian(in_camera[good], rotation, points[good] - position, camera)
        r = residual[good]
        miss = np.linalg.norm(r, axis=1)
        if step >= config.iterations - 4:
            # by now the residuals tell the noise; a constant would leave the tilt to the prior
            noise = float(np.clip(np.median(miss), 0.25 * px, noise))
        weight = 1.0 / (1.0 + (miss / width) ** 2) / noise**2
        H = np.einsum("nij,n,nik->jk", J, weight, J) + information
        dx = np.linalg.solve(H + np.eye(6) * 1e-9, np.einsum("nij,n,ni->j", J, weight, r) - information @ x_prior)
        position = position + dx[:3]
        rotation = matrix_from_q(q_from_rotvec(dx[3:])) @ rotation
        x_prior = x_prior + dx
        if step >= 4:
            left = pairs.uv_px - camera.project((points - position) @ rotation)
            use = np.linalg.norm(np.nan_to_num(left, nan=1e6), axis=1) < 3.0 * max(width, 1.5 * px)
    left = pairs.uv_px - camera.project((points - position) @ rotation)
    inlier = np.linalg.norm(np.nan_to_num(left, nan=1e6), axis=1) < config.tolerance_px * px
    count = int(_distinct(inlier[None], pairs.map_ne_m, gsd_m)[0])
    return (CameraPose(position, rotation), count, H - information) if count >= config.min_inliers else None


def _pixel_jacobian(in_camera: Float, rotation: Float, offset_ned: Float, camera: Camera) -> Float:
    """Derivatives (n, 2, 6) of the ideal pixel of points by the camera's position and a small turn about NED axes."""
    x, y, z = in_camera.T
    zero = np.zeros_like(x)
    by_point = np.stack(
        (
            np.stack((camera.fx_px / z, zero, -camera.fx_px * x / z**2), axis=-1),
            np.stack((zero, camera.fy_px / z, -camera.fy_px * y / z**2), axis=-1),
        ),
        axis=-2,
    )
    to_camera = by_point @ rotation.T
    # R_true = Exp(d) R: the point in camera axes turns by R^T (offset x d)
    cross = np.zeros((len(x), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2] = -offset_ned[:, 2], offset_ned[:, 1]
    cross[:, 1, 0], cross[:, 1, 2] = offset_ned[:, 2], -offset_ned[:, 0]
    cross[:, 2, 0], cross[:, 2, 1] = -offset_ned[:, 1], offset_ned[:, 0]
    return np.asarray(np.concatenate((-to_camera, to_camera @ cross), axis=-1), dtype=np.float64)
