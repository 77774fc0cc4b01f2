"""Runs a study: flights, replays, figures, over seeds and processes, with a cache to go on from."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import pickle
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from backend.errors import StationError
from backend.replay.offline import ReplayOptions, TruthErrors, errors_against_truth, replay_flight
from backend.uncertainty import ellipse95
from benchmarks.studies.degraded import Degrader
from benchmarks.studies.figures import (
    WITHIN_M,
    Scored,
    drift,
    drift_figures,
    innovation_figures,
    navigation_figures,
    pooled,
    scored,
)
from benchmarks.studies.flights import ESTIMATOR_SOURCES, SIMULATOR_SOURCES, flown, source_digest
from benchmarks.studies.series import Series, series_figures
from benchmarks.studies.study import ComputedRow, FlownRow, Row, Study
from estimator.types import Float, Mode, NavigationState
from geodata.errors import GeodataError
from geodata.flight import FlightFolder


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What one row gave with one seed: ``values`` of a computed row, or the scores of a replay."""

    values: dict[str, float] | None = None
    scored: Scored | None = None
    series: Series | None = None
    drift: dict[float, Float] | None = None
    innovations: dict[str, dict[str, float]] | None = None
    fixes: int = 0
    accepted: int = 0
    fix_ms: float = 0.0
    real_time: float = 0.0
    failure: str = ""


@dataclass(frozen=True, slots=True)
class Result:
    """A row's name, what it changes, its figures over the seeds, and the seeds that failed with their reasons."""

    name: str
    change: str
    figures: dict[str, Any]
    failures: dict[int, str]


def run_study(
    study: Study, seeds: Sequence[int], cache: Path, jobs: int, resume: bool, say: Callable[[str], None]
) -> list[Result]:
    """Figures of every row over the seeds. With ``resume`` outcomes that the same code has left in the cache count."""
    digest = source_digest(ESTIMATOR_SOURCES), source_digest(SIMULATOR_SOURCES)
    tasks = [_Task(study, index, seed, cache, digest) for seed in seeds for index in range(len(study.rows))]
    found: dict[_Task, Outcome] = {}
    for task in tasks:
        kept = task.kept() if resume else None
        if kept is not None:
            found[task] = kept
    if found:
        say(f"{len(found)} of {len(tasks)} outcomes taken from {cache}")
    waiting = [task for task in tasks if task not in found]
    started = time.monotonic()
    for task, outcome in _outcomes(waiting, jobs, say):
        found[task] = outcome
        done = len(found) - (len(tasks) - len(waiting))
        left_s = (time.monotonic() - started) / done * (len(waiting) - done)
        failed = f" failed: {outcome.failure}" if outcome.failure else ""
        say(f"{len(found)} of {len(tasks)}: {study.rows[task.row].name}, seed {task.seed}{failed}; {left_s:.0f} s left")
    return [
        _result(row, {seed: found[task] for task in tasks if task.row == index for seed in (task.seed,)})
        for index, row in enumerate(study.rows)
    ]


@dataclass(frozen=True, slots=True)
class _Task:
    """One row with one seed. Equal by row and seed: a study itself may hold functions."""

    study: Study
    row: int
    seed: int
    cache: Path
    digest: tuple[str, str]

    def __hash__(self) -> int:
        return hash((self.row, self.seed))

    def path(self) -> Path:
        """Where the outcome is kept; another study with the same row and code finds it too."""
        row = self.study.rows[self.row]
        about: dict[str, Any] = {"seed": self.seed, "code": self.digest}
        if isinstance(row, FlownRow):
            about |= {"scenario": row.scenario.model_dump(), "config": asdict(row.config)}
            about["segments"] = self.study.segments_m
            if row.degrade is not None:
                about["degrade"] = asdict(row.degrade)
        else:
            about |= {"study": self.study.name, "row": row.name}
        key = hashlib.sha256(json.dumps(about, sort_keys=True, default=str).encode()).hexdigest()[:20]
        return self.cache / "outcomes" / f"{key}.pickle"

    def kept(self) -> Outcome | None:
        """The outcome that the cache holds, None where there is none that can be read."""
        try:
            outcome = pickle.loads(self.path().read_bytes())  # noqa: S301  our own file, named by a digest of the code
        except (OSError, pickle.UnpicklingError, EOFError, AttributeError):
            return None
        return outcome if isinstance(outcome, Outcome) else None

    def keep(self, outcome: Outcome) -> None:
        """Write the outcome whole or not at all."""
        path = self.path()
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(f".{threading.get_native_id()}")
        partial.write_bytes(pickle.dumps(outcome))
        partial.replace(path)


def _outcomes(tasks: Sequence[_Task], jobs: int, say: Callable[[str], None]) -> Iterator[tuple[_Task, Outcome]]:
    """Outcomes as they come; flights are simulated first, each once."""
    if not tasks:
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        try:
            flights: dict[Path | str, Future[Path]] = {}
            for task in tasks:
                row = task.study.rows[task.row]
                if isinstance(row, FlownRow):
                    key = f"{row.scenario.model_dump_json()} {task.seed}"
                    if key not in flights:
                        flights[key] = pool.submit(flown, row.scenario, task.seed, task.cache, task.digest[1])
            for number, flight in enumerate(as_completed(flights.values()), 1):
                say(f"flight {number} of {len(flights)}: {flight.result().name}")
            running = {pool.submit(_outcome, task): task for task in tasks}
            for done in as_completed(running):
                task = running[done]
                yield task, done.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _outcome(task: _Task) -> Outcome:
    row = task.study.rows[task.row]
    if isinstance(row, ComputedRow):
        outcome = Outcome(values=row.compute(task.seed))
    else:
        flight = flown(row.scenario, task.seed, task.cache, task.digest[1])
        outcome = _replayed(row, flight, task.seed, task.study.segments_m)
    task.keep(outcome)
    return outcome


