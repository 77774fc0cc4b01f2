"""``python -m benchmarks.smoothing``: what later fixes make of states and targets from while the map was out of reach.

Flights with truth are replayed with the map hidden from the matcher for some time, again and again, while GPS is
denied. The states of those times, and the rays of the clicks made in them, are compared with the truth: by what the
filter knew then, and by what it knew some seconds after the map had come back.
"""

from __future__ import annotations

import json
import math
import tempfile
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from backend.navigation.setup import NavigationSetup
from backend.pointing import CLICK_STD_PX
from backend.replay.offline import ReplayOptions, navigation_setup, replay_flight
from estimator.errors import GeometryError
from estimator.geometry.local import LocalFrame
from estimator.navigator_config import NavigatorConfig
from estimator.ports import MapWindow, ReferenceMap
from estimator.smoothing import smooth
from estimator.targets.ray import locate_ray
from estimator.types import Float, NavigationState, Sample
from geodata.flight import FlightFolder

FIRST_S, SEEN_S, AFTER_S, STEP_S = 10.0, 15.0, 10.0, 1.0
SAME_PICTURE_US = 60_000
FILTER, SMOOTHED = "then", "later"
STATE, TARGET = "state", "click, ray"


@dataclass(slots=True)
class HiddenMap:
    """A reference map that can be hidden: then nothing of it is valid."""

    reference: ReferenceMap
    hidden: bool = False

    @property
    def gsd_m(self) -> float:
        """Of the map."""
        return self.reference.gsd_m

    @property
    def bounds_ne_m(self) -> tuple[float, float, float, float]:
        """Of the map."""
        return self.reference.bounds_ne_m

    def window(self, north_min_m: float, east_min_m: float, north_max_m: float, east_max_m: float) -> MapWindow:
        """Of the map; all invalid while it is hidden."""
        window = self.reference.window(north_min_m, east_min_m, north_max_m, east_max_m)
        return _Blank(window) if self.hidden else window


class _Blank:
    def __init__(self, window: MapWindow) -> None:
        self.image = np.zeros_like(window.image)
        self.valid = np.zeros_like(window.valid)
        self.north_max_m, self.east_min_m, self.gsd_m = window.north_max_m, window.east_min_m, window.gsd_m


@dataclass(slots=True)
class Hiding:
    """Hides the map during spans of a replay, in Unix microseconds."""

    spans_us: list[tuple[float, float]]
    map: HiddenMap | None = None

    def setup(self, setup: NavigationSetup) -> NavigationSetup:
        """With the map that can be hidden."""
        if setup.reference is not None:
            self.map = HiddenMap(setup.reference)
        return replace(setup, reference=self.map)

    def sample(self, sample: Sample) -> Sample:
        """As it is; its time says whether the map is hidden."""
        if self.map is not None:
            self.map.hidden = any(start <= sample.t_us < end for start, end in self.spans_us)
        return sample


@dataclass(slots=True)
class Errors:
    """Horizontal errors (2,) with their covariances (2, 2)."""

    error_ne_m: list[Float] = field(default_factory=list)
    cov_ne_m2: list[Float] = field(default_factory=list)

    def add(self, error_m: Float, cov_m2: Float) -> None:
        """Take one in, north and east of a vector (3,) or (2,)."""
        self.error_ne_m.append(np.asarray(error_m[:2]))
        self.cov_ne_m2.append(np.asarray(cov_m2[:2, :2]))

    def figures(self) -> dict[str, float]:
        """Count, errors, what was stated, normalised squared error per axis, share inside the stated 90 %."""
        if not self.error_ne_m:
            return {"count": 0}
        error, cov = np.array(self.error_ne_m), np.array(self.cov_ne_m2)
        d2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error)
        length = np.linalg.norm(error, axis=1)
        return {
            "count": len(error), "rms_m": float(np.sqrt(np.mean(length**2))), "ce50_m": float(np.median(length)),
            "ce90_m": float(np.percentile(length, 90)),
            "stated_rms_m": float(np.sqrt(np.mean(np.trace(cov, axis1=1, axis2=2)))),
            "nees_per_axis": float(np.mean(d2) / 2.0), "inside_90": float(np.mean(d2 < 4.605)),
        }  # fmt: skip


def spans_of(folder: FlightFolder, hidden_s: float) -> list[tuple[float, float]]:
    """When the map is hidden: while GPS is denied, and so that it is seen again before that ends."""
    found: list[tuple[float, float]] = []
    for first_us, last_us in folder.meta.gps_denied:
        starts = np.arange(
            first_us + FIRST_S * 1e6, last_us - (hidden_s + AFTER_S) * 1e6 + 1.0, (hidden_s + SEEN_S) * 1e6
        )
        found += [(float(start), float(start) + hidden_s * 1e6) for start in starts]
    return found


