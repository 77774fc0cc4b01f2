"""Single pictures of simulated worlds for registration studies: camera, telemetry with its errors, targets, map.

The camera flies at 70 m over roads, houses and fields, in turn; the map is of another season and sensor. Pictures are a
clean sensor's, or like those of a small analogue transmitter: two fields a fiftieth of a second apart, a narrow band,
noise, lines out of step and lost.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from estimator.geometry.camera import GIMBAL_FROM_CAMERA, Camera
from estimator.geometry.ground import intersect_terrain
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_euler
from estimator.registration.alignment import CameraPose
from estimator.types import Float, Image
from geodata.elevation import ElevationGrid
from geodata.imagery import ImageryGrid, ReferenceImagery
from simulator.random_streams import rng_for
from simulator.sensors.camera import CameraView
from simulator.world.settle import base_layout, later_layout
from simulator.world.world import World, WorldSpec, world_for

HALF_SIZE_M, MARGIN_M = 360.0, 110.0
AGL_M, SPEED_M_S, FIELD_S = 70.0, 19.0, 0.02
WIDTH_PX, HEIGHT_PX, HFOV_DEG = 720, 576, 53.0
POSITION_STD_M, HEIGHT_STD_M, TILT_STD_RAD = 3.0, 2.0, math.radians(2.0)
TILT_TRUE_RAD = math.radians(3.0)
HEADING_MAX_RAD = math.radians(45.0)
FIELD_AWAY_M = 15.0
"""So far at least are roads and buildings from below the camera over a field; its picture may show them at the rim."""
TARGET_SHARE = 0.7
"""Targets lie in so much of the picture's width and height."""


class Video(StrEnum):
    """What the sensor and the link do to a picture."""

    CLEAN = "clean"
    ANALOGUE = "analogue"


class Ground(StrEnum):
    """What lies under the camera."""

    ROAD = "road"
    HOUSES = "houses"
    FIELD = "field"


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A world's map and ground in its frame."""

    frame: LocalFrame
    reference: ImageryGrid
    elevation: ElevationGrid
    world: World


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One picture (rows, cols), grey, with what telemetry has of its pose and the truth.

    ``cov_pose`` (6, 6) is of the telemetry's error: position NED, rotation about NED axes. ``uv_px`` is the target's
    pixel and ``target_ne_m`` (2,) where it stands. ``turn_rad`` is what the telemetry's heading lacks.
    """

    ground: Ground
    image: Image
    camera: Camera
    told: CameraPose
    cov_pose: Float
    turn_rad: float
    uv_px: tuple[float, float]
    target_ne_m: Float


def open_place(seed: int, cache: Path | None = None) -> Place:
    """The world of a seed with its map at 0.5 m a pixel."""
    spec = WorldSpec(seed, half_size_m=HALF_SIZE_M)
    world = world_for(spec, cache)
    with tempfile.TemporaryDirectory() as folder:
        imagery_path, elevation_path = Path(folder) / "map.tif", Path(folder) / "dem.tif"
        world.reference.write(imagery_path)
        world.elevation.write(elevation_path)
        imagery = ReferenceImagery.open(imagery_path)
        try:
            grid = imagery.grid(world.frame)
        finally:
            imagery.close()
        elevation = ElevationGrid.open(elevation_path, world.frame)
    return Place(world.frame, grid, elevation, world)


def shots(
    place: Place, seed: int, count: int, video: Video, heading_max_rad: float = HEADING_MAX_RAD
) -> Iterator[Shot]:
    """Pictures over roads, houses and fields in turn; the same for the same seed and video."""
    camera = Camera.from_hfov(WIDTH_PX, HEIGHT_PX, math.radians(HFOV_DEG))
    view = CameraView(place.world, camera, seed)
    for number in range(count):
        ground = list(Ground)[number % len(Ground)]
        rng = rng_for(seed, "contour", str(number))
        yield _shot(place, view, camera, ground, video, heading_max_rad, rng)


def _shot(
    place: Place, view: CameraView, camera: Camera, ground: Ground, video: Video, heading_max_rad: float,
    rng: np.random.Generator,
) -> Shot:  # fmt: skip
    above = _spot(place.world, ground, rng)
    down = float(place.world.ground_down_m(above[0:1], above[1:2])[0]) - AGL_M
    heading = rng.uniform(0.0, 2.0 * math.pi)
    roll, pitch = rng.normal(0.0, TILT_TRUE_RAD, 2)
    position = np.array([*above, down])
    true = CameraPose(position, _rotation(roll, pitch, heading))
    turn_rad = float(rng.uniform(-heading_max_rad, heading_max_rad))
    tilt = rng.normal(0.0, TILT_STD_RAD, 2)
    error = np.array([*rng.normal(0.0, POSITION_STD_M, 2), rng.normal(0.0, HEIGHT_STD_M)])
    told = CameraPose(position - error, _rotation(roll - tilt[0], pitch - tilt[1], heading - turn_rad))
    std = np.array([POSITION_STD_M] * 2 + [HEIGHT_STD_M] + [TILT_STD_RAD] * 2 + [heading_max_rad / math.sqrt(3.0)])
    uv, target = _target(place.world, camera, true, rng)
    image = grey(view.render(true.pos_ned_m, true.ned_from_camera))
    if video is Video.ANALOGUE:
        moved = position + SPEED_M_S * FIELD_S * np.array([math.cos(heading), math.sin(heading), 0.0])
        image = analogue(image, grey(view.render(moved, true.ned_from_camera)), rng)
    return Shot(ground, image, camera, told, np.diag(std**2), turn_rad, uv, target)


def analogue(first: Image, second: Image, rng: np.random.Generator) -> Image:
    """A picture (rows, cols) as a frame grabber has it from a weak analogue link, of two fields' pictures.

    Even lines are of the first field, odd ones of the second. The band passes some 300 of the 720 columns; noise is
    correlated along the line as in that band, every line starts a little early or late, and a few are lost to noise.
    """
    woven = first.astype(np.float32)
    woven[1::2] = second[1::2]
    rows, cols = woven.shape
    start = np.asarray(rng.normal(0.0, 0.8, rows), dtype=np.float32)
    col = np.arange(cols, dtype=np.float32)[None] + start[:, None]
    row = np.repeat(np.arange(rows, dtype=np.float32)[:, None], cols, axis=1)
    late = cv2.remap(woven, col, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    band = cv2.GaussianBlur(late, (0, 0), sigmaX=1.6, sigmaY=1e-3)
    noise = cv2.GaussianBlur(rng.normal(0.0, 1.0, (rows, cols)).astype(np.float32), (0, 0), sigmaX=0.9, sigmaY=1e-3)
    snowy = 0.8 * (band - 118.0) + 118.0 + 24.0 * noise / float(noise.std())
    lost = np.flatnonzero(rng.random(rows) < 0.015)
    snowy[lost] = rng.uniform(0.0, 255.0, (len(lost), cols))
    return np.clip(np.round(snowy), 0, 255).astype(np.uint8)


def grey(picture_bgr: Image) -> Image:
    """Grey (rows, cols) of a colour picture."""
    return np.asarray(cv2.cvtColor(picture_bgr, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def _rotation(roll_rad: float, pitch_rad: float, heading_rad: float) -> Float:
    """A gimbal that looks down, but for its errors, its picture's top to the heading."""
    tilted = matrix_from_euler(roll_rad, pitch_rad, heading_rad) @ matrix_from_euler(0.0, -math.pi / 2.0, 0.0)
    return np.asarray(tilted @ GIMBAL_FROM_CAMERA, dtype=np.float64)


