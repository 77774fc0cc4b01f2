"""``pilotage map``: import, show, list and delete reference imagery and elevation."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from geodata.errors import GeodataError
from geodata.maps import MapLibrary, MapRecord, guess_kind
from geodata.matchability import add_to_library, matchability_of, write_numbers
from geodata.raster import LatLonBounds, open_raster


class Kind(StrEnum):
    """What a raster shows."""

    IMAGERY = "imagery"
    ELEVATION = "elevation"


DataDir = Annotated[
    Path | None,
    typer.Option("--data-dir", envvar="PILOTAGE_DATA_DIR", help="The station's data folder.", show_default=False),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def register(app: typer.Typer) -> None:
    """Add ``map`` and its commands to the console command."""
    group = typer.Typer(no_args_is_help=True, help="Reference imagery and elevation: GeoTIFF of any CRS.")
    group.command("import", epilog="Example: pilotage map import ortho.tif --name Farm")(import_map)
    group.command("info", epilog="Example: pilotage map info ortho.tif")(info)
    group.command("list", epilog="Example: pilotage map list --json")(list_maps)
    group.command("matchability", epilog="Example: pilotage map matchability ortho.tif --out layer.tif --footprint 80")(
        matchability
    )
    group.command("delete", epilog="Example: pilotage map delete 3fa92c10b77e")(delete)
    app.add_typer(group, name="map")


def library_folder(data_dir: Path | None) -> Path:
    """Where the station keeps its maps."""
    if data_dir is None:
        base = os.environ.get("XDG_DATA_HOME")
        data_dir = (Path(base) if base else Path.home() / ".local" / "share") / "pilotage"
    return data_dir / "maps"


def import_map(
    file: Annotated[Path, typer.Argument(help="A GeoTIFF or other georeferenced raster.", show_default=False)],
    name: Annotated[str | None, typer.Option(help="Name to show; the file's own by default.")] = None,
    kind: Annotated[Kind | None, typer.Option(help="What it shows; guessed when not given.")] = None,
    data_dir: DataDir = None,
    as_json: AsJson = False,
) -> None:
    """Check a raster and convert it into the station's map library."""
    with _errors_shown(), Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f"importing {file.name}", total=1.0)
        record = MapLibrary(library_folder(data_dir)).import_file(
            file,
            name,
            None if kind is None else ("imagery" if kind is Kind.IMAGERY else "elevation"),
            lambda part: progress.update(task, completed=part),
        )
    _show(record.model_dump(mode="json"), as_json)


def info(
    map_or_file: Annotated[str, typer.Argument(help="A map's id, or a raster file.", show_default=False)],
    data_dir: DataDir = None,
    as_json: AsJson = False,
) -> None:
    """Show what a map or a raster file is."""
    with _errors_shown():
        if Path(map_or_file).exists() or any(mark in map_or_file for mark in "/."):
            facts = _file_facts(Path(map_or_file))
        else:
            facts = MapLibrary(library_folder(data_dir)).get(map_or_file).model_dump(mode="json")
    _show(facts, as_json)


def list_maps(data_dir: DataDir = None, as_json: AsJson = False) -> None:
    """List the maps of the library."""
    with _errors_shown():
        library = MapLibrary(library_folder(data_dir))
        records, problems = library.list(), library.broken()
    for problem in problems:
        typer.echo(f"warning: {problem}", err=True)
    if as_json:
        typer.echo(json.dumps([record.model_dump(mode="json") for record in records], indent=1))
    elif records:
        _print_table(records)
    else:
        typer.echo(f"no maps in {library.folder}; add one with: pilotage map import FILE.tif")


def matchability(
    map_or_file: Annotated[str, typer.Argument(help="A map's id, or a raster file.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="GeoTIFF to write; in the library without, for the console.")] = None,
    footprint: Annotated[
        float, typer.Option(min=5.0, max=5000.0, help="Side of what a picture shows, metres.")
    ] = 100.0,
    radius: Annotated[float, typer.Option(min=5.0, max=2000.0, help="How far off the position may be, metres.")] = 40.0,
    data_dir: DataDir = None,
    as_json: AsJson = False,
) -> None:
    """Predict how well each place of a map can be matched, before flying there.

    Bands of the GeoTIFF: expected sigma along the worst axis in metres; probability of a wrong place within the radius;
    height of the peak in deviations of chance; kind of place (0 good, 1 ambiguous by repetition, 2 too little texture).
    """
    library = MapLibrary(library_folder(data_dir))
    is_file = Path(map_or_file).exists() or any(mark in map_or_file for mark in "/.")
    if is_file and out is None:
        raise typer.BadParameter("a file's layer needs --out FILE.tif; without it the map must be one of the library")
    if out is not None and is_file and out.resolve() == Path(map_or_file).resolve():
        raise typer.BadParameter("--out is the map itself")
    with _errors_shown(), Progress(console=Console(stderr=True), transient=True) as progress:
        path = Path(map_or_file) if is_file else library.raster_path(map_or_file)
        task = progress.add_task("predicting", total=1.0)
        layer = matchability_of(path, footprint, radius, lambda part: progress.update(task, completed=part))
        if out is not None:
            write_numbers(out, layer)
        else:
            add_to_library(library, map_or_file, layer)
    _show({**asdict(layer.summary), "file": str(out) if out else f"library, map {map_or_file}"}, as_json)


def delete(
    map_id: Annotated[str, typer.Argument(help="The map's id, from pilotage map list.", show_default=False)],
    data_dir: DataDir = None,
) -> None:
    """Delete a map from the library; the file it came from stays."""
    with _errors_shown():
        library = MapLibrary(library_folder(data_dir))
        library.delete(map_id)
    typer.echo(f"deleted {map_id}")


@contextmanager
def _errors_shown() -> Iterator[None]:
    try:
        yield
    except GeodataError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from error
    except OSError as error:
        typer.echo(f"error: {error.filename or 'data folder'}: {error.strerror or error}", err=True)
        raise typer.Exit(1) from error


def _file_facts(path: Path) -> dict[str, Any]:
    with open_raster(path) as raster:
        return {
            "file": str(raster.path),
            "kind": guess_kind(raster),
            "crs": raster.crs_name,
            "bounds": asdict(raster.bounds),
            "gsd_m": raster.gsd_m,
            "width_px": raster.width_px,
            "height_px": raster.height_px,
            "bands": raster.band_count,
            "dtype": str(raster.dtype),
            "alpha": raster.has_alpha,
            "nodata": None if raster.nodata is None or raster.nodata != raster.nodata else raster.nodata,
            "overviews": len(raster.levels) - 1,
        }


def _show(facts: dict[str, Any], as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        if key == "bounds":
            shown = _bounds_text(LatLonBounds(**value))
        else:
            shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        typer.echo(f"{key:<17}{shown}")


def _print_table(records: list[MapRecord]) -> None:
    table = Table(box=None, header_style="bold")
    for title in ("id", "name", "kind", "m/px", "size", "crs"):
        table.add_column(title)
    for record in records:
        size = f"{record.width_px} x {record.height_px}"
        table.add_row(record.id, record.name, record.kind, f"{record.gsd_m:.3g}", size, record.crs)
    Console().print(table)


def _bounds_text(bounds: LatLonBounds) -> str:
    return (
        f"{bounds.south_deg:.6f} to {bounds.north_deg:.6f} north, {bounds.west_deg:.6f} to {bounds.east_deg:.6f} east"
    )
