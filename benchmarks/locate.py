"""``python -m benchmarks.locate``: how well single pictures are located, on real pictures with their truth.

Each picture gets a prior that is the truth plus a random offset of the stated size (seeded), and nothing else of the
truth. Half of each set chose the constants of ``estimator.registration.acceptance`` (``--half tune``, and ``--fit``
chooses them again); the figures are of the other half.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from backend.link.tlog import LinkReplay
from backend.navigation.setup import CameraProfile, profile_of_flight, read_camera_profile
from backend.photos.hints import Hints
from backend.photos.session import PhotoAnswer, PhotoSession
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import euler_from_q
from estimator.registration.acceptance import FEATURES, features, fit_weights
from estimator.registration.locate import judge
from estimator.registration.ortho import Ground
from estimator.types import BarometerSample, CameraAttitudeSample
from geodata.flight import FlightFolder


class Half(StrEnum):
    """Which pictures."""

    TUNE = "tune"
    TEST = "test"
    ALL = "all"


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture, where it was really taken, and what else is known of it."""

    path: Path
    lat_deg: float
    lon_deg: float
    known: Hints


@dataclass(frozen=True, slots=True)
class Trialset:
    """Pictures of one map with the size of their priors and the error that counts as right."""

    name: str
    map_path: Path
    elevation_path: Path | None
    profile: CameraProfile | None
    shots: tuple[Shot, ...]
    sigma_m: float
    within_m: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """One answer beside the truth."""

    answer: PhotoAnswer
    error_m: float
    nees: float


def seneca(data: Path, half: Half) -> Trialset:
    """Farmland, fixed wing without a gimbal: nothing is known but the place (100 m) and the nominal height."""
    folder = data / "photos" / "seneca"
    with (folder / "truth.csv").open() as file:
        rows = list(csv.DictReader(file))
    camera = {
        "width_px": 1800, "height_px": 1350, "fx_px": float(rows[0]["fx_px"]),
        # there the first pixel's centre is (0.5, 0.5)
        "cx_px": float(rows[0]["cx_px"]) - 0.5, "cy_px": float(rows[0]["cy_px"]) - 0.5,
        "distortion": [float(rows[0]["k1"]), 0.0, 0.0, 0.0, 0.0],
    }  # fmt: skip
    shots = [
        Shot(folder / "photos" / r["file"], float(r["cam_lat"]), float(r["cam_lon"]), Hints(agl_m=63.0)) for r in rows
    ]
    return Trialset(
        "photos/seneca, 30 cm map", folder / "map_passA_30cm.tif", folder / "dem_4m.tif", _profile(camera),
        _half(shots, half, interleaved=True), 100.0, 10.0,
    )  # fmt: skip


def ariel(data: Path, half: Half) -> Trialset:
    """Oblique pictures of a campus on hills: attitude and height as telemetered, another season's satellite map."""
    flight = FlightFolder.open(data / "flights" / "ariel_b")
    truth = flight.truth()
    profile = profile_of_flight(flight.meta)
    if truth is None or profile is None or flight.reference_path is None:
        message = f"{flight.path}: truth, camera and reference are needed"
        raise typer.BadParameter(message)
    attitudes, heights = _telemetry(flight)
    shots = []
    for number, path in sorted(flight.frame_files().items()):
        t_us = flight.frame_time_us(number)
        if t_us is None:
            continue
        at = int(np.argmin(np.abs(truth.t_unix_us - t_us)))
        q = min(attitudes, key=lambda s: abs(s.t_us - t_us)).q_ned_from_gimbal
        roll, pitch, yaw = (math.degrees(float(angle)) for angle in euler_from_q(q))
        alt = min(heights, key=lambda s: abs(s.t_us - t_us)).pressure_alt_m
        known = Hints(alt_amsl_m=alt, heading_deg=yaw % 360.0, pitch_deg=pitch, roll_deg=roll)
        lat_deg, lon_deg = math.degrees(truth.lat_rad[at]), math.degrees(truth.lon_rad[at])
        shots.append(Shot(path, lat_deg, lon_deg, known))
    return Trialset(
        "flights/ariel_b, single pictures", flight.reference_path, flight.elevation_path, profile,
        _half(shots, half, interleaved=False), 60.0, 25.0,
    )  # fmt: skip


SETS = {"seneca": seneca, "ariel": ariel}


def _telemetry(flight: FlightFolder) -> tuple[list[CameraAttitudeSample], list[BarometerSample]]:
    link = LinkReplay()
    attitudes: list[CameraAttitudeSample] = []
    heights: list[BarometerSample] = []
    for t_us, packet in flight.telemetry():
        for event in link.feed(t_us, packet):
            sample = getattr(event, "sample", None)
            if isinstance(sample, CameraAttitudeSample):
                attitudes.append(sample)
            elif isinstance(sample, BarometerSample):
                heights.append(sample)
    return attitudes, heights


