"""``pilotage kidnapped``: starts without any position over simulated worlds, with the right map and with wrong ones.

A flight is flown once for each world, kept on the disk, and cut into trials. Each trial is told nothing of where it is:
satellites and home are left out, and the reported heading is turned by a random angle. It is right when the navigator
starts within the time, and within ``FALSE_LOCK_M`` of the truth then; anything else it starts with, and any start on a
wrong map, is a false lock. Wrong maps are, by turns, another world's and its own without the ground that is flown over.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.kidnapped_flights import FLOWN_BY, Flight, flown, world_of
from benchmarks.studies.flights import source_digest
from estimator.geometry.rotation import q_from_rotvec, q_multiply
from estimator.navigator import Navigator, NavigatorConfig
from estimator.ports import GroundModel, ReferenceMap
from estimator.types import AttitudeSample, Float, FrameSample, GnssSample, HomeSample, Sample
from geodata.elevation import ElevationGrid
from geodata.imagery import ImageryGrid, ReferenceImagery
from simulator.random_streams import rng_for
from simulator.world.world import World

TRIAL_S, FOLLOWED_S, PER_WORLD = 120.0, 15.0, 5
FALSE_LOCK_M = 30.0
DELAY_S = 0.25
CUT_M = 260.0  # beyond what any picture shows, as far as two heights
TRIED_BY = ("benchmarks", "estimator", *FLOWN_BY)


@dataclass(frozen=True, slots=True)
class Trial:
    """What came of one start; ``found_s`` after its first picture, None where it stayed lost.

    ``error_m`` is horizontal, when it was found; ``later_m`` and ``heading_deg`` are the errors when the trial ends,
    ``sigmas`` the first error over its own standard deviation. ``cut``: the map lacks the ground flown over.
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
    cut: bool = False

    @property
    def right_map(self) -> bool:
        """Whether the map shows where it is."""
        return self.world == self.map and not self.cut

    @property
    def right(self) -> bool:
        """Whether it was found where it is."""
        return self.error_m is not None and self.right_map and self.error_m <= FALSE_LOCK_M

    @property
    def false_lock(self) -> bool:
        """Whether it claimed to be where it is not."""
        return self.error_m is not None and not self.right


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The map and the terrain model of a world, as files deliver them."""

    reference: ReferenceMap
    elevation: GroundModel


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


def without_track(ground: Ground, flight: Flight, start_s: float) -> Ground:
    """The map without what a trial flies over: what its pictures show is not there, all else is as it was."""
    reference = ground.reference
    if not isinstance(reference, ImageryGrid):
        message = f"only a grid of imagery can be cut, not {type(reference).__name__}"
        raise TypeError(message)
    t_s = (flight.truth[:, 0] - flight.truth[0, 0]) / 1e6 - start_s
    track = flight.truth[(t_s >= -1.0) & (t_s <= TRIAL_S + FOLLOWED_S), 1:3]
    px = np.stack((track[:, 1] - reference.east_min_m, reference.north_max_m - track[:, 0]), axis=-1) / reference.gsd_m
    gone = np.zeros(reference.valid.shape, dtype=np.uint8)
    cv2.polylines(gone, [np.round(px).astype(np.int32)], False, 1, thickness=round(2.0 * CUT_M / reference.gsd_m))
    valid = reference.valid & (gone == 0)
    return replace(ground, reference=replace(reference, image=np.where(valid, reference.image, 0), valid=valid))


def run_trial(
    flight: Flight, ground: Ground, world: int, map_of: int, start_s: float, turn_rad: float,
    clock_s: Callable[[], float], cut: bool = False, trial_s: float = TRIAL_S,
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
        heading_deg, took_s / max((t_us - first_us) / 1e6, 1.0), cut,
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


@dataclass(frozen=True, slots=True)
class Records:
    """Finished trials in a file, a line each with the digest of the code that ran them."""

    path: Path
    digest: str
    done: list[Trial] = field(default_factory=list)

    @classmethod
    def opened(cls, path: Path, digest: str, resume: bool) -> Records:
        """The trials of this very code where they are to be resumed; else none, and an empty file."""
        if not resume:
            path.write_text("", encoding="utf-8")
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        rows = [json.loads(line) for line in lines]
        return cls(path, digest, [Trial(**row["trial"]) for row in rows if row["code"] == digest])

    def of(self, world: int, map_of: int, cut: bool, start_s: float) -> Trial | None:
        """The trial that was made with these, if it was."""
        wanted = (world, map_of, cut, start_s)
        return next((t for t in self.done if (t.world, t.map, t.cut, t.start_s) == wanted), None)

    def add(self, trial: Trial) -> None:
        """Keep a trial."""
        self.done.append(trial)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"code": self.digest, "trial": asdict(trial)}) + "\n")


def run(
    trials: int, wrong: int, first_seed: int, half_size_m: float, folder: Path, records: Records,
    clock_s: Callable[[], float], tell: Callable[[Trial], None],
) -> list[Trial]:  # fmt: skip
    """So many starts over the right map and so many over wrong ones; another world is the next seed's."""
    done: list[Trial] = []
    grounds: dict[int, Ground] = {}

    def ground(seed: int) -> Ground:
        if seed not in grounds:
            grounds[seed] = ground_of(world_of(seed, half_size_m, folder / "worlds"), folder)
        return grounds[seed]

    digest = source_digest(FLOWN_BY)
    worlds = math.ceil(max(trials, wrong) / PER_WORLD)
    for index in range(worlds):
        seed = first_seed + index
        # a wrong map costs a world of its own only where there is a single one
        other = seed + 1 if index + 1 < worlds else (first_seed if worlds > 1 else seed + 1)
        flight = flown(seed, half_size_m, PER_WORLD * TRIAL_S + FOLLOWED_S, folder, digest)
        rng = rng_for(seed, "kidnapped")
        for k in range(PER_WORLD):
            number, turn_rad = index * PER_WORLD + k, float(rng.uniform(-math.pi, math.pi))
            kinds = [(seed, False)] if number < trials else []
            if number < wrong:
                kinds.append((seed, True) if k % 2 else (other, False))
            for map_of, cut in kinds:
                trial = records.of(seed, map_of, cut, k * TRIAL_S)
                if trial is None:
                    shown = without_track(ground(seed), flight, k * TRIAL_S) if cut else ground(map_of)
                    trial = run_trial(flight, shown, seed, map_of, k * TRIAL_S, turn_rad, clock_s, cut)
                    records.add(trial)
                    tell(trial)
                done.append(trial)
        grounds = {kept: grounds[kept] for kept in (first_seed, seed + 1) if kept in grounds}
    return done


