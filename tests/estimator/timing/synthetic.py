"""Synthetic turns: one smooth motion seen by a camera and by rate sensors, with an offset between their clocks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from estimator.geometry.camera import Mount
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.timing.offset import PictureTurns
from estimator.timing.turns import TurnTrack

NADIR = Mount().body_from_camera


@dataclass(frozen=True)
class Motion:
    """Rates of a motion (3,), one sigma, how fast they change, and the sensors' noise."""

    rate_std_rad_s: tuple[float, float, float] = (0.1, 0.08, 0.1)
    time_constant_s: float = 0.3
    length_s: float = 30.0
    frames_per_s: float = 12.5
    picture_noise_rad_s: tuple[float, float, float] = (4e-3, 4e-3, 2e-3)
    picture_noise_correlation: float = 0.0
    sensor_hz: float = 50.0
    sensor_noise_rad_s: float = 0.003


def smooth_rates(rng: np.random.Generator, motion: Motion) -> CubicSpline:
    """Rates of noise through two low-pass filters, over the motion's length and 4 s about it."""
    step_s = 0.005
    t_s = np.arange(-4.0, motion.length_s + 4.0, step_s)
    keep = math.exp(-step_s / motion.time_constant_s)
    rates = rng.normal(size=(len(t_s), 3))
    for _ in range(2):
        rates = lfilter([1.0 - keep], [1.0, -keep], rates, axis=0)
    return CubicSpline(t_s, rates / rates.std(axis=0) * motion.rate_std_rad_s)


def turns_and_sensor(
    seed: int, motion: Motion, offset_s: float, boresight_rad: np.ndarray, rates: CubicSpline | None = None
) -> tuple[PictureTurns, np.ndarray, np.ndarray]:
    """What the camera saw by frame times, and the rate sensor's times and readings."""
    rng = np.random.default_rng(seed)
    truth = smooth_rates(rng, motion) if rates is None else rates
    angle = truth.antiderivative()
    frame_s = np.arange(0.0, motion.length_s, 1.0 / motion.frames_per_s)
    first, second = frame_s[:-1], frame_s[1:]
    noise = rng.normal(size=(len(first), 3))
    share = motion.picture_noise_correlation
    for index in range(1, len(noise)):
        noise[index] = share * noise[index - 1] + math.sqrt(1.0 - share**2) * noise[index]
    std_rad = np.array(motion.picture_noise_rad_s) / motion.frames_per_s
    body_from_camera = matrix_from_q(q_from_rotvec(boresight_rad)) @ NADIR
    rotvec = (angle(second + offset_s) - angle(first + offset_s)) @ body_from_camera + noise * std_rad
    turns = PictureTurns(first, second, rotvec, np.tile(np.diag(std_rad**2), (len(first), 1, 1)))
    sensor_s = np.arange(-3.5, motion.length_s + 3.5, 1.0 / motion.sensor_hz)
    bias = rng.uniform(-0.005, 0.005, 3)
    return turns, sensor_s, truth(sensor_s) + bias + motion.sensor_noise_rad_s * rng.normal(size=(len(sensor_s), 3))


def turns_and_track(
    seed: int, motion: Motion, offset_s: float, boresight_rad: np.ndarray, rates: CubicSpline | None = None
) -> tuple[PictureTurns, TurnTrack]:
    """What the camera saw, and the track of the rate sensor."""
    turns, sensor_s, readings = turns_and_sensor(seed, motion, offset_s, boresight_rad, rates)
    track = TurnTrack.from_rates(sensor_s, readings, max_gap_s=0.5)
    assert track is not None
    return turns, track