def _spot(world: World, ground: Ground, rng: np.random.Generator) -> Float:
    """Somewhere (2,) inside the map over this kind of ground, or anywhere there where the world has none."""
    spec = world.spec
    layout = later_layout(base_layout(spec.seed, spec.half_size_m), spec.seed, spec.changed_share)
    reach = spec.half_size_m - MARGIN_M
    built = np.array([b.centre_ne_m for b in layout.buildings]).reshape(-1, 2)
    roads = np.concatenate([w.line_ne_m for w in layout.ways] or [np.zeros((0, 2))])
    near = np.array([15.0, 15.0])
    if ground is Ground.FIELD:
        tried = rng.uniform(-reach, reach, (400, 2))
        things = np.concatenate((built, roads))
        away = np.min(np.linalg.norm(tried[:, None] - things[None], axis=-1), axis=1, initial=np.inf)
        spots = tried[away > FIELD_AWAY_M]
    else:
        spots = (built if ground is Ground.HOUSES else roads) + rng.uniform(-near, near)
        spots = spots[(np.abs(spots) < reach).all(axis=1)]
    if not len(spots):
        return rng.uniform(-reach, reach, 2)
    return np.asarray(spots[int(rng.integers(len(spots)))], dtype=np.float64)


def _target(
    world: World, camera: Camera, pose: CameraPose, rng: np.random.Generator
) -> tuple[tuple[float, float], Float]:
    """A pixel that shows bare ground, and where that lies (2,): nothing raised within three metres of it."""
    half = 0.5 * TARGET_SHARE * np.array([camera.width_px, camera.height_px])
    middle = 0.5 * np.array([camera.width_px - 1, camera.height_px - 1])
    reach_px = math.ceil(3.0 / world.raised_patch.gsd_m)
    for _ in range(200):
        uv = middle + rng.uniform(-half, half)
        ray = pose.ned_from_camera @ camera.rays(uv[None])[0]
        point = intersect_terrain(pose.pos_ned_m, ray, world.ground_down_m)
        patch = world.raised_patch
        row = round((patch.north_max_m - point[0]) / patch.gsd_m)
        col = round((point[1] - patch.east_min_m) / patch.gsd_m)
        if not world.raised[row - reach_px : row + reach_px + 1, col - reach_px : col + reach_px + 1].any():
            break
    return (float(uv[0]), float(uv[1])), np.asarray(point[:2], dtype=np.float64)