def register(app: typer.Typer) -> None:
    """Add the command to the console command."""
    app.command("kidnapped", epilog="Example: pilotage kidnapped --trials 10 --wrong 5")(kidnapped)


def kidnapped(
    trials: Annotated[int, typer.Option(min=0, help="Starts over the right map.")] = 50,
    wrong: Annotated[int, typer.Option(min=0, help="Starts over wrong maps.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="Of the first world; five starts in each.")] = 400,
    half_size_m: Annotated[float, typer.Option(min=300, max=2600, help="Half the map's side.")] = 1020.0,
    short: Annotated[bool, typer.Option("--short", help="Three starts and two wrong ones.")] = False,
    work: Annotated[Path, typer.Option(help="Folder for worlds and maps.")] = Path("kidnapped"),
    resume: Annotated[bool, typer.Option("--resume", help="Keep the trials that this code has made there.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the trials as JSON.")] = False,
) -> None:
    """Start without position, home and heading: how often found, how soon, how often wrong. Takes hours."""
    import time  # noqa: PLC0415  only a measurement reads the clock

    cv2.setNumThreads(1)
    work.mkdir(parents=True, exist_ok=True)
    errors = Console(stderr=True)
    counts = (3, 2) if short else (trials, wrong)
    records = Records.opened(work / "trials.jsonl", source_digest(TRIED_BY), resume)
    done = run(
        *counts, seed, half_size_m, work, records, time.process_time, lambda trial: errors.print(_line(trial))
    )  # fmt: skip
    if as_json:
        typer.echo(json.dumps([asdict(trial) for trial in done], indent=1))
        return
    Console().print(_table(done))


def _line(trial: Trial) -> str:
    map_ = f"{trial.map}{' cut' if trial.cut else ''}"
    what = f"world {trial.world} map {map_} at {trial.start_s:.0f} s, {100 * trial.cpu_share:.0f} % of a core: "
    if trial.found_s is None or trial.error_m is None or trial.sigmas is None or trial.later_m is None:
        return what + "lost"
    return what + (
        f"found after {trial.found_s:.0f} s, {trial.error_m:.1f} m off ({trial.sigmas:.1f} sigma), "
        f"later {trial.later_m:.1f} m, heading {trial.heading_deg:.1f} deg{' FALSE' if trial.false_lock else ''}"
    )


def _table(done: list[Trial]) -> Table:
    table = Table(
        "map", "trials", "found", "false locks", "found after: median / 90 % / longest", "error: rms / largest",
        "core",
    )  # fmt: skip
    kinds = {
        "right": [t for t in done if t.right_map],
        "of another world": [t for t in done if t.world != t.map],
        "without the ground flown over": [t for t in done if t.cut],
    }
    for name, rows in kinds.items():
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
            f"{100.0 * float(np.mean([t.cpu_share for t in rows])):.0f} %",
        )  # fmt: skip
    return table