def run_flight(folder: FlightFolder, hidden_s: float, found: dict[tuple[str, str], Errors]) -> None:
    """Replay a flight and add its errors to ``found``."""
    spans = spans_of(folder, hidden_s)
    with tempfile.TemporaryDirectory(prefix="pilotage-smoothing-") as out:
        result = replay_flight(folder, Path(out), None, ReplayOptions(alteration=Hiding(spans)))
    setup = navigation_setup(folder)
    fixed = setup.gimbal == "fixed"
    clock = result.report["video_clock"] or {}
    offset_us = round(1e6 * (clock.get("time_offset_s") or 0.0)) or folder.time_offset_us or 0
    for start_us, end_us in spans:
        kept = [each for each in result.corrected if start_us - 2e6 <= each.after.t_us <= end_us + AFTER_S * 1e6]
        smoothed = smooth(kept, NavigatorConfig().noise)
        told_us = start_us
        for state in (each.after for each in kept):
            later = smoothed.at(state.t_us, setup.frame, camera_is_fixed=fixed)
            if told_us <= state.t_us < end_us and later is not None:
                told_us = state.t_us + STEP_S * 1e6
                _compare_states(folder, setup.frame, state, later, found)
        by_time = {each.after.t_us: each.after for each in kept}
        for click in folder.clicks():
            t_us = click.t_video_us + offset_us
            nearest = min(by_time, key=partial(_apart, t_us)) if by_time else 0
            later = smoothed.at(nearest, setup.frame, camera_is_fixed=fixed)
            if start_us <= t_us < end_us and abs(nearest - t_us) < SAME_PICTURE_US and later is not None:
                for when, state in ((FILTER, by_time[nearest]), (SMOOTHED, later)):
                    _compare_click(folder, setup, state, (click.u_px, click.v_px), click.target, found[TARGET, when])


def _apart(a_us: int, b_us: int) -> int:
    return abs(a_us - b_us)


def _compare_states(
    folder: FlightFolder, frame: LocalFrame, then: NavigationState, later: NavigationState,
    found: dict[tuple[str, str], Errors],
) -> None:  # fmt: skip
    truth = folder.truth()
    if truth is None:
        message = f"{folder.path}: truth.csv is needed"
        raise typer.BadParameter(message)
    at = (np.interp(then.t_us, truth.t_unix_us, part) for part in (truth.lat_rad, truth.lon_rad, truth.alt_amsl_m))
    true = frame.ned_from_geodetic(*(float(value) for value in at))
    for when, state in ((FILTER, then), (SMOOTHED, later)):
        found[STATE, when].add(state.pos_ned_m - true, state.cov_pos_ned_m2)


def _compare_click(
    folder: FlightFolder, setup: NavigationSetup, state: NavigationState, uv_px: tuple[float, float], name: str,
    errors: Errors,
) -> None:  # fmt: skip
    truth = folder.targets_truth().get(name)
    if truth is None:
        return
    ground_std_m, slope_std = setup.ground_errors(state)
    try:
        place = locate_ray(
            state, setup.camera, uv_px, setup.ground, setup.frame, ground_std_m, CLICK_STD_PX, slope_std=slope_std
        )
    except GeometryError:
        return  # above the horizon
    true = setup.frame.ned_from_geodetic(truth.lat_rad, truth.lon_rad, place.alt_amsl_m)
    errors.add(place.pos_ned_m - true, place.cov_ned_m2)


def main(
    flights: Annotated[list[Path], typer.Argument(help="Flight folders with truth.")],
    hidden_s: Annotated[float, typer.Option(help="How long the map is hidden.")] = 30.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Replay flights with the map hidden at times, and print errors of then and of later."""
    found = {(what, when): Errors() for what in (STATE, TARGET) for when in (FILTER, SMOOTHED)}
    console = Console(stderr=True)
    for flight in flights:
        console.print(f"{flight.name} ...")
        run_flight(FlightFolder.open(flight), hidden_s, found)
    rows = {f"{what}, {when}": errors.figures() for (what, when), errors in found.items()}
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    keys = ("rms_m", "ce50_m", "ce90_m", "stated_rms_m", "nees_per_axis", "inside_90")
    table = Table("of", "count", *keys, box=None)
    for name, row in rows.items():
        table.add_row(name, f"{row['count']:.0f}", *(f"{row.get(key, math.nan):.2f}" for key in keys))
    Console(width=140).print(table)


if __name__ == "__main__":
    typer.run(main)
