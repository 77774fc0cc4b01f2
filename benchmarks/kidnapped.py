"""``pilotage kidnapped``: starts without any position over simulated worlds, with the right map and with a wrong one.

A flight is flown once for each world and cut into trials. Each trial is told nothing of where it is: satellites and
home are left out, and the reported heading is turned by a random angle. It is right when the navigator starts within
the time, and within ``FALSE_LOCK_M`` of the truth then; anything else it starts with, and any start on the map of
another world, is a false lock.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from backend.link.events import SampleEvent
from backend.link.tlog import LinkReplay
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_rotvec, q_multiply
from estimator.navigator import Navigator, NavigatorConfig
from estimator.ports import GroundModel, ReferenceMap
from estimator.types import AttitudeSample, Float, FrameSample, GnssSample, HomeSample, Sample
from geodata.elevation import ElevationGrid
from geodata.imagery import ReferenceImagery
from simulator.random_streams import rng_for
from simulator.scenario import CameraSection, Scenario, WorldSection
from simulator.sensors.camera import CameraView
from simulator.simulation import STEP_US, Simulation
from simulator.world.world import World, WorldSpec, world_for

FRAMES_PER_S = 5.0
JPEG_QUALITY = 90  # what a video codec leaves of a picture, roughly
TRIAL_S, FOLLOWED_S, PER_WORLD = 120.0, 15.0, 5
FALSE_LOCK_M = 30.0
DELAY_S = 0.25


@dataclass(frozen=True, slots=True)
class Trial:
    """What came of one start; ``found_s`` after its first picture, None where it stayed lost.

    ``error_m`` is horizontal, when it was found; ``later_m`` and ``heading_deg`` are the errors when the trial ends,
    ``sigmas`` the first error over its own standard deviation.
    """

    world: int
    map: int
    start_s: float
    found_s: float | None
    error_m: float | None
    sigmas: float | None
    later_m: float | None
    heading_deg: float | None
    cpu_share: float

    @property
    def right(self) -> bool:
        """Whether it was found where it is."""
        return self.error_m is not None and self.world == self.map and self.error_m <= FALSE_LOCK_M

    @property
    def false_lock(self) -> bool:
        """Whether it claimed to be where it is not."""
        return self.error_m is not None and not self.right


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A recorded flight: samples in order, pictures as JPEG, truth by time (t_us, NED, yaw)."""

    samples: list[Sample]
    pictures: list[tuple[int, bytes]]
    truth: Float
    camera: Camera
    mount: Mount
    frame: LocalFrame


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The map and the terrain model of a world, as files deliver them."""

    reference: ReferenceMap
    elevation: GroundModel


def world_of(seed: int, half_size_m: float, cache: Path) -> World:
    """The world of a seed, kept in ``cache``."""
    return world_for(WorldSpec(seed=seed, half_size_m=half_size_m, gsd_m=0.3), cache)


def ground_of(world: World, folder: Path) -> Ground:
    """Map and terrain of a world in its own frame, through GeoTIFF as a user has them."""
    path, terrain = folder / f"map-{world.spec.seed}.tif", folder / f"terrain-{world.spec.seed}.tif"
    world.reference.write(path)
    world.elevation.write(terrain)
    imagery = ReferenceImagery.open(path)
    try:
        return Ground(imagery.grid(world.frame), ElevationGrid.open(terrain, world.frame))
    finally:
        imagery.close()


def fly(world: World, seed: int, duration_s: float) -> Flight:
    """Fly the demo's aircraft over a world, without any network."""
    scenario = Scenario(
        duration_s=duration_s, gps_denied_s=(), world=WorldSection(gsd_m=world.spec.gsd_m),
        camera=CameraSection(frames_per_s=FRAMES_PER_S),
    )  # fmt: skip
    simulation = Simulation(scenario, world, seed, scenario.start_unix_us)
    section = scenario.camera
    view = CameraView(world, section.intrinsics(), seed, section.noise_std, section.vignetting)
    link = LinkReplay()
    samples: list[Sample] = []
    pictures: list[tuple[int, bytes]] = []
    truth = []
    for _ in range(round(duration_s * 1e6) // STEP_US):
        output = simulation.step()
        for packet in output.packets:
            events = link.feed(output.t_unix_us + 2_000, packet)
            samples += [event.sample for event in events if isinstance(event, SampleEvent)]
        if output.exposure is not None:
            seen = output.exposure
            grey = cv2.cvtColor(view.render(seen.camera_pos_ned_m, seen.ned_from_camera), cv2.COLOR_BGR2GRAY)
            _, packed = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            pictures.append((seen.t_unix_us, packed.tobytes()))
            truth.append((seen.t_unix_us, *seen.state.pos_ned_m, seen.state.yaw_rad))
    return Flight(samples, pictures, np.array(truth), section.intrinsics(), section.mount(), world.frame)


def run_trial(
    flight: Flight, ground: Ground, world: int, map_of: int, start_s: float, turn_rad: float,
    clock_s: Callable[[], float], trial_s: float = TRIAL_S,
) -> Trial:  # fmt: skip
    """One start at ``start_s`` of the flight, with headings turned by ``turn_rad``."""
    first_us = int(flight.truth[0, 0] + start_s * 1e6)
    navigator = Navigator(
        NavigatorConfig(), flight.camera, flight.mount, "fixed", flight.frame, ground.reference, ground.elevation
    )
    found_us: int | None = None
    error_m = sigmas = later_m = heading_deg = None
    began_s = clock_s()
    samples = _turned(flight.samples, turn_rad, first_us)
    waiting = next(samples, None)
    t_us = first_us
    for t_us, packed in flight.pictures:
        if t_us < first_us:
            continue
        if t_us > first_us + trial_s * 1e6 and found_us is None:
            break
        if found_us is not None and t_us > found_us + FOLLOWED_S * 1e6:
            break
        while waiting is not None and waiting.t_us <= t_us + DELAY_S * 1e6:
            navigator.offer(waiting)
            waiting = next(samples, None)
        image = cv2.imdecode(np.frombuffer(packed, np.uint8), cv2.IMREAD_GRAYSCALE)
        navigator.offer(FrameSample(t_us, len(flight.pictures), np.asarray(image, dtype=np.uint8)))
        navigator.advance(t_us)
        state = navigator.state
        if state is None:
            continue
        at = [float(np.interp(state.t_us, flight.truth[:, 0], flight.truth[:, axis])) for axis in (1, 2)]
        off = state.pos_ned_m[:2] - at
        later_m = float(np.hypot(*off))
        heading_deg = _heading_error_deg(flight, state.t_us, state.q_ned_from_body)
        if found_us is None:
            found_us = t_us
            error_m = later_m
            sigmas = float(np.sqrt(off @ np.linalg.inv(state.cov_pos_ned_m2[:2, :2]) @ off / 2.0))
    took_s = clock_s() - began_s
    return Trial(
        world, map_of, start_s, None if found_us is None else (found_us - first_us) / 1e6, error_m, sigmas, later_m,
        heading_deg, took_s / max((t_us - first_us) / 1e6, 1.0),
    )  # fmt: skip


def _turned(samples: list[Sample], turn_rad: float, first_us: int) -> Iterator[Sample]:
    """From a time on what the vehicle reports without satellites and home, its headings off by an angle."""
    turn = q_from_rotvec(np.array([0.0, 0.0, turn_rad]))
    for sample in samples:
        if sample.t_us < first_us or isinstance(sample, GnssSample | HomeSample):
            continue
        if isinstance(sample, AttitudeSample):
            yield replace(sample, q_ned_from_body=q_multiply(turn, sample.q_ned_from_body))
        else:
            yield sample


def _heading_error_deg(flight: Flight, t_us: int, q: Float) -> float:
    yaw = math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] ** 2 + q[3] ** 2))
    true = float(np.interp(t_us, flight.truth[:, 0], np.unwrap(flight.truth[:, 4])))
    return math.degrees((yaw - true + math.pi) % (2.0 * math.pi) - math.pi)


