"""A mosaic of the ground seen along the way, by pictures alone: its scale and its turn from north stay unknown.

For a start without any position. Roll and pitch come from the attitude, whose yaw may be off by any constant; how the
camera moved, and how its height changed, come from tracks over ground taken as level, in units of the first height.
Every patch of ground enters once however often it is seen, so that a hover adds nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.odometry.tracker import CornerTracker, TrackerConfig
from estimator.types import Float, Image

MIN_TRACKS = 12


@dataclass(frozen=True, slots=True)
class MosaicConfig:
    """How densely to lay pictures and how far back the mosaic reaches.

    ``step_share`` is the motion between two pictures that are laid, as a share of the height; ``max_slope`` the
    tangent of the angle from the vertical up to which ground is used.
    """

    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    interval_s: float = 0.2
    max_gap_s: float = 2.5
    step_share: float = 0.12
    max_length_m: float = 700.0
    max_slope: float = 1.2
    inlier_slope: float = 0.012
    min_inlier_fraction: float = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class MosaicPose:
    """The camera in the mosaic's frame: position (2,), height above ground, rotation (3, 3), at ``t_us``."""

    t_us: int
    pos_m: Float
    height_m: float
    level_from_camera: Float


@dataclass(frozen=True, slots=True, eq=False)
class Mosaic:
    """Ground along the way: grey (rows, cols) float32 and where it is known, rows to the frame's "south".

    Pixel (r, c) lies at ``first_m`` + (-r, c) ``gsd_m``.
    """

    image: NDArray[np.float32]
    known: NDArray[np.bool_]
    first_m: Float
    gsd_m: float

    def without(self, other: Mosaic) -> Mosaic:
        """What of this mosaic's ground another one of the same frame has not seen."""
        known: NDArray[np.bool_] = self.known.copy()
        rows, cols = (int(v) for v in np.round((other.first_m - self.first_m) / self.gsd_m * np.array([-1.0, 1.0])))
        top, left = max(rows, 0), max(cols, 0)
        bottom = min(rows + other.known.shape[0], known.shape[0])
        right = min(cols + other.known.shape[1], known.shape[1])
        if top < bottom and left < right:
            known[top:bottom, left:right] &= ~other.known[top - rows : bottom - rows, left - cols : right - cols]
        return Mosaic(self.image, known, self.first_m, self.gsd_m)

    def place_m(self, pixel: Float) -> complex:
        """Where a pixel (row, column) lies in the mosaic's frame: north + i east."""
        return complex(self.first_m[0] - self.gsd_m * pixel[0], self.first_m[1] + self.gsd_m * pixel[1])

    @property
    def area_m2(self) -> float:
        """How much ground is known."""
        return float(self.known.sum()) * self.gsd_m**2


@dataclass(frozen=True, slots=True, eq=False)
class _Laid:
    """One rectified picture on the mosaic's lattice: first pixel's row and column there, grey, weight; way so far."""

    row: int
    col: int
    image: NDArray[np.float32]
    weight: NDArray[np.float32]
    way_m: float


