"""The camera's pose above a pad: from one circle in closed form, from many edges by least squares.

Symbols: camera_from_pad R (3, 3) and the pad's centre in the camera frame t (3,), x_camera = R x_pad + t. Small changes
are a rotation about the camera's axes, R <- Exp(w) R, and a shift of t; covariances are of (w, t) or of the camera's
position in the pad frame, -R^T t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.landing.pad import Ring
from estimator.types import Float

_MAX_STEPS = 12
_SETTLED = 1e-2
"""Of the whitened cost: what it then may still fall by moves nothing by a tenth of its sigma."""
BLUR_PX2, BLUR_STD_PX2 = 0.4, 0.6
"""A round edge of radius r blurred by s^2 lies s^2 / (2 r) within: what s^2 / 2 may be."""
BLEED_STD_PX = 0.15
"""So far may ink, glare or an encoder push all black edges out or in."""
SIGMA_FLOOR_PX = 0.03
_KNOWN = np.array((1.0 / BLUR_STD_PX2**2, 1.0 / BLEED_STD_PX**2))
_MAX_INFLATION = 4.0
_ARC = 8


@dataclass(frozen=True, slots=True, eq=False)
class PadPose:
    """Where the pad is in the camera frame: camera_from_pad (3, 3) and the pad's centre (3,)."""

    camera_from_pad: Float
    pad_in_camera_m: Float

    @property
    def pos_pad_m(self) -> Float:
        """The camera's position (3,) in the pad frame; the third is negative, as z points down."""
        position: Float = -self.camera_from_pad.T @ self.pad_in_camera_m
        return position

    def moved(self, step: Float) -> PadPose:
        """Turned by step[:3] about the camera's axes, then shifted by step[3:6]."""
        turn = np.asarray(cv2.Rodrigues(step[:3])[0], np.float64)
        return PadPose(turn @ self.camera_from_pad, self.pad_in_camera_m + step[3:6])


