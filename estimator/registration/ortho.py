"""Pictures and maps on common north-up grids, at a resolution of choice, and whole-area searches over them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.geometry.ground import intersect_plane
from estimator.ports import GroundModel, MapWindow, ReferenceMap
from estimator.registration.alignment import CameraPose
from estimator.types import Float, Image

MIN_SIDE_PX = 16
MAX_PIXELS = 16_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Ortho:
    """A picture rectified onto the ground.

    ``image`` (rows, cols) is grey, ``mask`` says where there is picture; ``points_ned_m`` (rows, cols, 3) is the ground
    of each pixel under the pose that it was rectified with. Rows run south, columns east, in steps of ``gsd_m``.
    """

    image: Image
    mask: NDArray[np.bool_]
    points_ned_m: Float
    gsd_m: float

    @property
    def corner_ne_m(self) -> Float:
        """North and east (2,) of the first pixel."""
        corner: Float = self.points_ned_m[0, 0, :2]
        return corner


class CoarseMap:
    """A reference map that asks to be matched at a coarser resolution than its own."""

    def __init__(self, reference: ReferenceMap, gsd_m: float) -> None:
        self._reference = reference
        self._gsd_m = max(gsd_m, reference.gsd_m)

    @property
    def gsd_m(self) -> float:
        """Ground sample distance to match at, metres per pixel."""
        return self._gsd_m

    @property
    def bounds_ne_m(self) -> tuple[float, float, float, float]:
        """The reference's own rectangle."""
        return self._reference.bounds_ne_m

    def window(self, north_min_m: float, east_min_m: float, north_max_m: float, east_max_m: float) -> MapWindow:
        """The imagery of a rectangle, at the reference's own resolution."""
        return self._reference.window(north_min_m, east_min_m, north_max_m, east_max_m)


class Ground:
    """Ground of a local frame without holes: what the model does not know is as high as the middle of what it does."""

    def __init__(self, model: GroundModel, origin_alt_amsl_m: float, around_ne_m: Float, reach_m: float) -> None:
        """``around_ne_m`` (2,) and ``reach_m`` say where to look for the middle; ValueError where nothing is known."""
        self._model = model
        self.origin_alt_amsl_m = origin_alt_amsl_m
        steps = reach_m * np.linspace(-1.0, 1.0, 33)
        north, east = np.meshgrid(around_ne_m[0] + steps, around_ne_m[1] + steps, indexing="ij")
        alt = model.alt_amsl_m(north.ravel(), east.ravel())
        known = alt[np.isfinite(alt)]
        if not known.size:
            message = "the height of the ground is unknown all over the search area"
            raise ValueError(message)
        self.level_amsl_m = float(np.median(known))
        self.relief_m = float(np.percentile(known, 95) - np.percentile(known, 5))

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        """Ground altitude (...), finite everywhere."""
        alt = self._model.alt_amsl_m(north_m, east_m)
        return np.where(np.isnan(alt), self.level_amsl_m, alt)

    def down_m(self, north_m: Float, east_m: Float) -> Float:
        """NED down (...) of the ground."""
        return self.origin_alt_amsl_m - self.alt_amsl_m(north_m, east_m)

    def down_at_m(self, pos_ne_m: Float) -> float:
        """NED down of the ground below one position (2,)."""
        return float(self.down_m(pos_ne_m[0:1], pos_ne_m[1:2])[0])


def rectify(
    image: Image, camera: Camera, pose: CameraPose, ground: Ground, gsd_m: float, max_px: int,
    max_obliquity_rad: float, shape: tuple[int, int] | None = None,
) -> Ortho | None:  # fmt: skip
    """A grey picture (rows, cols) on the ground as a pose has it; None where too little ground is seen.

    The grid has the footprint's size, cropped to ``max_px`` a side, or the odd ``shape`` asked for, about its middle.
    """
    footprint = footprint_ne_m(camera, pose, ground, max_obliquity_rad)
    if footprint is None:
        return None
    low, high = footprint.min(axis=0), footprint.max(axis=0)
    middle = 0.5 * (low + high)
    half = np.minimum(0.5 * (high - low), 0.5 * max_px * gsd_m)
    count = np.floor(half / gsd_m).astype(int) if shape is None else (np.array(shape) - 1) // 2
    if (2 * count + 1).min() < MIN_SIDE_PX:
        return None
    north = middle[0] + gsd_m * np.arange(count[0], -count[0] - 1, -1, dtype=np.float64)
    east = middle[1] + gsd_m * np.arange(-count[1], count[1] + 1, dtype=np.float64)
    ne = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1)
    down = ground.down_m(ne[..., 0].ravel(), ne[..., 1].ravel()).reshape(ne.shape[:2])
    points = np.concatenate((ne, down[..., None]), axis=-1)
    seen, mask = sample(image, camera, (points - pose.pos_ned_m) @ pose.ned_from_camera, gsd_m)
    descent = points[..., 2] - pose.pos_ned_m[2]
    mask &= descent > np.cos(max_obliquity_rad) * np.linalg.norm(points - pose.pos_ned_m, axis=-1)
    return Ortho(seen, mask, points, gsd_m) if mask.sum() >= MIN_SIDE_PX**2 else None


