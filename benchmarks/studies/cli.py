"""``pilotage monte-carlo``: a named study over seeds, as a table, JSON and a plot."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

FIRST_SEED = 201
"""Studies fly seeds from here on: no constant of the estimator was chosen on them."""
SHORT_SEEDS, FULL_SEEDS = 2, 30
_RANGE = re.compile(r"^(\d+)(?:-(\d+))?$")


def register(app: typer.Typer) -> None:
    """Add the command to the console command."""
    app.command("monte-carlo", epilog="Example: pilotage monte-carlo ladder --seeds 201-230 --jobs 2 --resume")(
        monte_carlo
    )


def monte_carlo(
    study: Annotated[str, typer.Argument(help="ladder, odometry, ... ('list' names them all), or a TOML file.")],
    seeds: Annotated[
        str | None, typer.Option(help=f"A-B or A  [{FIRST_SEED}-{FIRST_SEED + FULL_SEEDS - 1}; --short: two seeds]")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, max=256, help="Processes at a time.")] = 1,
    short: Annotated[bool, typer.Option("--short", help="Shorter flights, fewer rows: minutes, less exact.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Take what the same code has already computed.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for STUDY.md, STUDY.json and STUDY.svg.")] = Path("docs/results"),
    cache: Annotated[Path | None, typer.Option(help="Folder that keeps flights and outcomes.")] = None,
) -> None:
    """Fly simulated flights, replay them under each of a study's configurations, and tabulate the errors.

    The same seeds and code give the same table, but for the milliseconds.
    """
    from benchmarks.studies.catalogue import STUDIES  # noqa: PLC0415  keeps estimator and simulator out of --help
    from benchmarks.studies.run import run_study  # noqa: PLC0415
    from benchmarks.studies.study_file import load_study  # noqa: PLC0415
    from benchmarks.studies.tables import table, write_results  # noqa: PLC0415

    console = Console(stderr=True)
    if study == "list":
        for name, build in STUDIES.items():
            typer.echo(f"{name:14} {build(short).title}")
        return
    chosen = parse_seeds(seeds, short)
    built = load_study(study, short, STUDIES)
    # before anything flies: hours of work must find their folder
    out.mkdir(parents=True, exist_ok=True)
    results = run_study(
        built, chosen, cache or default_cache(), jobs, resume,
        lambda text: console.print(text, markup=False, highlight=False),
    )  # fmt: skip
    span = f"{chosen[0]}-{chosen[-1]}" if len(chosen) > 1 else str(chosen[0])
    command = f"pilotage monte-carlo {study} --seeds {span}{' --short' if short else ''}"
    page = write_results(built, results, command, chosen, out)
    typer.echo(table(built, results))
    typer.echo(f"Written to {page}")
    if all(result.figures["seeds"] == 0 for result in results):
        console.print("Error: every run failed; the page says why", style="red")
        raise typer.Exit(1)


def parse_seeds(text: str | None, short: bool) -> list[int]:
    """Seeds of ``A-B`` or ``A``; the study's own where nothing is said.

    Raises
    ------
    typer.BadParameter
        Not of that form, or B before A.
    """
    if text is None:
        return list(range(FIRST_SEED, FIRST_SEED + (SHORT_SEEDS if short else FULL_SEEDS)))
    match = _RANGE.match(text)
    if match is None:
        raise typer.BadParameter(f"--seeds '{text}' is neither A nor A-B, as in 201-230")
    first = int(match[1])
    last = first if match[2] is None else int(match[2])
    if last < first or last - first >= 10_000:
        raise typer.BadParameter(f"--seeds '{text}' must run forward over at most 10000 seeds")
    return list(range(first, last + 1))


def default_cache() -> Path:
    """Where worlds, flights and outcomes are kept: the user's cache folder, whose worlds `pilotage sim` shares."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "pilotage"


def main() -> None:
    """Run the command alone."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    register(app)
    app()