@dataclass(frozen=True, slots=True, eq=False)
class TiltPrior:
    """What inertial sensors know: down in the camera frame (3,), and the sigma of it and of the pad's own tilt."""

    down_camera: Float
    std_rad: float

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.down_camera))
        if not (abs(length - 1.0) < 1e-3 and self.std_rad > 0.0):
            message = f"down must be a unit vector with a positive sigma, not {self.down_camera} and {self.std_rad} rad"
            raise GeometryError(message)

    def residual(self, pose: PadPose) -> tuple[Float, Float]:
        """Whitened difference (2,) to the pad's own down, and its derivative (2, 6) in (w, t)."""
        x, y, z = (float(part) for part in self.down_camera)
        # two axes across it: its cross product with the axis of the camera that is farther from it, and with that
        first = np.array((0.0, z, -y) if abs(x) < 0.7 else (-z, 0.0, x))
        first /= np.sqrt(first @ first)
        basis = np.stack((first, skew(self.down_camera) @ first)) / self.std_rad
        down = pose.camera_from_pad[:, 2]
        jacobian = np.zeros((2, 6))
        jacobian[:, :3] = -basis @ skew(down)
        return -(basis @ down), jacobian

    def excludes(self, pose: PadPose, cost: float) -> bool:
        """Whether the tilt alone costs a pose many times this much, so that edges could not make up for it."""
        lacking, _ = self.residual(pose)
        return float(lacking @ lacking) > 9.0 * cost


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Points of a pad's circles: position (n, 3) and outward unit vector (n, 3) in the pad frame, radius (n,).

    ``rises`` is 1 where it gets brighter outwards (the outer circle of a ring) and -1 where darker; ``ring`` is the
    number of the ring that a point is of.
    """

    points_m: Float
    outward: Float
    radius_m: Float
    rises: Float
    ring: NDArray[np.int64]

    def of(self, keep: NDArray[np.bool_]) -> Samples:
        """Those that a mask keeps."""
        return Samples(
            self.points_m[keep], self.outward[keep], self.radius_m[keep], self.rises[keep], self.ring[keep]
        )  # fmt: skip


def joined(parts: Sequence[Samples]) -> Samples:
    """Samples one after another."""
    if len(parts) == 1:
        return parts[0]
    return Samples(
        np.concatenate([p.points_m for p in parts]), np.concatenate([p.outward for p in parts]),
        np.concatenate([p.radius_m for p in parts]), np.concatenate([p.rises for p in parts]),
        np.concatenate([p.ring for p in parts]),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Samples as a pose shows them: pixels (n, 2), outward unit normals (n, 2), radius in pixels across the edge (n,).

    ``xy`` (n, 2) are normalised image coordinates, free of the lens's distortion, and ``lens`` (n, 2, 2) is the
    derivative of the pixels in them. NaN for what lies behind the camera.
    """

    pixels: Float
    normals: Float
    radius_px: Float
    xy: Float
    lens: Float

    def of(self, keep: NDArray[np.bool_]) -> Curve:
        """The part that a mask keeps."""
        return Curve(self.pixels[keep], self.normals[keep], self.radius_px[keep], self.xy[keep], self.lens[keep])

    @classmethod
    def joined(cls, parts: Sequence[Curve]) -> Curve:
        """Curves one after another."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([p.pixels for p in parts]), np.concatenate([p.normals for p in parts]),
            np.concatenate([p.radius_px for p in parts]), np.concatenate([p.xy for p in parts]),
            np.concatenate([p.lens for p in parts]),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Edge points and what they are of: samples, their place ``xy`` (n, 2) in normalised image coordinates.

    ``gauge`` (n, 2) times a difference of those is a distance in pixels along the curve's normal.
    """

    samples: Samples
    xy: Float
    gauge: Float
    radius_px: Float

    @classmethod
    def found(cls, samples: Samples, curve: Curve, offset_px: Float, keep: NDArray[np.bool_]) -> Edges:
        """Edges ``offset_px`` (n,) along the normals of a predicted curve, those that a mask keeps.

        The lens counts as linear over the offset.
        """
        lens, normals = curve.lens[keep], curve.normals[keep]
        away = np.linalg.solve(lens, (normals * offset_px[keep, np.newaxis])[..., np.newaxis])[..., 0]
        gauge = np.einsum("ni,nij->nj", normals, lens)
        return cls(samples.of(keep), curve.xy[keep] + away, gauge, curve.radius_px[keep])


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A pose, its covariance (6, 6) in (w, t), its cost (whitened, prior included) and an edge's sigma in pixels.

    ``edges_information`` (6, 6) and ``edges_pull`` (6,) are of the edges alone, for whoever knows the tilt himself:
    without the prior the pose would be ``edges_information``^-1 ``edges_pull`` from here. ``edges_cost`` is their part
    of the cost as if each stood for itself; ``inflation`` is by how much more sigma is, because neighbours err alike.
    """

    pose: PadPose
    cov: Float
    cost: float
    sigma_px: float
    edges_information: Float
    edges_pull: Float
    edges_cost: float
    inflation: float

    @property
    def cov_pos_pad_m2(self) -> Float:
        """Covariance (3, 3) of the camera's position in the pad frame."""
        return _cov_pos_pad_m2(self.pose, self.cov)


def _cov_pos_pad_m2(pose: PadPose, cov: Float) -> Float:
    jacobian = np.hstack((-pose.camera_from_pad.T @ skew(pose.pad_in_camera_m), -pose.camera_from_pad.T))
    covariance: Float = jacobian @ cov @ jacobian.T
    return covariance


def skew(v: Float) -> Float:
    """The matrix (3, 3) of the cross product with v."""
    return np.array(((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0)))


@lru_cache(maxsize=256)
def sample_rings(rings: tuple[Ring, ...], first: int, count: int) -> Samples:
    """``count`` evenly spaced points on the outer circle of rings, numbered from ``first``; as dense on the inner."""
    parts = []
    for number, ring in enumerate(rings, first):
        for radius, rises, points in (
            (ring.outer_m, 1.0, count),
            (ring.inner_m, -1.0, max(8, round(count * ring.ratio))),
        ):
            angle = (np.arange(points) + 0.5) * (2.0 * np.pi / points)
            unit = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(points)))
            centre = np.array((ring.x_m, ring.y_m, 0.0))
            parts.append(
                Samples(
                    centre + radius * unit,
                    unit,
                    np.full(points, radius),
                    np.full(points, rises),
                    np.full(points, number),
                )
            )
    return joined(parts)


