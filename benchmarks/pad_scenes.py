"""Pictures of landing pads on the ground of simulated worlds, with the truth: lens, blur, light, noise, compression.

The pad is drawn by its geometry, not from a raster: each pixel it touches is the mean of sixteen rays. What covers or
shades it lies on the ground, so it follows perspective.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_euler
from estimator.landing.pad import CirclePad, Pad, Ring, TagPad
from estimator.landing.pose import PadPose
from estimator.types import Float, Image
from simulator.world.pad_print import INK, PAPER, SUPERSAMPLING, Float32, Sheet, box_of, in_ring, in_sheet, on_plane
from simulator.world.world import WorldSpec, world_for

WORLD_GSD_M = 0.02
"""The world's ground raster is laid out this fine, so that it has detail from a few metres: fields become grass."""
VGA = Camera(640, 480, 800.0, 800.0, 319.5, 239.5, (-0.12, 0.06, 0.0005, -0.0004, 0.0))
HD = Camera(1280, 720, 1200.0, 1200.0, 639.5, 359.5, (-0.10, 0.05, 0.0004, 0.0003, 0.0))


@dataclass(frozen=True, slots=True)
class Look:
    """What spoils a picture.

    ``defocus_px`` is the sigma of a Gaussian, ``motion_px`` the length of a smear along ``motion_rad``; ``noise`` is in
    grey levels; ``jpeg`` a quality, 0 for none. ``covered`` (from one side), ``littered`` (patches like leaves and
    earth, 0.1 to 0.5 m wide) and ``shaded`` are shares of the sheet; ``glare`` is the strength of a bright spot on it,
    in grey levels.
    """

    defocus_px: float = 0.6
    motion_px: float = 0.0
    motion_rad: float = 0.0
    noise: float = 2.0
    gain: float = 1.0
    jpeg: int = 0
    covered: float = 0.0
    littered: float = 0.0
    shaded: float = 0.0
    glare: float = 0.0