def run(
    trials: int, wrong: int, first_seed: int, half_size_m: float, folder: Path, clock_s: Callable[[], float],
    tell: Callable[[Trial], None],
) -> list[Trial]:  # fmt: skip
    """So many starts over the right map and so many over a wrong one, the seed before's."""
    cache = folder / "worlds"
    done: list[Trial] = []
    others: Ground | None = None
    left, left_wrong, seed = trials, wrong, first_seed
    while left > 0 or left_wrong > 0:
        world = world_of(seed, half_size_m, cache)
        count = min(max(left, left_wrong), PER_WORLD)
        flight = fly(world, seed, count * TRIAL_S + FOLLOWED_S)
        ground = ground_of(world, folder)
        if others is None and left_wrong > 0:
            others = ground_of(world_of(first_seed + 1000, half_size_m, cache), folder)
        del world
        rng = rng_for(seed, "kidnapped")
        for k in range(count):
            turn_rad = float(rng.uniform(-math.pi, math.pi))
            if k < left:
                done.append(run_trial(flight, ground, seed, seed, k * TRIAL_S, turn_rad, clock_s))
                tell(done[-1])
            if k < left_wrong and others is not None:
                done.append(run_trial(flight, others, seed, seed - 1, k * TRIAL_S, turn_rad, clock_s))
                tell(done[-1])
        left, left_wrong, seed, others = left - count, left_wrong - count, seed + 1, ground
    return done