def _replayed(row: FlownRow, flight: Path, seed: int, segments_m: Sequence[float]) -> Outcome:
    cv2.setNumThreads(1)
    folder = FlightFolder.open(flight)
    denied_us = folder.meta.gps_denied[0][0] if folder.meta.gps_denied else folder.telemetry_span()[0]
    degrader = None if row.degrade is None else Degrader(row.degrade, denied_us, seed)
    with tempfile.TemporaryDirectory(prefix="pilotage-study-") as scratch:
        try:
            result = replay_flight(folder, Path(scratch), options=ReplayOptions(config=row.config, alteration=degrader))
        except (StationError, GeodataError) as error:
            return Outcome(failure=str(error))
        except np.linalg.LinAlgError as error:
            return Outcome(failure=f"the filter diverged: {error}")
    errors = errors_against_truth(folder, result.states)
    if errors is None:
        return Outcome(failure="no state at a time of which the truth is known")
    inside = np.zeros(len(errors.t_us), dtype=bool)
    for start_us, end_us in errors.spans_us:
        inside |= (errors.t_us >= start_us) & (errors.t_us <= end_us)
    if inside.sum() < 2:
        return Outcome(failure="no state while GPS was denied")
    by_time = {state.t_us: state for state in result.states}
    states = [by_time[int(t)] for t in errors.t_us]
    valid = np.array([_declared_valid(state) for state in states], dtype=np.float64)[inside]
    by_vision = np.array([state.mode in (Mode.GPS, Mode.VISION) for state in states], dtype=np.float64)[inside]
    error_ne_m, heading = errors.error_ned_m[inside, :2], errors.heading_error_rad[inside]
    return Outcome(
        scored=scored(error_ne_m, errors.cov_ne_m2[inside], valid, heading, by_vision),
        series=None if degrader is None else _series(errors, states, denied_us, degrader),
        drift=drift(errors.true_ned_m[inside, :2], error_ne_m, heading, segments_m) if segments_m else None,
        innovations=result.report["innovations"],
        fixes=len(result.fixes),
        accepted=sum(fix.accepted for fix in result.fixes),
        fix_ms=sum(fix.elapsed_ms for fix in result.fixes),
        real_time=float(result.report["timing"]["times_real_time"]),
    )


def _declared_valid(state: NavigationState) -> bool:
    """Whether it is not lost and its own 95 % ellipse reaches no farther than what counts as available."""
    return state.mode is not Mode.LOST and ellipse95(state.cov_pos_ned_m2[:2, :2]).semi_major_m <= WITHIN_M


def _series(errors: TruthErrors, states: Sequence[NavigationState], denied_us: int, degrader: Degrader) -> Series:
    every = scored(errors.error_ned_m[:, :2], errors.cov_ne_m2, np.ones(len(states)), errors.heading_error_rad)
    return Series(
        (errors.t_us - denied_us) / 1e6, np.hypot(*errors.error_ned_m[:, :2].T), np.sqrt(every.nees),
        tuple(state.mode for state in states), tuple(state.doubts for state in states),
        degrader.frozen_at(errors.t_us),
    )  # fmt: skip


def _result(row: Row, by_seed: dict[int, Outcome]) -> Result:
    failures = {seed: outcome.failure for seed, outcome in by_seed.items() if outcome.failure}
    good = [outcome for outcome in by_seed.values() if not outcome.failure]
    figures: dict[str, Any] = {"seeds": len(good), "failed": len(failures)}
    values = [outcome.values for outcome in good if outcome.values is not None]
    runs = [outcome.scored for outcome in good if outcome.scored is not None]
    if values:
        figures |= pooled(values)
    if runs:
        figures |= navigation_figures(runs)
        fixes = sum(outcome.fixes for outcome in good)
        figures |= {"fixes": fixes, "times_real_time": float(np.mean([outcome.real_time for outcome in good]))}
        if fixes:
            figures["accepted"] = sum(outcome.accepted for outcome in good) / fixes
            figures["fix_ms"] = sum(outcome.fix_ms for outcome in good) / fixes
        figures |= innovation_figures([outcome.innovations for outcome in good if outcome.innovations])
        figures |= drift_figures([outcome.drift for outcome in good if outcome.drift is not None])
        series = [outcome.series for outcome in good if outcome.series is not None]
        if isinstance(row, FlownRow) and row.degrade is not None and series:
            start_s, end_s = row.scenario.gps_denied_s[0] if row.scenario.gps_denied_s else (0.0, np.inf)
            figures |= series_figures(series, row.degrade.stretch_s, end_s - start_s)
        figures["rms_by_seed_m"] = {
            seed: round(float(np.sqrt((outcome.scored.error_ne_m**2).sum(axis=1).mean())), 3)
            for seed, outcome in by_seed.items()
            if outcome.scored is not None
        }
    return Result(row.name, row.change, figures, failures)
