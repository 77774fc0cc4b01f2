"""``python -m benchmarks.landings``: closed-loop landings on a pad without GPS, in wind with gusts.

Each seed is another world, wind, approach and set of sensor errors (``benchmarks.landing_flights``). A line of each
landing is printed as it ends, and kept, so that what was measured until an interruption is not lost.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from benchmarks.kept_lines import finite, measured
from benchmarks.landing_flights import Landing, LandingLoop
from benchmarks.studies.cli import parse_seeds
from guidance.landing import LandingPhase
from simulator.cli import default_cache

MEAN_M, ALL_M = 0.15, 0.50
GIMBALS = ("pan_tilt", "fixed")


@dataclass(frozen=True, slots=True)
class Summary:
    """Of landings that stood on the ground: error of the first touch, mean and worst, in metres."""

    landings: int
    landed: int
    aborted: int
    not_begun: int
    touch_mean_m: float
    touch_p95_m: float
    touch_max_m: float
    within_15_cm: int
    sink_max_m_s: float
    estimate_rms_m: float
    seconds_mean: float
    blind_mean_s: float


def summary(landings: Sequence[Landing]) -> Summary:
    """The figures of some landings; those of the touchdown are NaN where none was."""
    landed = [one for one in landings if one.outcome == LandingPhase.LANDED]
    touch = np.array([one.touch_m for one in landed])
    off = np.array([one.estimate_m for one in landed])
    none = math.nan
    return Summary(
        landings=len(landings), landed=len(landed),
        aborted=sum(one.outcome.startswith("abort") for one in landings),
        not_begun=sum(one.outcome == "not begun" for one in landings),
        touch_mean_m=float(touch.mean()) if landed else none,
        touch_p95_m=float(np.quantile(touch, 0.95)) if landed else none,
        touch_max_m=float(touch.max()) if landed else none,
        within_15_cm=int(np.sum(touch <= MEAN_M)),
        sink_max_m_s=max((one.sink_m_s for one in landed), default=none),
        estimate_rms_m=float(np.sqrt(np.mean(off**2))) if landed else none,
        seconds_mean=float(np.mean([one.landing_s for one in landed])) if landed else none,
        blind_mean_s=float(np.mean([one.blind_s for one in landed])) if landed else none,
    )  # fmt: skip


def line(landing: Landing) -> str:
    """One landing in words."""
    found = f"seed {landing.seed}: {landing.outcome}"
    if landing.reason:
        found += f" ({landing.reason})"
    return (
        f"{found}, touched {landing.touch_m:.3f} m off at {landing.sink_m_s:.2f} m/s, "
        f"estimate {landing.estimate_m:.3f} m off, wind {landing.wind_m_s:.1f} m/s, {landing.landing_s:.0f} s, "
        f"{landing.times_real_time:.2f} x real time"
    )


def main(
    seeds: Annotated[str, typer.Option(help="One landing each, FIRST-LAST.")] = "401-600",
    share: Annotated[float, typer.Option(min=0.005, max=1.0, help="So much of the seeds only, the first.")] = 1.0,
    gimbal: Annotated[str, typer.Option(help=f"One of {', '.join(GIMBALS)}.")] = GIMBALS[0],
    out: Annotated[Path | None, typer.Option(help="File of JSON lines, one a landing; seeds in it are kept.")] = None,
    cache: Annotated[Path | None, typer.Option(help="Folder that keeps the worlds.")] = None,
) -> None:
    """Land again and again; exit status 1 where a bound is missed."""
    if gimbal not in GIMBALS:
        raise typer.BadParameter(f"--gimbal '{gimbal}': it is one of {', '.join(GIMBALS)}")
    cv2.setNumThreads(1)
    chosen = parse_seeds(seeds, False)
    chosen = chosen[: max(1, round(share * len(chosen)))]
    folder = cache or default_cache()
    landings = measured(chosen, Landing, lambda seed: _land(seed, gimbal, folder), line, out)
    found = summary(landings)
    typer.echo(json.dumps(finite(asdict(found)), indent=1))
    if not (found.landed and found.touch_mean_m <= MEAN_M and found.touch_max_m <= ALL_M):
        raise typer.Exit(1)


def _land(seed: int, gimbal: str, cache: Path) -> Landing:
    with tempfile.TemporaryDirectory(prefix="pilotage-landing-") as scratch:
        return LandingLoop(seed, gimbal, Path(scratch), cache).fly()


app = typer.Typer(add_completion=False)
app.command()(main)

if __name__ == "__main__":
    app()