def footprint_ne_m(camera: Camera, pose: CameraPose, ground: Ground, max_obliquity_rad: float) -> Float | None:
    """Ground points (n, 2) that a grid of pixels sees, steeper than a limit; None where fewer than eight do."""
    u = np.linspace(0.0, camera.width_px - 1.0, 9)
    v = np.linspace(0.0, camera.height_px - 1.0, 7)
    rays = camera.rays(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)) @ pose.ned_from_camera.T
    rays = rays[rays[:, 2] > np.cos(max_obliquity_rad)]
    if len(rays) < 8:
        return None
    down = ground.down_at_m(pose.pos_ned_m[:2])
    points = intersect_plane(pose.pos_ned_m, rays, down)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 8:
        return None
    down = float(np.mean(ground.down_m(points[:, 0], points[:, 1])))
    points = intersect_plane(pose.pos_ned_m, rays, down)
    points = points[np.isfinite(points).all(axis=1)]
    return points[:, :2] if len(points) >= 8 else None


def sample(image: Image, camera: Camera, points_camera_m: Float, gsd_m: float) -> tuple[Image, NDArray[np.bool_]]:
    """The picture at points (rows, cols, 3) of the camera frame, averaged to about ``gsd_m``, and where it exists."""
    distance = float(np.median(points_camera_m[..., 2][points_camera_m[..., 2] > 0.0], axis=None))
    factor = min(1.0, 1.15 * distance / camera.fx_px / gsd_m) if np.isfinite(distance) else 1.0
    if factor < 0.75:
        camera = camera.scaled(factor)
        size = (camera.width_px, camera.height_px)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    uv = camera.project(points_camera_m)
    inside = (
        (uv[..., 0] >= 1.0) & (uv[..., 0] <= camera.width_px - 2.0)
        & (uv[..., 1] >= 1.0) & (uv[..., 1] <= camera.height_px - 2.0)
    )  # fmt: skip
    uv32 = np.nan_to_num(uv, nan=-10.0).astype(np.float32)
    seen = cv2.remap(image, uv32[..., 0], uv32[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # gradients at the rim of the mask see replicated pixels
    eroded = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    return np.asarray(seen, dtype=np.uint8), np.asarray(eroded)


@dataclass(frozen=True, slots=True, eq=False)
class MapArea:
    """A rectangle of the map on a grid: as ``Ortho``, without points; the first pixel is at ``corner_ne_m`` (2,)."""

    image: Image
    valid: NDArray[np.bool_]
    corner_ne_m: Float
    gsd_m: float


def map_area(reference: ReferenceMap, centre_ne_m: Float, half_ne_m: Float, gsd_m: float) -> MapArea | None:
    """The map about a centre (2,), ``half_ne_m`` (2,) to each side, averaged to ``gsd_m``; None where there is none."""
    low, high = centre_ne_m - half_ne_m, centre_ne_m + half_ne_m
    window = reference.window(float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    if not window.valid.any():
        return None
    ratio = gsd_m / window.gsd_m
    corner = np.array([window.north_max_m, window.east_min_m])
    if ratio < 1.01:
        return MapArea(window.image, window.valid, corner, window.gsd_m)
    size = (max(1, int(window.image.shape[1] / ratio)), max(1, int(window.image.shape[0] / ratio)))
    # pixel centres of the coarse grid lie half a coarse pixel inside the first fine pixel's edge
    shift = 0.5 * (ratio - 1.0)
    matrix = np.array([[ratio, 0.0, shift], [0.0, ratio, shift]])
    image = cv2.GaussianBlur(window.image, (0, 0), 0.4 * ratio) if ratio > 1.5 else window.image
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    image = cv2.warpAffine(image, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    valid = cv2.warpAffine(window.valid.astype(np.uint8), matrix, size, flags=flags) > 0
    corner = corner + np.array([-shift, shift]) * window.gsd_m
    return MapArea(np.asarray(image, dtype=np.uint8), np.asarray(valid), corner, gsd_m)
