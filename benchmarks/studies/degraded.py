"""What is made bad between the recording and the estimator: pictures, map, camera, barometer, clocks.

The flights are the ladder's, so nothing is flown again. Faults of the pictures and of the barometer hold for a stretch
without GPS, so that what comes after shows the recovery; those of map and camera for the whole flight, with GPS and
without.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from backend.navigation.setup import NavigationSetup
from backend.video.frames import EncodedFrame, VideoStatus
from backend.video.monitor import VideoMonitor
from estimator.geometry.camera import Mount
from estimator.geometry.rotation import euler_from_q, q_from_euler, q_from_rotvec, q_multiply
from estimator.types import AttitudeSample, BarometerSample, Float, FrameSample, Image, Sample
from geodata.imagery import ImageryGrid

ONSET_S = 3.0
"""Fog, glare and night come and go over so long."""
FOG_GREY, FOG_CONTRAST = 185.0, 0.05
GLARE_CENTRE, GLARE_RADIUS, GLARE_PEAK, GLARE_VEIL = (0.6, 0.4), 0.3, 900.0, 0.5
NIGHT_GAIN, NIGHT_BLACK = 0.04, 6.0
READ_NOISE = 3.0
SHIFT_M = 20.0
TURN_DEG = 5.0
CHANGED_SHARE, CHANGED_PATCH_M = 0.4, 40.0
WATER_SHARE, WATER_PATCH_M = 0.5, 150.0
WATER_GREY, WAVE_GREY = 70.0, 2.0


class PictureFault(StrEnum):
    """What is wrong with the pictures of a stretch."""

    FOG = "fog"
    GLARE = "glare"
    NIGHT = "night"
    FROZEN = "frozen"


class MapFault(StrEnum):
    """What is wrong with the map."""

    ELSEWHERE = "elsewhere"
    TURNED = "turned"
    SHIFTED = "shifted"
    CHANGED = "changed"
    WATER = "water"


@dataclass(frozen=True, slots=True)
class Degradation:
    """What the estimator is given instead of what was recorded; the defaults change nothing.

    ``stretch_s`` counts from the first moment without GPS and is for ``picture`` and ``barometer_drift_m``, which is
    reached at the stretch's end and stays. ``frames_late_s`` is added to the frame times, ``boresight_deg`` turns the
    stated mount about the body's axes, ``attitude_hz`` thins the autopilot's attitude.
    """

    stretch_s: tuple[float, float] = (0.0, math.inf)
    picture: PictureFault | None = None
    map: MapFault | None = None
    focal_factor: float = 1.0
    barometer_drift_m: float = 0.0
    attitude_hz: float = math.inf
    frames_late_s: float = 0.0
    boresight_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    map_gsd_m: float | None = None


class Degrader:
    """Puts a degradation between a recorded flight and the estimator; ``seed`` draws its noise."""

    def __init__(self, degradation: Degradation, denied_us: int, seed: int) -> None:
        self._what = degradation
        self._denied_us = denied_us
        self._rng = np.random.default_rng([seed, 4711])
        self._held: Image | None = None
        self._attitude_us = -(10**15)
        self._monitor = VideoMonitor()
        self._frozen: list[tuple[int, bool]] = []

    def setup(self, setup: NavigationSetup) -> NavigationSetup:
        """Camera, mount and map as the estimator is told they are."""
        what = self._what
        camera = replace(
            setup.camera, fx_px=setup.camera.fx_px * what.focal_factor, fy_px=setup.camera.fy_px * what.focal_factor
        )
        mount = turned_mount(setup.mount, what.boresight_deg)
        reference = setup.reference
        if isinstance(reference, ImageryGrid):
            if what.map is not None:
                reference = degraded_map(reference, what.map, self._rng)
            if what.map_gsd_m is not None:
                reference = coarser(reference, what.map_gsd_m)
        return replace(setup, camera=camera, mount=mount, reference=reference)

    def sample(self, sample: Sample) -> Sample | None:
        """A sample as the estimator gets it, None where it does not."""
        since_s = (sample.t_us - self._denied_us) / 1e6
        match sample:
            case FrameSample() if sample.image.size:
                image = self._picture(sample.image, since_s)
                self._watch(image, sample.t_us)
                return replace(sample, t_us=sample.t_us + round(self._what.frames_late_s * 1e6), image=image)
            case BarometerSample() if self._what.barometer_drift_m:
                start_s, end_s = self._what.stretch_s
                share = float(np.clip((since_s - start_s) / (end_s - start_s), 0.0, 1.0))
                drifted_m = sample.pressure_alt_m + share * self._what.barometer_drift_m
                return replace(sample, pressure_alt_m=drifted_m)
            case AttitudeSample():
                # half a period of a fast stream is no reason to skip one more
                if sample.t_us - self._attitude_us < 0.95e6 / self._what.attitude_hz:
                    return None
                self._attitude_us = sample.t_us
        return sample

    def frozen_at(self, t_us: Float) -> NDArray[np.bool_]:
        """Whether the station called the video frozen at times (n,)."""
        if not self._frozen:
            return np.zeros(len(t_us), dtype=np.bool_)
        times, frozen = (np.array(column) for column in zip(*self._frozen, strict=True))
        return np.asarray(frozen[np.maximum(np.searchsorted(times, t_us, side="right") - 1, 0)], dtype=np.bool_)

    def _watch(self, image: Image, t_us: int) -> None:
        """As the station watches its video: the same monitor, a picture a frame."""
        rows, cols = image.shape[:2]
        self._monitor.arrived(EncodedFrame(0, 0, t_us, t_us, "h264", "", True, cols, rows, b""), t_us)
        self._monitor.decoded(image, t_us, t_us)
        status = self._monitor.health(t_us, "", 0, 0).status
        self._frozen.append((t_us, status is VideoStatus.FROZEN))

    def _picture(self, image: Image, since_s: float) -> Image:
        fault = self._what.picture
        depth = _depth(since_s, self._what.stretch_s)
        if fault is None or depth == 0.0:
            self._held = None
            return image
        if fault is PictureFault.FROZEN:
            self._held = image if self._held is None else self._held
            return self._held
        return degraded_picture(image, fault, depth, self._rng)


def turned_mount(mount: Mount, about_deg: tuple[float, float, float]) -> Mount:
    """The mount turned about the body's axes, forward, right and down."""
    if not any(about_deg):
        return mount
    turn = q_from_rotvec(np.radians(np.array(about_deg)))
    stated = q_from_euler(mount.roll_rad, mount.pitch_rad, mount.yaw_rad)
    roll, pitch, yaw = (float(angle) for angle in euler_from_q(q_multiply(turn, stated)))
    return replace(mount, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)


