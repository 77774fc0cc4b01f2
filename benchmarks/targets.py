"""``python -m benchmarks.targets``: how far the targets of replayed flights are from where they are.

Flights with ``clicks.csv`` and ``targets_truth.csv`` are replayed as ``pilotage replay`` does, with GPS as recorded and
with what is kept from the estimator by their ``gps_denied``. Single clicks by each method, and all clicks of a target
fused, are compared with the truth.
"""

from __future__ import annotations

import csv
import json
import math
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from backend.replay.offline import replay_flight
from estimator.geometry.local import LocalFrame
from geodata.flight import FlightFolder
from geodata.flight_tables import TargetTruth

GPS, DENIED = "gps", "denied"
FLIGHTS = ("plane_80m", "copter_120m", "ariel_b")
CLICK = "1 click, "
TARGET = "target"


@dataclass(frozen=True, slots=True)
class Miss:
    """How far one coordinate is off, north and east, and the CE90 that was stated with it."""

    what: str
    north_m: float
    east_m: float
    ce90_m: float


def with_gps(flight: Path, folder: Path) -> Path:
    """The same flight with nothing denied, its files linked into ``folder``."""
    folder.mkdir(parents=True)
    for file in flight.iterdir():
        if file.name != "flight.json":
            (folder / file.name).symlink_to(file.resolve())
    meta = json.loads((flight / "flight.json").read_text(encoding="utf-8"))
    meta["gps_denied"] = []
    (folder / "flight.json").write_text(json.dumps(meta), encoding="utf-8")
    return folder


def misses(out: Path, known: dict[str, TargetTruth]) -> list[Miss]:
    """What a replay's ``targets.csv`` and ``sightings.csv`` are off by; what has no place or no truth is left out."""
    found = [miss for row in _rows(out / "targets.csv") if (miss := _miss(TARGET, row, known)) is not None]
    for row in _rows(out / "sightings.csv"):
        miss = _miss(CLICK + row["method"].partition("_")[0], row, known) if row["ce90_m"] else None
        found += [] if miss is None else [miss]
    return found


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _miss(what: str, row: dict[str, str], known: dict[str, TargetTruth]) -> Miss | None:
    truth = known.get(row["target"])
    if truth is None:
        return None
    return miss_of(what, truth, float(row["lat_deg"]), float(row["lon_deg"]), float(row["ce90_m"]))


def miss_of(what: str, truth: TargetTruth, lat_deg: float, lon_deg: float, ce90_m: float) -> Miss:
    """How far a coordinate, given with its CE90, is off the truth."""
    local = LocalFrame(truth.lat_rad, truth.lon_rad, 0.0)
    north, east = local.ne_from_geodetic(math.radians(lat_deg), math.radians(lon_deg))
    return Miss(what, float(north), float(east), ce90_m)


def summary(found: Iterable[Miss]) -> dict[str, dict[str, float]]:
    """By what was asked: circular errors that half and nine tenths stay below, and how the stated ones fit them."""
    by_what: dict[str, list[Miss]] = {}
    for miss in found:
        by_what.setdefault(miss.what, []).append(miss)
    return {what: _figures(of) for what, of in sorted(by_what.items())}


def _figures(of: list[Miss]) -> dict[str, float]:
    error = np.hypot([m.north_m for m in of], [m.east_m for m in of])
    stated = np.array([m.ce90_m for m in of])
    return {
        "count": len(of),
        "ce50_m": float(np.percentile(error, 50)),
        "ce90_m": float(np.percentile(error, 90)),
        "worst_m": float(error.max()),
        "stated_ce90_m": float(np.median(stated)),
        "inside_ce90": float(np.mean(error <= stated)),
        "mean_north_m": float(np.mean([m.north_m for m in of])),
        "mean_east_m": float(np.mean([m.east_m for m in of])),
    }


def run_flight(flight: Path, denied: bool, scratch: Path) -> dict[str, Any]:
    """Replay one flight and compare."""
    told = DENIED if denied else GPS
    folder = FlightFolder.open(flight if denied else with_gps(flight, scratch / f"{flight.name}-{told}"))
    known = folder.targets_truth()
    if not known or not folder.clicks():
        message = f"{flight}: clicks.csv and targets_truth.csv are needed"
        raise typer.BadParameter(message)
    out = scratch / f"{flight.name}-{told}-out"
    replay_flight(folder, out)
    clicked = {click.target for click in folder.clicks()}
    return {
        "flight": flight.name, "gps": told, "targets": len(known), "clicked": len(clicked & set(known)),
        "found": summary(misses(out, known)),
    }  # fmt: skip


def main(
    flights: Annotated[list[Path] | None, typer.Argument(help="Flight folders; the evaluation's by default.")] = None,
    data: Annotated[Path, typer.Option(help="The evaluation data.")] = Path("../shared/data"),
    only: Annotated[str | None, typer.Option(help=f"{GPS} or {DENIED}; both by default.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Replay flights and print how far clicks and targets are from the truth."""
    if only not in (None, GPS, DENIED):
        raise typer.BadParameter(f"--only {only}: {GPS} or {DENIED}")
    console = Console(stderr=True)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="pilotage-targets-") as scratch:
        for flight in flights or [data / "flights" / name for name in FLIGHTS]:
            for told in (GPS, DENIED) if only is None else (only,):
                console.print(f"{flight.name}, {told} ...")
                rows.append(run_flight(flight, told == DENIED, Path(scratch)))
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    keys = ("ce50_m", "ce90_m", "worst_m", "stated_ce90_m", "inside_ce90", "mean_north_m", "mean_east_m")
    titles = ("CE50 m", "CE90 m", "worst m", "stated CE90 m", "inside CE90", "mean N m", "mean E m")
    table = Table("flight", "GPS", "by", "count", *titles, box=None)
    for row in rows:
        for what, of in row["found"].items():
            table.add_row(row["flight"], row["gps"], what, f"{of['count']:.0f}", *(f"{of[k]:.2f}" for k in keys))
    Console(width=140).print(table)


if __name__ == "__main__":
    typer.run(main)
