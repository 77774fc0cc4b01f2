"""``python -m benchmarks.homings``: closed-loop flights home by vision without GPS, in wind with gusts.

Each seed is another world, wind, route, home and set of sensor errors (``benchmarks.homing_flights``). A line of each
flight is printed as it ends, and kept, so that what was measured until an interruption is not lost.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
import typer

from benchmarks.homing_flights import Homing, HomingLoop
from benchmarks.kept_lines import finite, measured
from benchmarks.studies.cli import parse_seeds
from guidance.homing import HomingPhase
from simulator.cli import default_cache

ALL_M, AIM_M = 5.0, 1.5


@dataclass(frozen=True, slots=True)
class Summary:
    """Distances from home of the first touch, in metres; ``rms_m`` is the estimate's error on all ways together."""

    flights: int
    landed: int
    touch_mean_m: float
    touch_max_m: float
    within_5_m: int
    within_1_5_m: int
    rms_m: float
    worst_m: float
    beyond_5_sigmas: int
    aside_max_m: float
    seconds_mean: float


def summary(flights: Sequence[Homing]) -> Summary:
    """The figures of some flights; those of the touchdown are NaN where none was."""
    landed = [one for one in flights if one.outcome == HomingPhase.LANDED]
    touch = np.array([one.touch_m for one in landed])
    none = math.nan
    return Summary(
        flights=len(flights), landed=len(landed),
        touch_mean_m=float(touch.mean()) if landed else none, touch_max_m=float(touch.max()) if landed else none,
        within_5_m=int(np.sum(touch <= ALL_M)), within_1_5_m=int(np.sum(touch <= AIM_M)),
        rms_m=float(np.sqrt(np.mean([one.rms_m**2 for one in flights]))) if flights else none,
        worst_m=max((one.worst_m for one in flights), default=none),
        beyond_5_sigmas=sum(one.worst_sigmas > 5.0 for one in flights),
        aside_max_m=max((one.aside_m for one in landed), default=none),
        seconds_mean=float(np.mean([one.home_s for one in landed])) if landed else none,
    )  # fmt: skip


def line(flight: Homing) -> str:
    """One flight in words."""
    found = f"seed {flight.seed}: {flight.outcome}"
    if flight.reason:
        found += f" ({flight.reason})"
    return (
        f"{found}, touched {flight.touch_m:.2f} m from home, estimate {flight.estimate_m:.2f} m off "
        f"(said {flight.estimate_std_m:.2f}), on the way rms {flight.rms_m:.2f}, worst {flight.worst_m:.1f} m "
        f"({flight.worst_sigmas:.1f} sigmas), {flight.aside_m:.1f} m aside, wind {flight.wind_m_s:.1f} m/s, "
        f"{flight.home_s:.0f} s, {flight.times_real_time:.2f} x real time"
    )


def main(
    seeds: Annotated[str, typer.Option(help="One flight each, FIRST-LAST.")] = "1001-1020",
    blind: Annotated[str, typer.Option(help="FROM-TO: no pictures between these seconds of the flight home.")] = "",
    when_lost: Annotated[str, typer.Option(help="hold or land, where the estimate stays lost.")] = "hold",
    out: Annotated[Path | None, typer.Option(help="File of JSON lines, one a flight; seeds in it are kept.")] = None,
    cache: Annotated[Path | None, typer.Option(help="Folder that keeps the worlds.")] = None,
) -> None:
    """Fly home again and again; exit status 1 where one does not stand within the bound."""
    cv2.setNumThreads(1)
    lost = _when_lost(when_lost)
    blind_s = _span(blind)
    folder = cache or default_cache()

    def fly(seed: int) -> Homing:
        with tempfile.TemporaryDirectory(prefix="pilotage-homing-") as scratch:
            return HomingLoop(seed, Path(scratch), folder, lost, blind_s).fly()

    flights = measured(parse_seeds(seeds, False), Homing, fly, line, out)
    found = summary(flights)
    typer.echo(json.dumps(finite(asdict(found)), indent=1))
    if found.within_5_m < found.flights:
        raise typer.Exit(1)


def _when_lost(word: str) -> Literal["hold", "land"]:
    if word == "hold":
        return "hold"
    if word == "land":
        return "land"
    raise typer.BadParameter(f"--when-lost '{word}': it is hold or land")


def _span(text: str) -> tuple[float, float] | None:
    if not text:
        return None
    try:
        start, end = (float(part) for part in text.split("-"))
    except ValueError:
        raise typer.BadParameter(f"--blind '{text}': it is FROM-TO, in seconds") from None
    if not 0.0 <= start < end < math.inf:
        raise typer.BadParameter(f"--blind '{text}': it does not end after its start")
    return start, end


app = typer.Typer(add_completion=False)
app.command()(main)

if __name__ == "__main__":
    app()
