"""The estimator's stages, each alone on one thread."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from benchmarks.budget import Measurement, percentile
from benchmarks.pad_scenes import HD, VGA, Look, circle_scene, ground_of, looking_at_pad
from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.initialise import FirstEstimate, InitialGuess, aligned
from estimator.filters.nominal import Layout
from estimator.filters.point_mass import PointMassConfig, PointMassFilter
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.camera import Camera
from estimator.landing.detector import detect_circles
from estimator.landing.pad import circle_pad
from estimator.landing.pose import TiltPrior
from estimator.navigator import GROUPS
from estimator.odometry.tracker import CornerTracker
from estimator.registration.channels import double_angle_gradients
from estimator.registration.correlation import SearchArea


@dataclass(frozen=True, slots=True)
class Stage:
    """One timed stage: its name, the budget in milliseconds, the call, how often to call it."""

    name: str
    limit_ms: float
    call: Callable[[], object]
    repeats: int


def _texture(rows: int, cols: int) -> np.ndarray:
    rng = np.random.default_rng(7)
    noise = cv2.GaussianBlur(rng.normal(size=(rows, cols)), (0, 0), 3.0)
    return np.asarray(cv2.normalize(noise, np.empty_like(noise), 0, 255, cv2.NORM_MINMAX), dtype=np.uint8)


def _filter() -> ErrorStateFilter:
    layout, noise = Layout.of(GROUPS), ProcessNoise()
    motion = Motion(np.array([0.0, 0.0, -100.0]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    first = FirstEstimate(motion, np.ones(3), np.ones(3), 0.0, 1.0)
    nominal, P = aligned(first, layout, InitialGuess(), noise)
    return ErrorStateFilter(nominal, P, layout, EarthModel.at(1.0, 100.0), noise)


def _stages() -> list[Stage]:
    picture = _texture(480, 640)
    moved = np.roll(picture, (3, 5), axis=(0, 1))
    tracker = CornerTracker(Camera.from_hfov(640, 480, 1.0))
    pair = [picture, moved]

    def odometry() -> None:
        pair.reverse()
        tracker.track(pair[0])

    area = double_angle_gradients(_texture(192, 192))
    template = double_angle_gradients(_texture(128, 128))
    known, mask = np.ones((192, 192), dtype=bool), np.ones((128, 128), dtype=bool)

    def registration() -> None:
        search = SearchArea(area, known, (128, 128))
        for _ in range(7):
            search.correlate(template, mask)

    config = PointMassConfig(cell_m=0.5, min_half_extent_m=100.0)
    likelihood = np.random.default_rng(3).random((400, 400)) + 0.1

    grid = PointMassFilter(np.zeros(2), np.eye(2) * 900.0, config)

    def point_mass() -> None:
        grid.predict(np.array([1.0, 0.5]), np.eye(2) * 0.3)
        grid.update(likelihood, 100.0, -100.0)

    eskf = _filter()
    rate, force = np.array([0.01, 0.0, 0.02]), np.array([0.0, 0.0, -9.8])
    H, R = eskf.layout.jacobian(3, position=np.eye(3)), np.eye(3)
    return [
        *_pad_stages(),
        Stage("visual odometry, 640x480", 15.0, odometry, 100),
        Stage("registration, 7 hypotheses, 128 px", 25.0, registration, 40),
        Stage("point-mass filter, 400 x 400", 3.0, point_mass, 100),
        Stage("inertial filter, predict", 0.05, lambda: eskf.predict_inertial(rate, force, 0.02), 2000),
        Stage("inertial filter, update", 0.1, lambda: eskf.update(np.zeros(3), H, R), 2000),
    ]


def _pad_stages() -> list[Stage]:
    """A pad from 15 m that is followed, foreseen to some pixels as a filter has it, and one that is found."""
    pad, ground = circle_pad("bench", 1.5, 0.3), ground_of(9)
    stages = []
    for camera in (VGA, HD):
        pose = looking_at_pad(15.0, (0.5, -0.3), 0.4, (0.02, -0.01))
        picture = circle_scene(ground, camera, pad).render(pose, Look(jpeg=80), np.random.default_rng(9))
        prior = TiltPrior(pose.camera_from_pad[:, 2], math.radians(0.3))
        near = pose.moved(np.array((0.001, -0.001, 0.002, 0.03, -0.03, 0.05)))
        size = f"{camera.width_px}x{camera.height_px}"
        for name, expected in (("followed", near), ("found", None)):
            call = partial(detect_circles, picture, camera, pad, prior, expected)
            stages.append(Stage(f"landing pad {name}, {size}", 15.0, call, 40))
    return stages


def measure_stages(short: bool) -> list[Measurement]:
    """Median time of each stage; ``short`` takes a tenth of the repetitions."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return [_measured(stage, max(10, stage.repeats // 10) if short else stage.repeats) for stage in _stages()]
    finally:
        cv2.setNumThreads(threads)


def _measured(stage: Stage, repeats: int) -> Measurement:
    stage.call()
    times_ms = []
    for _ in range(repeats):
        started = time.perf_counter()
        stage.call()
        times_ms.append((time.perf_counter() - started) * 1e3)
    note = f"p95 {percentile(times_ms, 0.95):.3g} ms of {repeats}"
    return Measurement(stage.name, statistics.median(times_ms), "ms", stage.limit_ms, note=note)
