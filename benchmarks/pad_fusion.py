"""``python -m benchmarks.pad_fusion``: how well the filter knows where it is from a landing pad, and without it.

Descents of ``benchmarks.pad_flights``, given to the Navigator as a station would: pictures come late, and what is held
against the truth is the state carried on to now, fifty times a second. Seeds fix worlds, flights and errors.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import track

from benchmarks.pad_flights import FRAME, LOW_S, MANOEUVRES_S, MOUNT, SATELLITES_S, T0_US, PadFlight, fly
from benchmarks.pad_scenes import HD, VGA, ground_of
from benchmarks.studies.cli import parse_seeds
from estimator.geometry.camera import GIMBAL_FROM_CAMERA, Camera, Mount
from estimator.geometry.rotation import euler_from_q, matrix_from_q, q_from_matrix, q_from_rotvec, rotvec_from_q
from estimator.landing.detector import detect_circles
from estimator.landing.pad import circle_pad
from estimator.landing.sighting import PadSighting
from estimator.measurements.pad_tracking import PadConfig
from estimator.navigator import Navigator, NavigatorConfig
from estimator.types import Float, NavigationState, PadMode
from geodata.elevation import FlatGround
from simulator.random_streams import rng_for

PAD = circle_pad("benchmark", 1.5, 0.3)
LATENCY_US, OUTPUT_US = 100_000, 20_000
SETTLED_S = SATELLITES_S + 2.0
GROUND_STD_M = 2.0
CALIBRATED_RAD = math.radians(0.1)
FLIP_RAD = math.radians(6.0)
VISION_ALONE_EVERY = 4


@dataclass(frozen=True, slots=True)
class Fused:
    """One descent, rms where nothing else is said.

    At 15 m: position down and on each axis across, length of the velocity's error, ``lag_ms`` by which it follows the
    truth, and the angle that camera and pad are turned by, fused and by single pictures. NEES of the relative position
    at 15 m and in the descent, and of the velocity (3 is right). Error of the relative position 1 s and 5 s after the
    last picture. Flips are planes more than six degrees off. ``followed`` is the share of pictures that were used.
    """

    seed: int
    down_m: float
    across_m: float
    vel_m_s: float
    lag_ms: float
    attitude_deg: float
    attitude_alone_deg: float
    nees_15m: float
    nees_descent: float
    nees_velocity: float
    blind_1s_m: float
    blind_5s_m: float
    flips: int
    flips_alone: int
    followed: float
    ms: float


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What the Navigator told: ``shown`` at each output time, ``fused`` after each picture; and how long one took."""

    shown: list[NavigationState]
    fused: list[NavigationState]
    ms: float


def measured_mount(seed: int, flight: PadFlight) -> Mount:
    """The mount as one who has measured it to ``CALIBRATED_RAD`` on each axis tells it."""
    off = matrix_from_q(q_from_rotvec(rng_for(seed, "measured mount").normal(0.0, CALIBRATED_RAD, 3)))
    roll, pitch, yaw = euler_from_q(q_from_matrix(off @ flight.body_from_camera @ GIMBAL_FROM_CAMERA.T))
    return Mount(float(roll), float(pitch), float(yaw), MOUNT.lever_arm_frd_m)


def estimated(
    flight: PadFlight, camera: Camera, config: NavigatorConfig, ground_off_m: float, mount: Mount = MOUNT
) -> Outcome:
    """Give a flight to a Navigator in the order in which a station gets it."""
    ground = FlatGround(FRAME.alt_m - float(flight.pad_ned_m[2]) + ground_off_m)
    navigator = Navigator(config, camera, mount, "fixed", FRAME, None, ground, pad=PAD)
    samples, frames = iter(flight.samples), iter(flight.frames)
    sample, frame = next(samples, None), next(frames, None)
    shown: list[NavigationState] = []
    fused: list[NavigationState] = []
    spent_s = 0.0
    for t_us in range(T0_US + OUTPUT_US, T0_US + flight.truth[-1].t_us, OUTPUT_US):
        while sample is not None and sample.t_us <= t_us:
            navigator.offer(sample)
            sample = next(samples, None)
        seen = False
        while frame is not None and frame.t_us <= t_us - LATENCY_US:
            navigator.offer(frame)
            frame, seen = next(frames, None), True
        started = time.process_time()
        navigator.advance(t_us - LATENCY_US)
        spent_s += time.process_time() - started
        now, then = navigator.predict(t_us), navigator.state
        if now is not None and then is not None:
            shown.append(now)
            fused += [then] if seen else []
    return Outcome(shown, fused, 1e3 * spent_s / len(flight.frames))


