"""Simulated descents onto a pad, with everything the estimator is given and the truth beside it.

A helicopter in wind, flown by its true place: some seconds of manoeuvres 15 m above the pad, down to 0.6 m, and a hover
there while the camera shows nothing. Inertial unit, barometer, autopilot's attitude and receiver are the simulator's;
the camera looks straight down and is mounted some tenths of a degree off what the estimator is told. The receiver is
silent after three seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.pad_scenes import Look, PadScene, compressed
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.earth import isa_pressure_alt_m
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_euler, matrix_from_q, q_from_rotvec
from estimator.landing.pad import CirclePad
from estimator.landing.pose import PadPose
from estimator.types import (
    AttitudeSample,
    BarometerSample,
    Float,
    FrameSample,
    GnssSample,
    Image,
    InertialSample,
    Sample,
)
from simulator.random_streams import rng_for
from simulator.scenario import SensorSection
from simulator.sensors.attitude_filter import AttitudeFilter
from simulator.sensors.barometer import Barometer
from simulator.sensors.gnss import GnssReceiver
from simulator.sensors.inertial import InertialUnit
from simulator.vehicles.helicopter import Helicopter
from simulator.vehicles.state import VehicleState

FRAME = LocalFrame(math.radians(47.0), math.radians(8.0), 250.0)
T0_US = 1_760_000_000_000_000
STEP_US = 5_000
MOUNT = Mount(0.0, -math.pi / 2, 0.0, np.array((0.12, 0.03, 0.08)))
MOUNT_STD_RAD = math.radians(0.5)
PAD_TILT_STD_RAD = math.radians(1.0)
HEIGHT_M, LOW_M = 15.0, 0.6
SATELLITES_S, MANOEUVRES_S, DESCENT_S, BLIND_S = 3.0, 12.0, 12.0, 5.2
LOW_S = MANOEUVRES_S + DESCENT_S
END_S = LOW_S + 0.5 + BLIND_S
"""Pictures end half a second after the descent has."""


@dataclass(frozen=True, slots=True, eq=False)
class PadFlight:
    """A descent: samples in order of time without and with pictures, states of the truth, and where the pad lies.

    ``last_seen_us`` is the time of the last picture that shows anything. ``body_from_camera`` is the mount as it is.
    """

    samples: list[Sample]
    frames: list[FrameSample]
    truth: list[VehicleState]
    pad_ned_m: Float
    ned_from_pad: Float
    body_from_camera: Float
    last_seen_us: int

    def state_at(self, t_us: int) -> VehicleState:
        """The truth at a time that is a multiple of the step."""
        return self.truth[(t_us - T0_US) // STEP_US - 1]

    def pose_at(self, t_us: int) -> PadPose:
        """How the camera sees the pad at a time."""
        return _pose(self.state_at(t_us), self.pad_ned_m, self.ned_from_pad, self.body_from_camera)


def fly(seed: int, ground: Image, camera: Camera, pad: CirclePad, rate_hz: int = 20, kbit_s: int = 1500) -> PadFlight:
    """The descent of a seed over a ground, its pictures as H.264 at a bit rate sends them."""
    rng = rng_for(seed, "pad flight")
    pad_ned_m = rng.normal(0.0, 20.0, 3) * (1.0, 1.0, 0.05)
    roll, pitch = rng.normal(0.0, PAD_TILT_STD_RAD, 2)
    ned_from_pad = matrix_from_euler(roll, pitch, rng.uniform(0.0, 2.0 * math.pi))
    body_from_camera = matrix_from_q(q_from_rotvec(rng.normal(0.0, MOUNT_STD_RAD, 3))) @ MOUNT.body_from_camera
    truth = flown(seed, pad_ned_m, rng)
    last_us = T0_US + round((LOW_S + 0.5) * 1e6)
    every_us = round(1e6 / rate_hz)
    look = Look(motion_px=float(rng.uniform(0.0, 1.5)), motion_rad=float(rng.uniform(0.0, math.pi)))
    scene = PadScene(ground, camera, pad, corner_px=tuple(rng.uniform(0.2, 0.8, 2) * ground.shape))
    blind = np.zeros((camera.height_px, camera.width_px), np.uint8)
    times, pictures = [], []
    for state in truth:
        if state.t_us % every_us:
            continue
        pose = _pose(state, pad_ned_m, ned_from_pad, body_from_camera)
        shows = T0_US + state.t_us <= last_us
        pictures.append(scene.render(pose, look, rng) if shows else blind + rng.integers(0, 3, blind.shape, np.uint8))
        times.append(T0_US + state.t_us)
    pictures = compressed(pictures, kbit_s, rate_hz)
    frames = [FrameSample(t_us, number, each) for number, (t_us, each) in enumerate(zip(times, pictures, strict=True))]
    return PadFlight(
        list(sensed(seed, truth)), frames, truth, pad_ned_m, ned_from_pad, body_from_camera,
        last_us,
    )  # fmt: skip


def _pose(state: VehicleState, pad_ned_m: Float, ned_from_pad: Float, body_from_camera: Float) -> PadPose:
    ned_from_body = matrix_from_q(state.q_ned_from_body)
    camera_from_ned = (ned_from_body @ body_from_camera).T
    lens = state.pos_ned_m + ned_from_body @ MOUNT.lever_arm_frd_m
    return PadPose(camera_from_ned @ ned_from_pad, camera_from_ned @ (pad_ned_m - lens))


def flown(seed: int, pad_ned_m: Float, rng: np.random.Generator) -> list[VehicleState]:
    """The truth in steps; it follows points beside the pad, then comes down over its centre."""
    heading = float(rng.uniform(-math.pi, math.pi))
    beside = np.column_stack((rng.uniform(-2.0, 2.0, (4, 2)), rng.uniform(-1.0, 1.0, 4)))
    start: Float = pad_ned_m + np.array((*beside[0, :2], -HEIGHT_M))
    helicopter = Helicopter(FRAME, start, heading, seed, float(rng.uniform(0.0, 4.0)), 1.0)
    pos = start
    truth = []
    for step in range(1, round(END_S * 1e6) // STEP_US + 1):
        t_s = step * STEP_US / 1e6
        wanted = _wanted(t_s, beside)
        away = pad_ned_m + wanted - pos
        command = np.clip(0.9 * away, -1.5, 1.5)
        state = helicopter.step(step * STEP_US, STEP_US / 1e6, command, heading + 0.3 * math.sin(0.3 * t_s))
        pos = state.pos_ned_m
        truth.append(state)
    return truth


def _wanted(t_s: float, beside: Float) -> Float:
    """Where the helicopter is to be (3,) relative to the pad."""
    if t_s < MANOEUVRES_S:
        point: Float = beside[int(t_s / MANOEUVRES_S * len(beside))] - (0.0, 0.0, HEIGHT_M)
        return point
    part = min((t_s - MANOEUVRES_S) / (DESCENT_S - 1.0), 1.0)
    height_m = HEIGHT_M + (LOW_M - HEIGHT_M) * part
    above: Float = beside[-1] * (1.0, 1.0, 0.0) * max(1.0 - 2.0 * part, 0.0) - (0.0, 0.0, height_m)
    return above


def sensed(seed: int, truth: list[VehicleState]) -> list[Sample]:
    """What the sensors say at the simulator's rates."""
    sensors = SensorSection()
    unit, barometer = InertialUnit(seed, sensors), Barometer(seed, sensors)
    attitude, receiver = AttitudeFilter(seed, sensors), GnssReceiver(seed, sensors)
    samples: list[Sample] = []
    for step, state in enumerate(truth, 1):
        t_us = T0_US + state.t_us
        unit.sample(state.rate_body_rad_s, state.specific_force_body_m_s2, STEP_US / 1e6)
        if step % 4 == 0:
            samples.append(InertialSample(t_us, *unit.report()))
        if step % 8 == 0:
            q = attitude.step(state.q_ned_from_body, 8 * STEP_US / 1e6)
            samples.append(AttitudeSample(t_us, q, state.rate_body_rad_s))
        if step % 20 == 0:
            alt_m = float(FRAME.geodetic_from_ned(state.pos_ned_m)[2])
            pressure = barometer.pressure_pa(alt_m, 20 * STEP_US / 1e6)
            samples.append(BarometerSample(t_us, float(isa_pressure_alt_m(pressure))))
        if step % 40 == 0 and state.t_us <= SATELLITES_S * 1e6:
            samples.append(_fix(t_us, receiver, state))
    return samples


def _fix(t_us: int, receiver: GnssReceiver, state: VehicleState) -> GnssSample:
    fix = receiver.measure(state, 40 * STEP_US / 1e6)
    lat, lon, alt = FRAME.geodetic_from_ned(fix.pos_ned_m)
    return GnssSample(t_us, float(lat), float(lon), float(alt), fix.vel_ned_m_s, 1.0, 2.0, 12)