def _profile(camera: dict[str, Any]) -> CameraProfile:
    import tempfile  # noqa: PLC0415  only here

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "camera.json"
        path.write_text(json.dumps(camera))
        return read_camera_profile(path)


def _half(shots: list[Shot], half: Half, interleaved: bool) -> tuple[Shot, ...]:
    """Neighbouring pictures of a video see the same ground, so a flight is cut in the middle instead of interleaved."""
    if half is Half.ALL:
        return tuple(shots)
    middle = len(shots) // 2
    first, second = (shots[::2], shots[1::2]) if interleaved else (shots[:middle], shots[middle:])
    return tuple(first if half is Half.TUNE else second)


def offset_ne_m(rng: np.random.Generator, sigma_m: float, disc: bool) -> np.ndarray:
    """A prior's error (2,): normal on each axis, or uniform in a disc of that radius."""
    if not disc:
        return np.asarray(rng.normal(0.0, sigma_m, 2))
    angle, radius = rng.uniform(0.0, 2.0 * math.pi), sigma_m * math.sqrt(rng.uniform())
    return radius * np.array([math.cos(angle), math.sin(angle)])


def hints_for(shot: Shot, away_ne_m: np.ndarray, sigma_m: float, disc: bool) -> Hints:
    """The shot's hints about a displaced position."""
    frame = LocalFrame(math.radians(shot.lat_deg), math.radians(shot.lon_deg), 0.0)
    lat, lon = frame.geodetic_from_ne(away_ne_m)
    at = replace(shot.known, lat_deg=math.degrees(float(lat)), lon_deg=math.degrees(float(lon)))
    return replace(at, radius_m=sigma_m) if disc else replace(at, sigma_m=sigma_m)


def run_set(trials: Trialset, seed: int, disc: bool, console: Console) -> list[Outcome]:
    """Locate every picture of a set with one draw of priors."""
    session = PhotoSession(trials.map_path, trials.elevation_path, trials.profile)
    rng = np.random.default_rng([seed, len(trials.name)])
    outcomes = []
    for shot in track(trials.shots, f"{trials.name}, seed {seed}", console=console, transient=True):
        away = offset_ne_m(rng, trials.sigma_m, disc)
        answer = session.answer(shot.path, hints_for(shot, away, trials.sigma_m, disc))
        outcomes.append(_outcome(answer, shot))
    session.close()
    return outcomes


def _outcome(answer: PhotoAnswer, shot: Shot) -> Outcome:
    if answer.lat_deg is None or answer.lon_deg is None:
        return Outcome(answer, math.inf, math.nan)
    frame = LocalFrame(math.radians(shot.lat_deg), math.radians(shot.lon_deg), 0.0)
    d = frame.ne_from_geodetic(math.radians(answer.lat_deg), math.radians(answer.lon_deg))
    n2, e2 = (answer.std_n_m or math.nan) ** 2, (answer.std_e_m or math.nan) ** 2
    cov = np.array([[n2, answer.cov_ne_m2 or 0.0], [answer.cov_ne_m2 or 0.0, e2]])
    return Outcome(answer, float(np.hypot(*d)), float(d @ np.linalg.solve(cov, d)))


def summary(trials: Trialset, outcomes: list[Outcome]) -> dict[str, Any]:
    """Shares of all pictures, and what the accepted ones are like."""
    accepted = [o for o in outcomes if o.answer.accepted]
    right = [o for o in accepted if o.error_m <= trials.within_m]
    count = max(len(outcomes), 1)
    errors = [o.error_m for o in accepted]
    return {
        "set": trials.name,
        "pictures": len(outcomes),
        "prior_m": trials.sigma_m,
        "within_m": trials.within_m,
        "accepted_within": len(right) / count,
        "accepted_wrong": (len(accepted) - len(right)) / count,
        "best_guess_within": sum(o.error_m <= trials.within_m for o in outcomes) / count,
        "median_m": float(np.median(errors)) if errors else None,
        "p95_m": float(np.percentile(errors, 95)) if errors else None,
        "nees_2d_mean": float(np.mean([o.nees for o in right])) if right else None,
        "median_s": float(np.median([o.answer.elapsed_ms for o in outcomes])) / 1e3 if outcomes else None,
    }