def _depth(since_s: float, stretch_s: tuple[float, float]) -> float:
    """How far a fault has come, 0 outside its stretch and 1 within but for its onset and end."""
    start_s, end_s = stretch_s
    return float(np.clip(min(since_s - start_s, end_s - since_s) / ONSET_S, 0.0, 1.0))


def degraded_picture(image: Image, fault: PictureFault, depth: float, rng: np.random.Generator) -> Image:
    """A picture (rows, cols) or (rows, cols, 3) through fog, with the sun in it, or by night.

    ``depth`` in [0, 1] is how far the fault has come. Light is lost before the sensor, so the sensor's noise stays.
    """
    light = image.astype(np.float32)
    match fault:
        case PictureFault.FOG:
            kept = FOG_CONTRAST**depth
            light = FOG_GREY + (light - FOG_GREY) * kept
        case PictureFault.GLARE:
            rows, cols = image.shape[:2]
            y, x = np.mgrid[0:rows, 0:cols].astype(np.float32)
            away = np.hypot(x - GLARE_CENTRE[0] * cols, y - GLARE_CENTRE[1] * rows) / (GLARE_RADIUS * cols)
            bloom = GLARE_PEAK * np.exp(-2.0 * away) * depth
            light = light * (1.0 - GLARE_VEIL * depth) + (bloom if image.ndim == 2 else bloom[..., None])
        case PictureFault.NIGHT:
            kept = NIGHT_GAIN**depth
            light = NIGHT_BLACK * depth + light * kept
        case PictureFault.FROZEN:
            return image
    noise = rng.normal(0.0, READ_NOISE * depth, image.shape).astype(np.float32)
    return np.asarray(np.clip(np.rint(light + noise), 0.0, 255.0), dtype=np.uint8)


