"""``pilotage bench``: every budget of the design beside what this machine does."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from benchmarks.budget import Measurement, missed, print_table, unmeasured
from benchmarks.flying import CannotFlyError, FlyingStation, flying_station

FULL_SOAK_MIN, SHORT_SOAK_MIN = 5.0, 0.3


class Part(StrEnum):
    """What can be measured alone."""

    STAGES = "stages"
    REPLAY = "replay"
    BROWSER = "browser"
    CLICKS = "clicks"
    VIEWERS = "viewers"
    MEMORY = "memory"


def register(app: typer.Typer) -> None:
    """Add the command to the console command."""
    app.command("bench", epilog="Example: pilotage bench --short --only viewers")(bench)


def bench(
    short: Annotated[bool, typer.Option("--short", help="A minute or two in all, less exact.")] = False,
    only: Annotated[list[Part] | None, typer.Option(help="One part; repeatable. All by default.")] = None,
    flight: Annotated[Path | None, typer.Option(help="Replay this flight instead of a simulated one.")] = None,
    soak_minutes: Annotated[
        float | None, typer.Option(min=0.1, help="How long to watch the memory  [5; 0.3 with --short]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Measure the budgets: stages, replay, browser, clicks, viewers, memory. Exit status 1 where one is missed."""
    console = Console(stderr=True)
    parts = set(only or Part)
    found: list[Measurement] = []
    with tempfile.TemporaryDirectory(prefix="pilotage-bench-") as scratch:
        folder = Path(scratch)
        if Part.STAGES in parts:
            from benchmarks.stages import measure_stages  # noqa: PLC0415  keeps the estimator out of --help

            console.print("stages ...")
            found += measure_stages(short)
        if Part.REPLAY in parts:
            from benchmarks.replay import measure_replay  # noqa: PLC0415

            console.print("replay ...")
            found += measure_replay(folder, short, flight)
        minutes = soak_minutes or (SHORT_SOAK_MIN if short else FULL_SOAK_MIN)
        found += _measure_flying(folder, parts, short, minutes, console)
    if as_json:
        typer.echo(json.dumps([m.as_dict() for m in found], indent=1))
    else:
        print_table(found, Console())
    if missed(found):
        raise typer.Exit(1)


def main() -> None:
    """Run the command alone."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    register(app)
    app()


def _measure_flying(folder: Path, parts: set[Part], short: bool, minutes: float, console: Console) -> list[Measurement]:
    from benchmarks.browser import measure_browser  # noqa: PLC0415
    from benchmarks.clicks import measure_clicks  # noqa: PLC0415
    from benchmarks.memory import measure_memory  # noqa: PLC0415
    from benchmarks.viewers import measure_viewers  # noqa: PLC0415

    measures: dict[Part, Callable[[FlyingStation], list[Measurement]]] = {
        Part.BROWSER: lambda station: measure_browser(station, short),
        Part.CLICKS: lambda station: measure_clicks(station, short),
        Part.VIEWERS: lambda station: measure_viewers(station, short),
        # Last: what browsers and viewers left behind counts.
        Part.MEMORY: lambda station: measure_memory(station, minutes),
    }
    wanted = [part for part in measures if part in parts]
    if not wanted:
        return []
    found: list[Measurement] = []
    console.print("starting a station and a simulated aircraft ...")
    try:
        with flying_station(folder) as station:
            for part in wanted:
                console.print(f"{part} ...")
                found += measures[part](station)
    except CannotFlyError as error:
        return found + unmeasured(wanted, str(error))
    return found
