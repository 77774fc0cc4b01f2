"""``pilotage locate``: where was this photo taken from?  And the registration of this package's commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from backend.errors import StationError
from backend.navigation.setup import read_camera_profile
from backend.photos.exports import as_object, write_answers
from backend.photos.hints import Hints, read_priors
from backend.photos.options import (
    Agl,
    AltAmsl,
    CameraFile,
    Elevation,
    GroundAlt,
    Heading,
    Hfov,
    MapFile,
    Near,
    Pitch,
    Priors,
    Radius,
    Roll,
    Sigma,
    UseExifGps,
    given_hints,
)
from backend.photos.session import PhotoAnswer, PhotoSession
from backend.photos.target_cli import locate_target
from geodata.errors import GeodataError
from geodata.photo import photos_in


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command("locate", epilog="Example: pilotage locate IMG_0518.jpg --map ortho.tif --near 41.035,-83.305 "
                "--radius 100 --agl 63 --hfov 70")(locate_photos)  # fmt: skip
    app.command("target", epilog="Example: pilotage target IMG_0518.jpg --pixel 1210,655 --map ortho.tif "
                "--elevation dtm.tif --near 41.035,-83.305 --agl 63 --hfov 70")(locate_target)  # fmt: skip


def locate_photos(
    photos: Annotated[list[Path], typer.Argument(help="Pictures, or folders of pictures.", show_default=False)],
    map: MapFile,
    elevation: Elevation = None,
    near: Near = None,
    radius: Radius = None,
    sigma: Sigma = None,
    agl: Agl = None,
    alt_amsl: AltAmsl = None,
    ground_alt: GroundAlt = None,
    heading: Heading = None,
    pitch: Pitch = None,
    roll: Roll = None,
    hfov: Hfov = None,
    camera: CameraFile = None,
    priors: Priors = None,
    use_exif_gps: UseExifGps = False,
    out: Annotated[
        Path | None, typer.Option(help="Write all answers to a .csv, or the accepted to a .geojson file.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a photo.")] = False,
) -> None:
    """Find where photos were taken from, by what they show, on a map.

    A photo that cannot be told with confidence is refused with a reason. EXIF and XMP supply height, attitude and field
    of view where options and CSV do not.
    """
    console = Console(stderr=True)
    if out is not None and out.suffix.lower() not in (".csv", ".geojson", ".json"):
        raise typer.BadParameter(f"--out {out}: the name must end in .csv or .geojson")
    given = given_hints(near, radius, sigma, agl, alt_amsl, heading, pitch, roll, hfov, camera)
    try:
        answers = _answers(photos, map, elevation, ground_alt, camera, priors, given, use_exif_gps, as_json, console)
        if out is not None:
            write_answers(out, answers)
    except (StationError, GeodataError, OSError) as error:
        console.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    if not as_json:
        _print_table(answers)
    if any(answer.failed for answer in answers):
        raise typer.Exit(1)


def _answers(
    photos: list[Path], map_path: Path, elevation: Path | None, ground_alt_amsl_m: float | None, camera: Path | None,
    priors: Path | None, given: Hints, use_exif_gps: bool, as_json: bool, console: Console,
) -> list[PhotoAnswer]:  # fmt: skip
    files = photos_in(photos)
    profile = read_camera_profile(camera) if camera is not None else None
    by_name = read_priors(priors) if priors is not None else {}
    for name in sorted(set(by_name) - {file.name for file in files}):
        console.print(f"warning: {priors} has a line for {name}, which is not among the photos", markup=False)
    session = PhotoSession(map_path, elevation, profile, ground_alt_amsl_m)
    answers: list[PhotoAnswer] = []
    try:
        with Progress(console=console, transient=True, disable=len(files) == 1 and not console.is_terminal) as bar:
            task = bar.add_task("locating", total=len(files))
            for file in files:
                hints = by_name.get(file.name, Hints()).over(given)
                answers.append(session.answer(file, hints, use_exif_gps))
                bar.advance(task)
                if as_json:
                    typer.echo(json.dumps(as_object(answers[-1])))
    finally:
        session.close()
    return answers


def _print_table(answers: list[PhotoAnswer]) -> None:
    table = Table(box=None, header_style="bold")
    for title in ("photo", "latitude", "longitude", "heading", "95 % m", "wrong", "by", "s", ""):
        table.add_column(title)
    for a in answers:
        seconds = f"{a.elapsed_ms / 1e3:.1f}"
        if not a.accepted:
            table.add_row(a.photo, "refused", "", "", "", "", "", seconds, a.reason)
            continue
        table.add_row(
            a.photo, f"{a.lat_deg:.7f}", f"{a.lon_deg:.7f}", f"{a.heading_deg:.1f}",
            f"{a.semi_major_m:.1f} x {a.semi_minor_m:.1f}", f"{a.outlier_probability:.1%}", a.method or "", seconds, "",
        )  # fmt: skip
    Console().print(table)