def seen(camera: Camera, pose: PadPose, samples: Samples) -> Curve:
    """Where a pose puts the samples."""
    at = samples.points_m @ pose.camera_from_pad.T + pose.pad_in_camera_m
    z = np.where(at[:, 2] > 1e-6, at[:, 2], np.nan)
    xy = at[:, :2] / z[:, np.newaxis]
    # Derivatives of the lens by differences: exact to seven digits.
    step = 1e-5
    bent = camera.distort(np.stack((xy, xy + np.array((step, 0.0)), xy + np.array((0.0, step)))))
    pixels = bent * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)
    lens = np.stack((pixels[1] - pixels[0], pixels[2] - pixels[0]), axis=-1) / step
    outward = samples.outward @ pose.camera_from_pad.T
    along = samples.outward[:, :1] * pose.camera_from_pad[:, 1] - samples.outward[:, 1:2] * pose.camera_from_pad[:, 0]
    moved, tangent = (
        np.einsum("nij,nj->ni", lens, (v[:, :2] - xy * v[:, 2:]) / z[:, np.newaxis]) for v in (outward, along)
    )
    normals = np.column_stack((tangent[:, 1], -tangent[:, 0]))
    normals /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-12)[:, np.newaxis]
    across = normals[:, 0] * moved[:, 0] + normals[:, 1] * moved[:, 1]
    normals = np.where(across[:, np.newaxis] < 0.0, -normals, normals)
    return Curve(pixels[0], normals, np.abs(across) * samples.radius_m, xy, lens)


def solve(
    edges: Edges,
    start: PadPose,
    prior: TiltPrior | None,
    sigma_px: float = 0.3,
    least_sigma_px: float = SIGMA_FLOOR_PX,
    steps: int = _MAX_STEPS,
) -> Solution | None:
    """The pose that brings the circles onto edges: least distances along normals; None if it does not settle.

    Gauss-Newton with damping where a step makes it worse. Distances beyond three sigmas count less (Huber). Besides the
    pose, two numbers are found: how far blur draws round edges in and how far black has spread. The sigma of an edge is
    taken from the residuals but never below ``least_sigma_px``, and neighbours that err alike count as fewer.
    """
    state, pose, damping = np.array((BLUR_PX2, 0.0)), start, 0.0
    best = _linearised(edges, pose, state, prior, sigma_px)
    if best is None:
        return None
    for _ in range(steps):
        normal, gradient, cost, _ = best
        step = np.asarray(np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient), np.float64)
        tried = pose.moved(step[:6])
        there = _linearised(edges, tried, state + step[6:], prior, sigma_px)
        if there is None or there[2] > cost * (1.0 + 1e-9):
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e4:
                break
            continue
        pose, state, best, damping = tried, state + step[6:], there, 0.1 * damping
        if cost - there[2] < _SETTLED:
            break
    residual = best[3]
    scatter = max(float(1.4826 * np.median(np.abs(residual))), least_sigma_px)
    # The prior does not get surer when edges do, so only the edges' part of the information is scaled.
    inflation = _inflation(residual)
    alone = _linearised(edges, pose, state, None, scatter * inflation)
    if alone is None:
        return None
    information, pull = _of_pose(alone[0], alone[1])
    normal, edges_cost = alone[0], best[2]
    if prior is not None:
        lacking, slope = prior.residual(pose)
        normal[:6, :6] += slope.T @ slope
        edges_cost -= float(lacking @ lacking)
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    return Solution(pose, covariance[:6, :6], best[2], scatter, information, pull, edges_cost, inflation)


def _of_pose(normal: Float, gradient: Float) -> tuple[Float, Float]:
    """Information (6, 6) and gradient (6,) of the pose, blur and bleeding being free (Schur's complement)."""
    by_state = normal[:6, 6:] @ np.linalg.inv(normal[6:, 6:])
    information: Float = normal[:6, :6] - by_state @ normal[6:, :6]
    return 0.5 * (information + information.T), gradient[:6] - by_state @ gradient[6:]


