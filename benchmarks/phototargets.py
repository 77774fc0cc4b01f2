"""``python -m benchmarks.phototargets``: how far ``pilotage target`` is from targets whose coordinates are known.

Recorded clicks on single pictures of the evaluation flights; nothing of the flight but the picture is used. The prior
is the truth plus a normal error (seeded): 30 m on each axis, 3 m in height, 3 degrees in heading where the attitude is
not telemetered. Pictures that look down are given no tilt. A click on a refused picture is refused.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from backend.navigation.setup import profile_of_flight
from backend.photos.hints import Hints
from backend.photos.session import PhotoSession
from backend.photos.target import PhotoTarget, PhotoTargetError, TargetOptions, locate_pixels
from backend.uncertainty import circular_error_m
from benchmarks.locate import Half, Shot, ariel, hints_for
from estimator.evaluate import CHI2_95_2DOF
from estimator.geometry.local import LocalFrame
from estimator.types import Float
from geodata.flight import FlightFolder
from geodata.flight_tables import Click, TargetTruth

PRIOR_STD_M, HEIGHT_STD_M, HEADING_STD_DEG = 30.0, 3.0, 3.0
FLIGHTS = ("ariel_b", "copter_120m", "plane_80m")


@dataclass(frozen=True, slots=True)
class Sighting:
    """A picture with what is known of it and its clicks."""

    shot: Shot
    clicks: tuple[Click, ...]


@dataclass(frozen=True, slots=True)
class Miss:
    """How far one coordinate is off, and what was said of that: by the match, and by the pose alone."""

    by: str
    error_m: float
    nees: float
    ce90_m: float
    ray_error_m: float
    ray_nees: float
    ray_ce90_m: float


def sightings(flight: FlightFolder, data: Path, every: int, seed: int, folder: Path) -> Iterator[Sighting]:
    """Every so many pictures of a flight that have clicks, as files; those of a video are written into ``folder``."""
    clicks: dict[int, list[Click]] = {}
    for click in flight.clicks():
        clicks.setdefault(click.t_video_us, []).append(click)
    times = sorted(clicks)[::every]
    shots = _stills(flight, data) if flight.frame_files() else _frames(flight, times, seed, folder)
    for t_us, shot in shots:
        if t_us in times:
            yield Sighting(shot, tuple(clicks[t_us]))


def _stills(flight: FlightFolder, data: Path) -> Iterator[tuple[int, Shot]]:
    by_path = {path: flight.frame_time_us(number) for number, path in flight.frame_files().items()}
    for shot in ariel(data, Half.ALL).shots:
        t_us = by_path[shot.path]
        if t_us is not None:
            yield t_us, shot


def _frames(flight: FlightFolder, times: list[int], seed: int, folder: Path) -> Iterator[tuple[int, Shot]]:
    """Frames of a video at moments of its clock, with heading and height as an operator would have them."""
    table, truth, video = flight.frame_times(), flight.truth(), flight.path / str(flight.meta.video.file)
    ground = flight.meta.map.ground_alt_amsl_m
    if table is None or truth is None or ground is None:
        message = f"{flight.path}: frames.csv, truth.csv and the ground's altitude are needed"
        raise typer.BadParameter(message)
    capture = cv2.VideoCapture(str(video))
    moments = {int(f): int(t) for f, t in zip(table.frame, table.t_video_us, strict=True)}
    for number in range(max(moments) + 1):
        if not capture.grab():
            break
        t_us = moments.get(number)
        if t_us is None or t_us not in times:
            continue
        picture = capture.retrieve()[1]
        path = folder / f"{flight.name}-{number:06d}.png"
        cv2.imwrite(str(path), picture)
        at = int(np.argmin(np.abs(truth.t_unix_us - t_us)))
        rng = np.random.default_rng([seed, number])
        known = Hints(
            alt_amsl_m=float(truth.alt_amsl_m[at] + rng.normal(0.0, HEIGHT_STD_M)),
            heading_deg=math.degrees(truth.yaw_rad[at]) % 360.0 + float(rng.normal(0.0, HEADING_STD_DEG)),
        )
        yield t_us, Shot(path, math.degrees(truth.lat_rad[at]), math.degrees(truth.lon_rad[at]), known)
    capture.release()


def run_flight(data: Path, name: str, every: int, seed: int, console: Console) -> dict[str, Any]:
    """Locate the clicks of one flight, and what came of it."""
    flight = FlightFolder.open(data / "flights" / name)
    profile = profile_of_flight(flight.meta)
    if profile is None or flight.reference_path is None:
        message = f"{flight.path}: camera and reference are needed"
        raise typer.BadParameter(message)
    known = flight.targets_truth()
    session = PhotoSession(flight.reference_path, flight.elevation_path, profile)
    misses: list[Miss] = []
    clicked, pictures, located = 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        found = list(sightings(flight, data, every, seed, Path(folder)))
        for index, sighting in enumerate(track(found, name, console=console, transient=True)):
            rng = np.random.default_rng([seed, index, len(name)])
            hints = hints_for(sighting.shot, rng.normal(0.0, PRIOR_STD_M, 2), PRIOR_STD_M, disc=False)
            pixels = [(click.u_px, click.v_px) for click in sighting.clicks]
            pictures, clicked = pictures + 1, clicked + len(pixels)
            try:
                placed = locate_pixels(session, sighting.shot.path, pixels, hints, TargetOptions())
            except PhotoTargetError as error:
                console.print(f"refused: {error}", markup=False)
                continue
            located += 1
            for click, target in zip(sighting.clicks, placed.targets, strict=True):
                miss = miss_of(target, known[click.target], placed.placement.by)
                if miss is None:
                    console.print(f"refused: {sighting.shot.path.name} {click.target}: {target.reason}", markup=False)
                else:
                    misses.append(miss)
    session.close()
    return {"flight": name, "pictures": pictures, "located": located, "clicks": clicked, **summary(misses)}


def miss_of(target: PhotoTarget, truth: TargetTruth, by: str) -> Miss | None:
    """One answer beside the truth; None where there is no coordinate."""
    found, ray = target.found, target.ray
    if found is None:
        return None
    error_m, nees = _miss(found.lat_rad, found.lon_rad, found.cov_ned_m2[:2, :2], truth)
    mine = error_m, nees, circular_error_m(found.cov_ned_m2[:2, :2])
    if ray is None:
        return Miss(by, *mine, math.nan, math.nan, math.nan)
    cov = ray.cov_ned_m2[:2, :2]
    return Miss(by, *mine, *_miss(ray.lat_rad, ray.lon_rad, cov, truth), circular_error_m(cov))


def _miss(lat_rad: float, lon_rad: float, cov_ne_m2: Float, truth: TargetTruth) -> tuple[float, float]:
    d = LocalFrame(truth.lat_rad, truth.lon_rad, 0.0).ne_from_geodetic(lat_rad, lon_rad)
    return float(np.hypot(*d)), float(d @ np.linalg.solve(cov_ne_m2, d))


def summary(misses: list[Miss]) -> dict[str, Any]:
    """Circular errors that half and nine tenths stay below, and how the stated uncertainty fits them."""
    if not misses:
        return {"answered": 0}
    error, ray = np.array([m.error_m for m in misses]), np.array([m.ray_error_m for m in misses])
    nees, ray_nees = np.array([m.nees for m in misses]), np.array([m.ray_nees for m in misses])
    return {
        "answered": len(misses),
        "by_windows": sum(m.by == "windows" for m in misses),
        "ce50_m": float(np.percentile(error, 50)),
        "ce90_m": float(np.percentile(error, 90)),
        "worst_m": float(error.max()),
        "stated_ce90_m": float(np.median([m.ce90_m for m in misses])),
        "nees_2d_mean": float(nees.mean()),
        "in_ellipse95": float(np.mean(nees <= CHI2_95_2DOF)),
        "ray_ce50_m": float(np.nanpercentile(ray, 50)),
        "ray_ce90_m": float(np.nanpercentile(ray, 90)),
        "ray_stated_ce90_m": float(np.nanmedian([m.ray_ce90_m for m in misses])),
        "ray_nees_2d_mean": float(np.nanmean(ray_nees)),
        "ray_in_ellipse95": float(np.mean(ray_nees <= CHI2_95_2DOF)),
    }


def main(
    data: Annotated[Path, typer.Option(help="The evaluation data.")] = Path("../shared/data"),
    only: Annotated[str | None, typer.Option(help=f"One flight: {', '.join(FLIGHTS)}.")] = None,
    seed: Annotated[int, typer.Option(help="Of the priors' errors.")] = 101,
    short: Annotated[bool, typer.Option("--short", help="Every twelfth picture.")] = False,
    every: Annotated[int, typer.Option(min=1, help="Take one picture of so many.")] = 3,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Locate recorded clicks on single pictures and print how far they are from the truth."""
    console = Console(stderr=True)
    if only is not None and only not in FLIGHTS:
        raise typer.BadParameter(f"--only {only}: the flights are {', '.join(FLIGHTS)}")
    step = 12 if short else every
    rows = [run_flight(data, name, step, seed, console) for name in ([only] if only else FLIGHTS)]
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    titles = (
        "flight", "pictures", "located", "clicks", "answered", "CE50 m", "CE90 m", "stated", "NEES", "in 95 %",
        "ray CE50", "ray CE90", "ray stated", "ray NEES", "ray in 95 %",
    )  # fmt: skip
    table = Table(*titles, box=None)
    keys = (
        "ce50_m", "ce90_m", "stated_ce90_m", "nees_2d_mean", "in_ellipse95", "ray_ce50_m", "ray_ce90_m",
        "ray_stated_ce90_m", "ray_nees_2d_mean", "ray_in_ellipse95",
    )  # fmt: skip
    for r in rows:
        counts = [str(r[k]) for k in ("pictures", "located", "clicks", "answered")]
        table.add_row(r["flight"], *counts, *(f"{r[k]:.2f}" if k in r else "" for k in keys))
    Console(width=160).print(table)


if __name__ == "__main__":
    typer.run(main)