def measured(
    seed: int, flight: PadFlight, camera: Camera, config: NavigatorConfig, *, calibrated: bool = False
) -> Fused:
    """A flight estimated, and its errors; the mount is as said, or ``calibrated`` before."""
    off_m = float(rng_for(seed, "ground model").normal(0.0, GROUND_STD_M))
    mount = measured_mount(seed, flight) if calibrated else MOUNT
    if calibrated:
        config = replace(config, initial=replace(config.initial, boresight_std_rad=CALIBRATED_RAD))
    outcome = estimated(flight, camera, config, off_m, mount)
    high = [s for s in outcome.shown if SETTLED_S < _s(s) < MANOEUVRES_S]
    at_15m = [s for s in outcome.fused if SETTLED_S < _s(s) < MANOEUVRES_S]
    descent = [s for s in outcome.fused if _s(s) >= MANOEUVRES_S and s.t_us <= flight.last_seen_us]
    off = np.array([_off(flight, s) for s in high])
    vel = np.array([s.vel_ned_m_s - flight.state_at(s.t_us).vel_ned_m_s for s in high])
    turned = np.array([_turned_rad(flight, s) for s in at_15m])
    alone = list(_alone_rad(flight, camera, MANOEUVRES_S))
    alone_low = list(_alone_rad(flight, camera, LOW_S, MANOEUVRES_S))
    flips = [_turned_rad(flight, s) > FLIP_RAD for s in at_15m + descent]
    followed = [s.pad is not None and s.pad.age_s <= OUTPUT_US / 1e6 for s in at_15m + descent]
    nees = [float(np.nanmean([_nees(flight, s) for s in states])) for states in (at_15m, descent)]
    blind = [blind_m(flight, outcome.shown, after_s) for after_s in (1.0, 5.0)]
    return Fused(
        seed=seed, down_m=_rms(off[:, 2]), across_m=_rms(off[:, :2]), vel_m_s=_rms(np.linalg.norm(vel, axis=1)),
        lag_ms=1e3 * lag_s(flight, high, vel), attitude_deg=math.degrees(_rms(turned)),
        attitude_alone_deg=math.degrees(_rms(np.array(alone))), nees_15m=nees[0], nees_descent=nees[1],
        nees_velocity=float(np.mean([_nees_velocity(flight, s) for s in at_15m + descent])), blind_1s_m=blind[0],
        blind_5s_m=blind[1], flips=sum(flips), flips_alone=int(np.sum(np.array(alone + alone_low) > FLIP_RAD)),
        followed=float(np.mean(followed)), ms=outcome.ms,
    )  # fmt: skip


def _s(state: NavigationState) -> float:
    return (state.t_us - T0_US) / 1e6


def _off(flight: PadFlight, state: NavigationState) -> Float:
    """Error (3,) of the position relative to the pad."""
    if state.pad is None:
        return np.full(3, np.nan)
    off: Float = state.pad.pos_ned_m - (flight.state_at(state.t_us).pos_ned_m - flight.pad_ned_m)
    return off


def _nees(flight: PadFlight, state: NavigationState) -> float:
    off = _off(flight, state)
    return math.nan if state.pad is None else float(off @ np.linalg.solve(state.pad.cov_pos_ned_m2, off))


def _nees_velocity(flight: PadFlight, state: NavigationState) -> float:
    off = state.vel_ned_m_s - flight.state_at(state.t_us).vel_ned_m_s
    return float(off @ np.linalg.solve(state.cov_vel_ned_m2_s2, off))


def _turned_rad(flight: PadFlight, state: NavigationState) -> float:
    """By which angle camera and pad are turned otherwise than in truth; NaN before the pad is known."""
    if state.pad is None or state.pad.mode is PadMode.SEARCHING:
        return math.nan
    told = matrix_from_q(state.q_ned_from_camera).T @ matrix_from_q(state.pad.q_ned_from_pad)
    return _angle_rad(told, flight.pose_at(state.t_us).camera_from_pad)