class MosaicOdometry:
    """Follows the camera over the ground and lays the pictures out."""

    def __init__(self, camera: Camera, gsd_m: float, config: MosaicConfig | None = None) -> None:
        self.config = config or MosaicConfig()
        self.gsd_m = gsd_m
        self._camera = camera
        self._tracker = CornerTracker(camera, self.config.tracker)
        self._laid: list[_Laid] = []
        self.pose: MosaicPose | None = None
        self.way_m = 0.0
        self.parts = 0

    def restart(self) -> None:
        """Forget everything."""
        self._tracker.reset()
        self._laid.clear()
        self.pose = None
        self.way_m = 0.0
        self.parts += 1

    def offer(self, t_us: int, image: Image, level_from_camera: Float, height_m: float) -> bool:
        """Use a grey picture; ``height_m`` above ground counts only where a mosaic begins. True if it was followed.

        ``parts`` counts the mosaics begun: the frame of one is not that of the next.
        """
        pose = self.pose
        if pose is not None and t_us - pose.t_us < self.config.interval_s * 1e6:
            return False
        if pose is not None and t_us - pose.t_us > self.config.max_gap_s * 1e6:
            self.restart()
            pose = None
        if pose is None:
            self._tracker.track(image)
            self._begin(t_us, image, level_from_camera, height_m)
            return True
        moved = self._moved(image, pose, level_from_camera)
        if moved is None:
            self.restart()
            self._tracker.track(image)
            self._begin(t_us, image, level_from_camera, height_m)
            return True
        step, growth = moved
        self.way_m += float(np.hypot(*step)) * pose.height_m
        self.pose = MosaicPose(t_us, pose.pos_m + step * pose.height_m, pose.height_m * growth, level_from_camera)
        last_way_m = self._laid[-1].way_m if self._laid else -np.inf
        if self.way_m - last_way_m >= self.config.step_share * self.pose.height_m:
            self._lay(image, self.pose)
        return True

    def _begin(self, t_us: int, image: Image, level_from_camera: Float, height_m: float) -> None:
        self.pose = MosaicPose(t_us, np.zeros(2), height_m, level_from_camera)
        self._lay(image, self.pose)

    def _moved(self, image: Image, last: MosaicPose, level_from_camera: Float) -> tuple[Float, float] | None:
        """Motion (2,) over the last height, and the ratio of the heights; None where too few tracks agree."""
        corners = self._tracker.corners_uv_px
        turned = self._camera.rays(corners) @ (level_from_camera.T @ last.level_from_camera).T
        uv = self._camera.project(turned)
        near = np.isfinite(uv) & (np.abs(uv - corners) < self._camera.width_px)
        inside: NDArray[np.bool_] = np.asarray(near.all(axis=1))
        tracks = self._tracker.track(image, np.where(inside[:, None], uv, corners)) if len(corners) else None
        if tracks is None or len(tracks.previous_uv_px) < MIN_TRACKS:
            if not len(corners):
                self._tracker.track(image)
            return None
        both = self._camera.rays(np.concatenate((tracks.previous_uv_px, tracks.present_uv_px)))
        count = len(tracks.previous_uv_px)
        first, second = both[:count] @ last.level_from_camera.T, both[count:] @ level_from_camera.T
        usable = (first[:, 2] > 0.3) & (second[:, 2] > 0.3)
        if usable.sum() < MIN_TRACKS:
            return None
        first, second = first[usable], second[usable]
        return scaled_shift(first[:, :2] / first[:, 2:], second[:, :2] / second[:, 2:], self.config)

    def _lay(self, image: Image, pose: MosaicPose) -> None:
        patch = rectified(image, self._camera, pose, self.gsd_m, self.config.max_slope)
        if patch is None:
            return
        row, col, grey, weight = patch
        self._laid.append(_Laid(row, col, grey, weight, self.way_m))
        while self._laid and self._laid[0].way_m < self.way_m - self.config.max_length_m:
            del self._laid[0]

    def mosaic(self, from_way_m: float = -np.inf) -> Mosaic | None:
        """What has been laid after a way, ``max_length_m`` at the most, averaged where pictures overlap.

        None where that is nothing.
        """
        laid = [part for part in self._laid if part.way_m > from_way_m]
        if not laid:
            return None
        top, left = min(part.row for part in laid), min(part.col for part in laid)
        bottom = max(part.row + part.image.shape[0] for part in laid)
        right = max(part.col + part.image.shape[1] for part in laid)
        total = np.zeros((bottom - top, right - left), dtype=np.float32)
        weight = np.zeros_like(total)
        for part in laid:
            rows, cols = part.image.shape
            at = (slice(part.row - top, part.row - top + rows), slice(part.col - left, part.col - left + cols))
            total[at] += part.image * part.weight
            weight[at] += part.weight
        known: NDArray[np.bool_] = np.asarray(weight > 0.05)
        grey = np.where(known, total / np.maximum(weight, 1e-6), 0.0).astype(np.float32)
        return Mosaic(grey, known, self.gsd_m * np.array([-top, left], dtype=np.float64), self.gsd_m)