def corners(camera: Camera, points_m: Float, pixels: Float) -> Edges:
    """Points (n, 3) of the pad and their pixels (n, 2) as edges: one along each axis of the picture, with no blur."""
    rays = camera.rays(pixels)
    xy = rays[:, :2] / rays[:, 2:]
    step = 1e-5
    bent = camera.distort(np.stack((xy, xy + np.array((step, 0.0)), xy + np.array((0.0, step)))))
    lens = np.stack((bent[1] - bent[0], bent[2] - bent[0]), axis=-1) / step
    gauge = (lens * np.array((camera.fx_px, camera.fy_px))[:, np.newaxis]).reshape(-1, 2)
    count = 2 * len(xy)
    none = np.zeros(count)
    samples = Samples(
        np.repeat(points_m, 2, axis=0), np.zeros((count, 3)), none, none, np.repeat(np.arange(len(xy)), 2)
    )  # fmt: skip
    return Edges(samples, np.repeat(xy, 2, axis=0), gauge, np.full(count, np.inf))


def both_solutions(
    edges: Edges, start: PadPose, prior: TiltPrior | None, sigma_px: float, ambiguous_below: float,
    least_sigma_px: float = SIGMA_FLOOR_PX,
) -> tuple[Solution, ...]:  # fmt: skip
    """The pose settled, and its mirror image in the line of sight while that fits about as well; the better first.

    Both are kept while their costs differ by less than ``ambiguous_below``. Empty if nothing settles.
    """
    found: list[Solution] = []
    starts = [start, other_side(start)]
    if prior is not None and prior.excludes(starts[1], ambiguous_below):
        starts = starts[:1]
    for pose in starts:
        solution = solve(edges, pose, prior, sigma_px, least_sigma_px)
        if solution is not None and all(_apart(solution.pose, other.pose) for other in found):
            found.append(solution)
    found.sort(key=lambda one: one.cost)
    return tuple(one for one in found if one.cost - found[0].cost < ambiguous_below)


def _apart(one: PadPose, other: PadPose) -> bool:
    """More than a third of a degree between the planes' normals."""
    return float(np.linalg.norm(np.cross(one.camera_from_pad[:, 2], other.camera_from_pad[:, 2]))) > 0.006


def _inflation(residual: Float) -> float:
    """By how much sigma grows because neighbours err alike.

    The larger of an autoregression of first order, and what sums over arcs of eight are beyond those of independent
    errors; and for the eight numbers that were fitted.
    """
    spread, count = float(residual @ residual), len(residual)
    if count < 24 or spread <= 0.0:
        return 1.0
    alike = min(max(float(residual[1:] @ residual[:-1]) / spread, 0.0), 0.9)
    arcs = np.add.reduceat(residual, np.arange(0, count, _ARC))
    grown = max((1.0 + alike) / (1.0 - alike), float(arcs @ arcs) / spread)
    return float(min(np.sqrt(grown * count / (count - 8.0)), _MAX_INFLATION))


def _linearised(
    edges: Edges, pose: PadPose, state: Float, prior: TiltPrior | None, sigma_px: float
) -> tuple[Float, Float, float, Float] | None:
    """Normal matrix (8, 8), gradient (8,), cost and residuals in pixels (n,) at a pose."""
    turned = edges.samples.points_m @ pose.camera_from_pad.T
    at = turned + pose.pad_in_camera_m
    depth = at[:, 2]
    if not float(depth.min(initial=np.inf)) > 1e-6:
        return None
    x, y = at[:, 0] / depth, at[:, 1] / depth
    gx, gy = edges.gauge[:, 0], edges.gauge[:, 1]
    inwards = -1.0 / np.maximum(edges.radius_px, 1.0)
    rises = edges.samples.rises
    residual = gx * (edges.xy[:, 0] - x) + gy * (edges.xy[:, 1] - y) - inwards * state[0] - rises * state[1]
    # A shift of the point moves its pixel along the normal by g^T [1 0 -x; 0 1 -y] / z; turning shifts it by w x p.
    px, py, pz = turned.T
    sx, sy, sz = gx / depth, gy / depth, -(gx * x + gy * y) / depth
    turn = (py * sz - pz * sy, pz * sx - px * sz, px * sy - py * sx)
    jacobian = np.column_stack((*turn, sx, sy, sz, inwards, rises))
    size = np.abs(residual) / sigma_px
    far = size > 3.0
    weight = np.where(far, 3.0 / np.maximum(size, 1e-12), 1.0)
    cost = float(np.sum(np.where(far, 6.0 * size - 9.0, size * size)))
    weighted = jacobian * (weight / sigma_px**2)[:, np.newaxis]
    normal, gradient = weighted.T @ jacobian, weighted.T @ residual
    off = np.array((BLUR_PX2, 0.0)) - state
    normal[(6, 7), (6, 7)] += _KNOWN
    gradient[6:] += _KNOWN * off
    cost += float(np.sum(_KNOWN * off * off))
    if prior is not None:
        lacking, slope = prior.residual(pose)
        normal[:6, :6] += slope.T @ slope
        gradient[:6] += slope.T @ lacking
        cost += float(lacking @ lacking)
    return normal, gradient, cost, residual


