"""``pilotage fit-likelihood``: a calibration of one measure of similarity, fitted on seeds and checked on others."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.studies.cli import default_cache, parse_seeds

if TYPE_CHECKING:
    from benchmarks.likelihood.fit import Quality
    from estimator.registration.calibration import Calibration


def register(app: typer.Typer) -> None:
    """Add the command to the console command."""
    app.command("fit-likelihood", epilog="Example: pilotage fit-likelihood --channel mind --out mind.toml")(
        fit_likelihood
    )


def fit_likelihood(
    channel: Annotated[str, typer.Option(help="double_angle, intensity, edge_overlap or mind.")] = "double_angle",
    seeds: Annotated[str, typer.Option(help="Worlds to fit on, A-B or A.")] = "151-159",
    check_seeds: Annotated[str, typer.Option(help="Worlds to check on, none of the others.")] = "201-204",
    pictures: Annotated[int, typer.Option(min=5, max=600, help="Of each world's flight, a second apart.")] = 60,
    keep_likelihood: Annotated[
        bool, typer.Option("--keep-likelihood", help="Fit the outlier probability alone.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Write the calibration to this TOML file.")] = None,
    cache: Annotated[Path | None, typer.Option(help="Folder that keeps worlds and maps.")] = None,
) -> None:
    """Fit a channel's likelihood and outlier probability on simulated flights, and say how good they are on others.

    Right places are registered with drawn pose errors, wrong ones as well; takes minutes.
    """
    import cv2  # noqa: PLC0415  keeps estimator and simulator out of --help

    from benchmarks.likelihood.fit import fit, quality  # noqa: PLC0415
    from benchmarks.likelihood.samples import collect  # noqa: PLC0415
    from estimator.errors import CalibrationError  # noqa: PLC0415
    from estimator.registration.alignment import COMPARED, MatcherConfig  # noqa: PLC0415
    from estimator.registration.calibration import calibration_of, toml_of  # noqa: PLC0415

    if channel not in COMPARED:
        raise typer.BadParameter(f"--channel '{channel}' is none of: {', '.join(COMPARED)}")
    chosen, held = parse_seeds(seeds, False), parse_seeds(check_seeds, False)
    if set(chosen) & set(held):
        raise typer.BadParameter(
            f"--check-seeds {check_seeds} and --seeds {seeds} overlap: the check would be no check"
        )
    if out is not None and not out.parent.is_dir():
        raise typer.BadParameter(f"--out '{out}': there is no folder '{out.parent}'")
    console = Console(stderr=True)
    cv2.setNumThreads(1)
    folder = cache or default_cache()
    folder.mkdir(parents=True, exist_ok=True)

    def tell(text: str) -> None:
        console.print(text, markup=False, highlight=False)

    before = calibration_of(channel)
    config = MatcherConfig(channel, calibration=before)
    samples = collect(chosen, config, pictures, folder, tell)
    command = f"pilotage fit-likelihood --channel {channel} --seeds {seeds} --pictures {pictures}"
    command += " --keep-likelihood" if keep_likelihood else ""
    counts = {"pictures": sum(s.right_place for s in samples), "wrong_places": sum(not s.right_place for s in samples)}
    about: dict[str, str | int] = {"command": command, "seeds": seeds, "worlds": len(chosen), **counts}
    try:
        after = fit(samples, before, next_version(before.version, channel), about, keep_likelihood)
    except (ValueError, CalibrationError) as error:
        console.print(f"Error: {error}", style="red", markup=False)
        raise typer.Exit(1) from None
    if out is not None:
        out.write_text(toml_of(after), encoding="utf-8")
    checked = collect(held, config, pictures, folder, tell)
    results = [(c, quality(checked, c)) for c in (before, after)]
    Console().print(_table(results, len(checked)))
    typer.echo(toml_of(after) if out is None else f"Written to {out}")


def next_version(version: str, channel: str) -> str:
    """The version after ``channel/n``; the first one of a version that is none."""
    number = version.rpartition("/")[2]
    return f"{channel}/{int(number) + 1 if number.isdigit() else 1}"


def _table(results: list[tuple[Calibration, Quality]], count: int) -> Table:
    table = Table(
        "version", "nats a picture", "inside 50 / 90 / 95 %", "log loss", "AUC", "AUC, right places", "reliability",
        title=f"{count} registrations of the check seeds", box=None,
    )  # fmt: skip
    for calibration, q in results:
        inside = " / ".join(f"{100 * share:.0f}" for share in q.inside)
        table.add_row(
            calibration.version, f"{q.nats:.2f}", inside, f"{q.log_loss:.3f}", f"{q.auc:.3f}",
            f"{q.auc_right_places:.3f}", f"{q.reliability:.3f}",
        )  # fmt: skip
    for calibration, q in results:
        pairs = ", ".join(f"{100 * s:.1f}:{100 * f:.1f}" for s, f in zip(q.stated, q.found, strict=True))
        table.caption = f"{table.caption or ''}{calibration.version} stated:found wrong, %: {pairs}\n"
    return table


def main() -> None:
    """Run the command alone."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    register(app)
    app()