def _angle_rad(one: Float, other: Float) -> float:
    return float(np.linalg.norm(rotvec_from_q(q_from_matrix(one @ other.T))))


def _alone_rad(flight: PadFlight, camera: Camera, until_s: float, from_s: float = SETTLED_S) -> Iterator[float]:
    """The same angle by single pictures of a span, with nothing known beside them."""
    for frame in flight.frames[::VISION_ALONE_EVERY]:
        if from_s < (frame.t_us - T0_US) / 1e6 < until_s:
            found = detect_circles(frame.image, camera, PAD)
            if isinstance(found, PadSighting):
                yield _angle_rad(found.best.pose.camera_from_pad, flight.pose_at(frame.t_us).camera_from_pad)


def lag_s(flight: PadFlight, states: Sequence[NavigationState], off: Float) -> float:
    """How late a velocity is whose error (n, 3) is ``off``: what of it is against the acceleration, least squares."""
    half_us = OUTPUT_US
    before, after = ([flight.state_at(s.t_us + by).vel_ned_m_s for s in states] for by in (-half_us, half_us))
    acceleration = (np.array(after) - np.array(before)) / (2e-6 * half_us)
    return -float(np.sum(off * acceleration) / np.sum(acceleration**2))


def blind_m(flight: PadFlight, states: Sequence[NavigationState], after_s: float) -> float:
    """Error of the relative position so long after the last picture."""
    t_us = flight.last_seen_us + round(after_s * 1e6)
    nearest = min(states, key=lambda state: abs(state.t_us - t_us))
    return float(np.linalg.norm(_off(flight, nearest)))


def _rms(values: Float) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def markdown(rows: Sequence[Fused]) -> str:
    """A table of the flights, their rms below, and their worst."""
    names = list(asdict(rows[0]))
    table = np.array([list(asdict(row).values()) for row in rows], dtype=np.float64)
    lines = ["| " + " | ".join(name.replace("_", " ") for name in names) + " |", "|" + "---|" * len(names)]
    lines += ["| " + " | ".join((f"{row[0]:.0f}", *(f"{v:.3g}" for v in row[1:]))) + " |" for row in table]
    mean = {name: np.mean if name.startswith(("nees", "lag", "followed", "ms")) else _rms for name in names}
    lines.append("| all | " + " | ".join(f"{mean[n](table[:, i]):.3g}" for i, n in enumerate(names) if i) + " |")
    worst = np.abs(table).max(axis=0)
    lines.append("| most | " + " | ".join(f"{v:.3g}" for v in worst[1:]) + " |")
    return "\n".join(lines) + "\n"


def main(
    seeds: Annotated[str, typer.Option(help="Flights, FIRST-LAST.")] = "404-408",
    hd: Annotated[bool, typer.Option("--hd", help="Pictures of 1280x720 instead of 640x480.")] = False,
    rate_hz: Annotated[int, typer.Option(min=5, max=50, help="Pictures a second; a divisor of 200.")] = 20,
    calibrated: Annotated[
        bool, typer.Option("--calibrated", help="The camera's mount is known to 0.1 degrees, not to 0.5.")
    ] = False,
    without_odometry: Annotated[
        bool, typer.Option(help="Compare no picture with the last while the pad is followed.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for pad-fusion.json.")] = None,
    cache: Annotated[Path | None, typer.Option(help="Folder that keeps the worlds.")] = None,
) -> None:
    """Measure position, velocity and attitude relative to the landing pad, fused, and what is left of them blind."""
    camera = HD if hd else VGA
    if 200 % rate_hz:
        raise typer.BadParameter(f"--rate-hz {rate_hz}: the simulated vehicle moves in steps of 5 ms; give a divisor")
    config = NavigatorConfig(pad=PadConfig(instead_of_odometry=without_odometry))
    rows = []
    for seed in track(parse_seeds(seeds, short=False), "descents", console=Console(stderr=True), transient=True):
        flight = fly(seed, ground_of(seed, cache), camera, PAD, rate_hz)
        rows.append(measured(seed, flight, camera, config, calibrated=calibrated))
    typer.echo(markdown(rows))
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        figures = {
            "size": f"{camera.width_px}x{camera.height_px}",
            "rate_hz": rate_hz,
            "calibrated": calibrated,
            "rows": [asdict(r) for r in rows],
        }
        (out / "pad-fusion.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