@dataclass(slots=True)
class PadScene:
    """A ground with a pad on it, and pictures of both.

    ``rings`` replaces the pad's rings for prints that are not what the description says; ``sheet`` scales, mirrored or
    partly missing pads are made of them. ``shift_m`` moves a second copy of the rings, for two pads in view. The pad
    lies at ``corner_px`` of the ground, else elsewhere in each picture.
    """

    ground: Image
    camera: Camera
    pad: Pad | None
    rings: tuple[Ring, ...] | None = None
    second_at_m: tuple[float, float] | None = None
    missing_beyond_y_m: float = math.inf
    corner_px: tuple[float, float] | None = None
    _rays: Float32 = field(init=False)
    _whole: Float32 | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        u, v = np.meshgrid(np.arange(self.camera.width_px), np.arange(self.camera.height_px))
        rays = self.camera.rays(np.stack((u, v), axis=-1))
        self._rays = np.ascontiguousarray(rays[..., :2] / rays[..., 2:], dtype=np.float32)

    def render(self, pose: PadPose, look: Look, rng: np.random.Generator) -> Image:
        """A grey picture (rows, cols) from a pose."""
        xy = on_plane(self._rays, pose.camera_from_pad, pose.pad_in_camera_m)
        picture = self._ground(xy, rng)
        if self.pad is not None:
            self._draw_pad(picture, pose, look, rng)
        if look.glare > 0.0:
            _add_glare(picture, look, pose, self.camera, rng)
        picture *= look.gain
        return _recorded(picture, look, rng)

    def _ground(self, xy: Float32, rng: np.random.Generator) -> Float32:
        rows, cols = self.ground.shape
        corner = rng.uniform(0.0, (rows, cols)) if self.corner_px is None else np.array(self.corner_px)
        at = xy / WORLD_GSD_M
        # Where a pixel covers many of the raster, a smaller one is taken, as a lens would average.
        step = max(1.0, float(np.median(np.abs(np.diff(at[:, :, 0], axis=0)))))
        coarse = cv2.resize(self.ground, None, fx=1.0 / step, fy=1.0 / step, interpolation=cv2.INTER_AREA)
        at = (at + corner.astype(np.float32)) / np.float32(step)
        grey = cv2.remap(
            coarse.astype(np.float32), _wrapped(at[:, :, 1], coarse.shape[1]), _wrapped(-at[:, :, 0], coarse.shape[0]),
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101,
        )  # fmt: skip
        return np.asarray(grey, np.float32)

    def _draw_pad(self, picture: Float32, pose: PadPose, look: Look, rng: np.random.Generator) -> None:
        pad = self.pad
        assert pad is not None  # noqa: S101 - render() asked
        sheet = pad.bounds_m
        cover, shade = _strip(sheet, look.covered, rng), _strip(sheet, look.shaded, rng)
        litter = _litter(sheet, look.littered, rng)
        places = [(0.0, 0.0)] + ([self.second_at_m] if self.second_at_m else [])
        for place in places:
            box = box_of(sheet, self.camera, pose.camera_from_pad, pose.pad_in_camera_m, place)
            if box is None:
                continue
            rows, cols = box
            fine = self._fine_rays(rows, cols)
            xy = on_plane(fine, pose.camera_from_pad, pose.pad_in_camera_m) - np.array(place, np.float32)
            value, on_sheet = self._print(xy, sheet)
            ground = cv2.resize(picture[rows, cols], None, fx=SUPERSAMPLING, fy=SUPERSAMPLING,
                                interpolation=cv2.INTER_LINEAR)  # fmt: skip
            bare = on_sheet & ~_in_strip(xy, cover)
            for x, y, radius in litter:
                bare &= (xy[..., 0] - x) ** 2 + (xy[..., 1] - y) ** 2 > radius**2
            value = np.where(bare, value, ground)
            value = np.where(_in_strip(xy, shade), 0.35 * value, value).astype(np.float32)
            height, width = picture[rows, cols].shape
            picture[rows, cols] = cv2.resize(value, (width, height), interpolation=cv2.INTER_AREA)

    def _fine_rays(self, rows: slice, cols: slice) -> Float32:
        if self._rays[rows, cols].shape != self._rays.shape:
            return _finer(self._rays[rows, cols])
        if self._whole is None:
            self._whole = _finer(self._rays)
        return self._whole

    def _print(self, xy: Float32, sheet: Sheet) -> tuple[Float32, NDArray[np.bool_]]:
        x, y = xy[..., 0], xy[..., 1]
        on_sheet = in_sheet(x, y, (*sheet[:3], min(sheet[3], self.missing_beyond_y_m)))
        value = np.full(x.shape, PAPER, np.float32)
        if isinstance(self.pad, TagPad):
            _tags_onto(value, x, y, self.pad)
            return value, on_sheet
        rings = self.rings if self.rings is not None else (self.pad.rings if self.pad is not None else ())
        for ring in rings:
            part = _part_near(x, y, ring)
            if part is not None:
                value[part][in_ring(x[part], y[part], ring)] = INK
        return value, on_sheet


def _part_near(x: Float32, y: Float32, ring: Ring, step: int = 16) -> tuple[slice, slice] | None:
    """The part of an array of pad coordinates that may lie on a ring, by each ``step``-th ray; None if none does."""
    coarse_x, coarse_y = x[::step, ::step], y[::step, ::step]
    if min(coarse_x.shape) < 2:
        return slice(None), slice(None)
    gaps = [np.hypot(np.diff(coarse_x, axis=axis), np.diff(coarse_y, axis=axis)).max() for axis in (0, 1)]
    near = np.hypot(coarse_x - ring.x_m, coarse_y - ring.y_m) <= ring.outer_m + 1.5 * max(gaps)
    rows, cols = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    if not len(rows):
        return None
    return (
        slice(max(int(rows[0]) - 1, 0) * step, (int(rows[-1]) + 2) * step),
        slice(max(int(cols[0]) - 1, 0) * step, (int(cols[-1]) + 2) * step),
    )