def evidence_rows(trials: Trialset, seed: int, astray: bool, console: Console) -> Iterator[tuple[np.ndarray, bool]]:
    """Features and whether it is wrong, of the best candidate of each picture; ``astray`` puts the prior elsewhere."""
    session = PhotoSession(trials.map_path, trials.elevation_path, trials.profile)
    rng = np.random.default_rng([seed, 7, int(astray)])
    # a picture of nothing is tried by every proposer, which takes long where the heading is open
    shots = trials.shots[::3] if astray else trials.shots
    for shot in track(shots, f"{trials.name}, evidence", console=console, transient=True):
        away = offset_ne_m(rng, trials.sigma_m, disc=False)
        if astray:
            angle = rng.uniform(0.0, 2.0 * math.pi)
            away = 3.0 * trials.sigma_m * np.array([math.cos(angle), math.sin(angle)]) * rng.uniform(1.1, 1.5)
        attempt = next(iter(session.attempts(shot.path, hints_for(shot, away, trials.sigma_m, disc=False))))
        prior = attempt.prior
        ground = Ground(attempt.terrain, session.frame.alt_m, prior.pos_ne_m, prior.radius_m)
        judged = judge(attempt.image, attempt.camera, attempt.reference, ground, prior, attempt.config)
        truth = session.frame.ne_from_geodetic(math.radians(shot.lat_deg), math.radians(shot.lon_deg))
        for _, one in sorted(judged, key=lambda j: j[0])[:2]:
            yield features(one.evidence), bool(np.hypot(*(one.pose.pos_ned_m[:2] - truth)) > trials.within_m)
    session.close()


def main(
    data: Annotated[Path, typer.Option(help="The evaluation data.")] = Path("../shared/data"),
    half: Annotated[Half, typer.Option(help="Which half of each set; tune chose the constants.")] = Half.TEST,
    only: Annotated[str | None, typer.Option(help=f"One set: {', '.join(SETS)}.")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Draws of the priors.")] = 1,
    seed: Annotated[int, typer.Option(help="The first of them.")] = 101,
    disc: Annotated[bool, typer.Option("--disc", help="Priors uniform in a disc instead of normal.")] = False,
    short: Annotated[bool, typer.Option("--short", help="Every sixth picture.")] = False,
    fit: Annotated[bool, typer.Option("--fit", help="Fit the acceptance on the tuning half instead.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Locate the pictures of the evaluation sets and print how many were found, refused and mistaken."""
    console = Console(stderr=True)
    if only is not None and only not in SETS:
        raise typer.BadParameter(f"--only {only}: the sets are {', '.join(SETS)}")
    wanted = [SETS[only]] if only else list(SETS.values())
    sets = [make(data, Half.TUNE if fit else half) for make in wanted]
    if short:
        sets = [replace(s, shots=s.shots[::6]) for s in sets]
    if fit:
        _print_fit(sets, seed, seeds, console)
        return
    rows = []
    for trials in sets:
        outcomes = [o for k in range(seeds) for o in run_set(trials, seed + k, disc, console)]
        rows.append(summary(trials, outcomes))
        for o in outcomes:
            if o.answer.accepted and o.error_m > trials.within_m:
                console.print(f"wrong: {o.answer.photo} by {o.error_m:.0f} m, p {o.answer.outlier_probability:.3f}")
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    _print_table(rows)


def _print_fit(sets: list[Trialset], seed: int, seeds: int, console: Console) -> None:
    pairs = [
        pair for trials in sets for k in range(seeds) for astray in (False, True)
        for pair in evidence_rows(trials, seed + k, astray, console)
    ]  # fmt: skip
    X, y = np.array([x for x, _ in pairs]), np.array([float(wrong) for _, wrong in pairs])
    w = fit_weights(X, y)
    p = 1.0 / (1.0 + np.exp(-(w[0] + X @ w[1:])))
    names = ("bias", *FEATURES)
    Console().print(", ".join(f"{n}={v:.2f}" for n, v in zip(names, w, strict=True)), soft_wrap=True)
    kept = p < 0.05
    Console().print(
        f"{len(y)} candidates, {int(y.sum())} wrong; p < 0.05 keeps {np.sum(kept & (y == 0))} of {int(np.sum(y == 0))}"
        f" right and {int(np.sum(kept & (y == 1)))} wrong", soft_wrap=True,
    )  # fmt: skip


def _print_table(rows: list[dict[str, Any]]) -> None:
    table = Table("set", "pictures", "prior m", "right", "wrong", "median m", "95 % m", "NEES", "s", box=None)
    for r in rows:
        shown = [f"{r[k]:.2f}" if r[k] is not None else "" for k in ("median_m", "p95_m", "nees_2d_mean", "median_s")]
        table.add_row(
            r["set"], str(r["pictures"]), f"{r['prior_m']:g}", f"{r['accepted_within']:.1%} within {r['within_m']:g} m",
            f"{r['accepted_wrong']:.1%}", *shown,
        )  # fmt: skip
    Console().print(table)


if __name__ == "__main__":
    typer.run(main)