def scaled_shift(first: Float, second: Float, config: MosaicConfig) -> tuple[Float, float] | None:
    """Fit first = k second + d to slopes (n, 2) of the same ground points seen from two places.

    k is the second height over the first, d (2,) the motion over the first height. Robust by trimming; None where too
    few agree.
    """
    keep = np.ones(len(first), dtype=bool)
    centre = np.median(first - second, axis=0)
    distance = np.hypot(*(first - second - centre).T)
    keep = distance < max(3.0 * float(np.median(distance)), config.inlier_slope)
    shift, ratio = centre, 1.0
    for _ in range(3):
        if keep.sum() < MIN_TRACKS or keep.sum() < config.min_inlier_fraction * len(first):
            return None
        mean_1, mean_2 = first[keep].mean(axis=0), second[keep].mean(axis=0)
        spread = second[keep] - mean_2
        ratio = float(((first[keep] - mean_1) * spread).sum() / max(float((spread**2).sum()), 1e-9))
        shift = mean_1 - ratio * mean_2
        distance = np.hypot(*(first - ratio * second - shift).T)
        keep = distance < max(3.0 * float(np.median(distance)), 0.25 * config.inlier_slope)
    if not 0.8 < ratio < 1.25:
        return None
    return shift, ratio


def rectified(
    image: Image, camera: Camera, pose: MosaicPose, gsd_m: float, max_slope: float
) -> tuple[int, int, NDArray[np.float32], NDArray[np.float32]] | None:
    """A picture on the level lattice of ``gsd_m`` through the frame's origin: first row and column, grey, weight.

    None where it sees no ground within ``max_slope``.
    """
    u = np.linspace(0.0, camera.width_px - 1.0, 9)
    v = np.linspace(0.0, camera.height_px - 1.0, 7)
    rays = camera.rays(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)) @ pose.level_from_camera.T
    rays = rays[np.isfinite(rays).all(axis=1) & (rays[:, 2] > 1.0 / np.hypot(1.0, max_slope))]
    if len(rays) < 6:
        return None
    points = pose.pos_m + rays[:, :2] / rays[:, 2:] * pose.height_m
    top, bottom = -int(np.floor(points[:, 0].max() / gsd_m)), -int(np.ceil(points[:, 0].min() / gsd_m))
    left, right = int(np.ceil(points[:, 1].min() / gsd_m)), int(np.floor(points[:, 1].max() / gsd_m))
    if bottom - top < 6 or right - left < 6:
        return None
    row, col = np.meshgrid(np.arange(top, bottom + 1), np.arange(left, right + 1), indexing="ij")
    away = np.stack((-row * gsd_m - pose.pos_m[0], col * gsd_m - pose.pos_m[1]), axis=-1)
    points_3d = np.concatenate((away, np.full((*row.shape, 1), pose.height_m)), axis=-1)
    factor = min(1.0, pose.height_m / camera.fx_px / gsd_m * 1.15)
    small = camera.scaled(factor)
    reduced = image
    if factor < 1.0:
        reduced = cv2.resize(image, (small.width_px, small.height_px), interpolation=cv2.INTER_AREA).astype(np.uint8)
    uv = small.project(points_3d @ pose.level_from_camera)
    rim = np.minimum(
        np.minimum(uv[..., 0], small.width_px - 1.0 - uv[..., 0]),
        np.minimum(uv[..., 1], small.height_px - 1.0 - uv[..., 1]),
    )
    rim = np.nan_to_num(rim, nan=-1.0)
    seen = (rim >= 0.0) & (np.hypot(away[..., 0], away[..., 1]) <= max_slope * pose.height_m)
    uv32 = np.nan_to_num(uv, nan=-10.0).astype(np.float32)
    grey = cv2.remap(reduced, uv32[..., 0], uv32[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # faded at the rim, so that the next picture's edge draws no line
    weight = np.where(seen, np.clip((rim + 0.5) / 8.0, 0.06, 1.0), 0.0).astype(np.float32)
    return top, left, grey.astype(np.float32), weight