def register(app: typer.Typer) -> None:
    """Add the command to the console command."""
    app.command("kidnapped", epilog="Example: pilotage kidnapped --trials 10 --wrong 5")(kidnapped)


def kidnapped(
    trials: Annotated[int, typer.Option(min=0, help="Starts over the right map.")] = 50,
    wrong: Annotated[int, typer.Option(min=0, help="Starts over the map of another world.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="Of the first world; five starts in each.")] = 400,
    half_size_m: Annotated[float, typer.Option(min=300, max=2600, help="Half the map's side.")] = 1020.0,
    short: Annotated[bool, typer.Option("--short", help="Three starts and two wrong ones.")] = False,
    work: Annotated[Path, typer.Option(help="Folder for worlds and maps.")] = Path("kidnapped"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the trials as JSON.")] = False,
) -> None:
    """Start without position, home and heading: how often found, how soon, how often wrong. Takes hours."""
    import time  # noqa: PLC0415  only a measurement reads the clock

    cv2.setNumThreads(1)
    work.mkdir(parents=True, exist_ok=True)
    errors = Console(stderr=True)
    counts = (3, 2) if short else (trials, wrong)
    done = run(*counts, seed, half_size_m, work, time.process_time, lambda trial: errors.print(_line(trial)))
    if as_json:
        typer.echo(json.dumps([asdict(trial) for trial in done], indent=1))
        return
    Console().print(_table(done))


def _line(trial: Trial) -> str:
    what = f"world {trial.world} map {trial.map} at {trial.start_s:.0f} s, {100 * trial.cpu_share:.0f} % of a core: "
    if trial.found_s is None or trial.error_m is None or trial.sigmas is None or trial.later_m is None:
        return what + "lost"
    return what + (
        f"found after {trial.found_s:.0f} s, {trial.error_m:.1f} m off ({trial.sigmas:.1f} sigma), "
        f"later {trial.later_m:.1f} m, heading {trial.heading_deg:.1f} deg{' FALSE' if trial.false_lock else ''}"
    )


def _table(done: list[Trial]) -> Table:
    table = Table(
        "map", "trials", "found", "false locks", "found after: median / 90 % / longest", "error: rms / largest"
    )
    for name, right in (("right", True), ("wrong", False)):
        rows = [t for t in done if (t.world == t.map) is right]
        if not rows:
            continue
        found = [t for t in rows if t.right]
        times = np.array([t.found_s for t in found], dtype=np.float64)
        errors = np.array([t.error_m for t in found], dtype=np.float64)
        table.add_row(
            name, str(len(rows)), f"{len(found)} ({100 * len(found) / len(rows):.0f} %)",
            str(sum(t.false_lock for t in rows)),
            f"{np.median(times):.0f} / {np.quantile(times, 0.9):.0f} / {times.max():.0f} s" if found else "-",
            f"{np.sqrt((errors**2).mean()):.1f} / {errors.max():.1f} m" if found else "-",
        )  # fmt: skip
    return table