def distances(edges: Edges, pose: PadPose) -> Float:
    """How far beyond a pose's circles the edges lie, in pixels (n,)."""
    at = edges.samples.points_m @ pose.camera_from_pad.T + pose.pad_in_camera_m
    away: Float = np.einsum("ni,ni->n", edges.gauge, edges.xy - at[:, :2] / at[:, 2:])
    return away


def cov_of_edges(edges: Edges, pose: PadPose, prior: TiltPrior | None, sigma_px: float) -> Float:
    """Covariance (3, 3) of the camera's position that edges of this sigma, each on its own, would give at a pose."""
    there = _linearised(edges, pose, np.array((BLUR_PX2, 0.0)), prior, sigma_px)
    if there is None:
        message = "the pose puts the pad behind the camera"
        raise GeometryError(message)
    covariance = np.asarray(np.linalg.inv(there[0]), np.float64)
    return _cov_pos_pad_m2(pose, covariance[:6, :6])


def other_side(pose: PadPose) -> PadPose:
    """The pose that shows nearly the same picture: the plane's normal mirrored in the line of sight to its centre.

    Where perspective is weak a plane seen along v with normal n looks as with 2 (n.v) v - n (Oberkampf, DeMenthon and
    Davis, CVIU 63(3), 1996; Collins and Bartoli, IJCV 109, 2014).
    """
    normal = pose.camera_from_pad[:, 2]
    sight = pose.pad_in_camera_m / np.linalg.norm(pose.pad_in_camera_m)
    there = 2.0 * float(normal @ sight) * sight - normal
    axis, cosine = np.cross(normal, there), float(np.clip(normal @ there, -1.0, 1.0))
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return pose
    turn = np.asarray(cv2.Rodrigues(axis / length * np.arctan2(length, cosine))[0], np.float64)
    return PadPose(turn @ pose.camera_from_pad, pose.pad_in_camera_m)


def circle_poses(conic: Float, radius_m: float) -> tuple[tuple[Float, Float], tuple[Float, Float]]:
    """Both centres (3,) and normals (3,), in the camera frame, of a circle whose picture is a conic.

    ``conic`` (3, 3) acts on normalised image coordinates (x/z, y/z, 1). Normals point away from the camera. With
    eigenvalues l1 >= l2 > 0 > l3 and eigenvectors V (Shiu and Ahmad 1989; Kanatani and Liu 1993):
    n = V (+-g, 0, k), g^2 = (l1 - l2)/(l1 - l3), k^2 = (l2 - l3)/(l1 - l3), and the centre at depth
    z0 = l2 r / sqrt(-l1 l3) along V (+-(l3/l2) g, 0, (l1/l2) k).
    """
    symmetric = 0.5 * (conic + conic.T)
    values, vectors = np.linalg.eigh(symmetric)
    if np.sum(values > 0.0) == 1:
        values, vectors = np.linalg.eigh(-symmetric)
    if not (values[0] < 0.0 < values[1]):
        message = "the conic is no ellipse that a circle ahead of the camera can look like"
        raise GeometryError(message)
    l3, l2, l1 = values
    v1, v3 = vectors[:, 2], vectors[:, 0]
    g, k = np.sqrt((l1 - l2) / (l1 - l3)), np.sqrt((l2 - l3) / (l1 - l3))
    depth = l2 * radius_m / np.sqrt(-l1 * l3)
    found = []
    for sign in (1.0, -1.0):
        centre = depth * (sign * (l3 / l2) * g * v1 + (l1 / l2) * k * v3)
        normal = sign * g * v1 + k * v3
        centre = centre if centre[2] > 0.0 else -centre
        found.append((centre, normal if normal @ centre > 0.0 else -normal))
    return found[0], found[1]