def degraded_map(grid: ImageryGrid, fault: MapFault, rng: np.random.Generator) -> ImageryGrid:
    """A map that is wrong for the place, on the same grid but for the shifted one."""
    match fault:
        case MapFault.ELSEWHERE:
            image, valid = _elsewhere(grid)
        case MapFault.TURNED:
            image, valid = _turned(grid.image, TURN_DEG), _turned(grid.valid.astype(np.uint8), TURN_DEG) > 0
        case MapFault.SHIFTED:
            side_m = SHIFT_M / math.sqrt(2.0)
            return replace(grid, north_max_m=grid.north_max_m + side_m, east_min_m=grid.east_min_m + side_m)
        case MapFault.CHANGED:
            other, known = _elsewhere(grid)
            where = _patches(grid, CHANGED_PATCH_M, CHANGED_SHARE, rng)
            image, valid = np.where(where, other, grid.image), np.where(where, known, grid.valid)
        case MapFault.WATER:
            where = _patches(grid, WATER_PATCH_M, WATER_SHARE, rng)
            image, valid = np.where(where, _water(grid, rng), grid.image), grid.valid
    return replace(grid, image=np.asarray(image, dtype=np.uint8), valid=np.asarray(valid, dtype=np.bool_))


def coarser(grid: ImageryGrid, gsd_m: float) -> ImageryGrid:
    """The same map with larger pixels, each the mean of what it covers."""
    ratio = gsd_m / grid.gsd_m
    rows, cols = (int(side / ratio) for side in grid.image.shape)
    covered = grid.image[: round(rows * ratio), : round(cols * ratio)]
    image = cv2.resize(covered, (cols, rows), interpolation=cv2.INTER_AREA)
    valid = cv2.resize(grid.valid[: covered.shape[0], : covered.shape[1]].astype(np.float32), (cols, rows))
    # centres of the first pixels move inwards by half of what a pixel has grown
    inwards_m = 0.5 * (gsd_m - grid.gsd_m)
    return ImageryGrid(
        np.asarray(image, dtype=np.uint8), np.asarray(valid > 0.99), grid.north_max_m - inwards_m,
        grid.east_min_m + inwards_m, gsd_m,
    )  # fmt: skip


def _elsewhere(grid: ImageryGrid) -> tuple[Image, NDArray[np.bool_]]:
    """Land of the same kind that is not this: the map mirrored about its diagonal and moved by half its size."""
    rows, cols = grid.image.shape
    side = min(rows, cols)
    step = side // 2

    def moved(plane: Image) -> Image:
        other = np.roll(plane[:side, :side].T, (step, step), axis=(0, 1))
        padded = cv2.copyMakeBorder(np.ascontiguousarray(other), 0, rows - side, 0, cols - side, cv2.BORDER_REFLECT_101)
        return np.asarray(padded, dtype=np.uint8)

    return moved(grid.image), np.asarray(moved(grid.valid.astype(np.uint8)) > 0)


def _turned(plane: Image, degrees: float) -> Image:
    rows, cols = plane.shape
    about = cv2.getRotationMatrix2D(((cols - 1) / 2.0, (rows - 1) / 2.0), degrees, 1.0)
    return np.asarray(cv2.warpAffine(plane, about, (cols, rows), flags=cv2.INTER_LINEAR), dtype=np.uint8)


def _patches(grid: ImageryGrid, size_m: float, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Where (rows, cols) the map is to be something else: patches about ``size_m`` wide over a share of its area."""
    rows, cols = grid.image.shape
    coarse = max(1, round(size_m / grid.gsd_m / 4.0))
    noise = rng.standard_normal((rows // coarse + 2, cols // coarse + 2)).astype(np.float32)
    smooth = cv2.resize(cv2.GaussianBlur(noise, (0, 0), 2.0), (cols, rows), interpolation=cv2.INTER_CUBIC)
    return np.asarray(smooth > np.quantile(smooth, 1.0 - share))


def _water(grid: ImageryGrid, rng: np.random.Generator) -> Float:
    """Dark and featureless but for faint waves some metres long."""
    rows, cols = grid.image.shape
    waves = cv2.GaussianBlur(rng.standard_normal((rows, cols)).astype(np.float32), (0, 0), 1.5 / grid.gsd_m)
    return np.asarray(WATER_GREY + WAVE_GREY * waves / waves.std())