def _tags_onto(value: Float32, x: Float32, y: Float32, pad: TagPad) -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for tag in pad.tags:
        cells = cv2.aruco.generateImageMarker(dictionary, tag.number, 8)
        row = np.floor((0.5 - (x - tag.x_m) / tag.side_m) * 8.0).astype(int)
        col = np.floor((0.5 + (y - tag.y_m) / tag.side_m) * 8.0).astype(int)
        there = (row >= 0) & (row < 8) & (col >= 0) & (col < 8)
        value[there] = np.where(cells[row[there], col[there]] > 127, PAPER, INK)


def _finer(rays: Float32) -> Float32:
    """The rays of sub-pixels; the lens is smooth, so those of pixels are interpolated and carried on at the rim."""
    height, width = rays.shape[:2]
    part = (np.arange(SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5
    fine = []
    for count in (height, width):
        at = (np.arange(count)[:, np.newaxis] + part).ravel()
        low = np.clip(np.floor(at).astype(int), 0, max(count - 2, 0))
        fine.append((low, (at - low).astype(np.float32)))
    (row, down), (col, right) = fine
    lines = rays[row] * (1 - down)[:, None, None] + rays[np.minimum(row + 1, height - 1)] * down[:, None, None]
    across: Float32 = (
        lines[:, col] * (1 - right)[None, :, None] + lines[:, np.minimum(col + 1, width - 1)] * right[None, :, None]
    )
    return across


def _strip(sheet: Sheet, share: float, rng: np.random.Generator) -> tuple[float, ...] | None:
    """A half plane that takes this share of the sheet from a random side: direction and least distance along it."""
    if share <= 0.0:
        return None
    angle = rng.uniform(0.0, 2.0 * math.pi)
    x, y = np.meshgrid(np.linspace(sheet[0], sheet[2], 60), np.linspace(sheet[1], sheet[3], 60))
    along = np.cos(angle) * x + np.sin(angle) * y
    return math.cos(angle), math.sin(angle), float(np.quantile(along, 1.0 - share))


def _litter(sheet: Sheet, share: float, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Discs (x, y, radius) that together cover this share of the sheet."""
    x, y = np.meshgrid(np.linspace(sheet[0], sheet[2], 60), np.linspace(sheet[1], sheet[3], 60))
    bare = np.ones(x.shape, bool)
    found: list[tuple[float, float, float]] = []
    while 1.0 - float(np.mean(bare)) < share:
        u, v, radius = rng.uniform(sheet[0], sheet[2]), rng.uniform(sheet[1], sheet[3]), rng.uniform(0.05, 0.25)
        bare &= (x - u) ** 2 + (y - v) ** 2 > radius**2
        found.append((float(u), float(v), float(radius)))
    return found


def _in_strip(xy: Float32, strip: tuple[float, ...] | None) -> NDArray[np.bool_]:
    if strip is None:
        return np.zeros(xy.shape[:-1], bool)
    return np.asarray(strip[0] * xy[..., 0] + strip[1] * xy[..., 1] >= strip[2])


def _wrapped(at: Float32, size: int) -> Float32:
    """Positions folded into a raster, so that ground goes on beyond it."""
    period = np.float32(2 * (size - 1))
    folded = np.mod(at, period)
    return np.where(folded > size - 1, period - folded, folded).astype(np.float32)


def _add_glare(picture: Float32, look: Look, pose: PadPose, camera: Camera, rng: np.random.Generator) -> None:
    """A mirror of the sun near the pad: a bright spot that saturates in its middle."""
    centre = camera.project(pose.pad_in_camera_m + pose.camera_from_pad @ np.array((*rng.uniform(-0.7, 0.7, 2), 0.0)))
    sigma = 0.45 * camera.fx_px / float(pose.pad_in_camera_m[2])
    v, u = np.mgrid[: picture.shape[0], : picture.shape[1]]
    far = ((u - centre[0]) ** 2 + (v - centre[1]) ** 2) / (2.0 * sigma**2)
    picture += (look.glare * np.exp(-far)).astype(np.float32)


def _recorded(picture: Float32, look: Look, rng: np.random.Generator) -> Image:
    """Blur, noise, eight bits and JPEG."""
    if look.motion_px > 0.0:
        picture = np.asarray(cv2.filter2D(picture, -1, _smear(look.motion_px, look.motion_rad)), np.float32)
    if look.defocus_px > 0.0:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), look.defocus_px), np.float32)
    noisy = picture + rng.normal(0.0, look.noise, picture.shape).astype(np.float32) if look.noise else picture
    image = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
    if look.jpeg:
        _, data = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, look.jpeg))
        image = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)
    return image


def _smear(length_px: float, angle_rad: float) -> Float32:
    half = math.ceil(length_px / 2) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for along in np.linspace(-length_px / 2, length_px / 2, 64):
        u, v = half + along * math.cos(angle_rad), half + along * math.sin(angle_rad)
        u0, v0 = int(u), int(v)
        for dv, du in ((0, 0), (0, 1), (1, 0), (1, 1)):
            kernel[v0 + dv, u0 + du] += (1 - abs(u - u0 - du)) * (1 - abs(v - v0 - dv))
    return np.asarray(kernel / kernel.sum(), np.float32)


def compressed(frames: Sequence[Image], kbit_s: int, rate: int = 25) -> list[Image]:
    """Frames after H.264 at a bit rate, as a small transmitter sends them."""
    height, width = frames[0].shape
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mpegts") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = width, height, "yuv420p", kbit_s * 1000
        stream.options = {"preset": "veryfast", "tune": "zerolatency"}
        for frame in frames:
            bgr = np.repeat(frame[:, :, np.newaxis], 3, axis=2)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(bgr, format="bgr24")))
        container.mux(stream.encode())
    buffer.seek(0)
    with av.open(buffer, "r") as container:
        pictures = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
    return [np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8) for picture in pictures]


def ground_of(seed: int, cache: Path | None = None) -> Image:
    """The ground raster of a simulated world, grey."""
    world = world_for(WorldSpec(seed, half_size_m=200.0), cache)
    return np.asarray(cv2.cvtColor(world.ground_bgr, cv2.COLOR_BGR2GRAY), np.uint8)


def pose_at(
    height_m: float, away_m: tuple[float, float], heading_rad: float, tilt_rad: tuple[float, float] = (0.0, 0.0)
) -> PadPose:
    """A camera ``height_m`` over the pad and ``away_m`` (x, y) beside it, looking down, turned, then tilted."""
    # Looking straight down with the top of the picture forward: camera x is pad y, camera y is minus pad x.
    level = np.array(((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    turn = matrix_from_euler(0.0, 0.0, heading_rad)
    tilt = matrix_from_euler(tilt_rad[0], tilt_rad[1], 0.0)
    camera_from_pad: Float = tilt @ level @ turn.T
    return PadPose(camera_from_pad, -camera_from_pad @ np.array((away_m[0], away_m[1], -height_m)))


def looking_at_pad(
    height_m: float, away_m: tuple[float, float], heading_rad: float, off_rad: tuple[float, float] = (0.0, 0.0)
) -> PadPose:
    """As ``pose_at``, tilted so that the pad comes near the middle, as a pan-tilt mount does, and off by a little."""
    flat = pose_at(height_m, away_m, heading_rad)
    sight = flat.pad_in_camera_m / np.linalg.norm(flat.pad_in_camera_m)
    axis = np.cross(sight, (0.0, 0.0, 1.0))
    angle = math.atan2(float(np.linalg.norm(axis)), float(sight[2]))
    unit = axis / max(float(np.linalg.norm(axis)), 1e-12)
    turn = matrix_from_euler(*off_rad, 0.0) @ np.asarray(cv2.Rodrigues(unit * angle)[0], np.float64)
    return PadPose(turn @ flat.camera_from_pad, turn @ flat.pad_in_camera_m)


def circle_scene(ground: Image, camera: Camera, pad: CirclePad) -> PadScene:
    """The usual scene: one pad as described."""
    return PadScene(ground, camera, pad)
