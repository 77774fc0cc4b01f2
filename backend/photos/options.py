"""What both commands about photos take: options, and what is known of a photo by them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from backend.photos.hints import HintError, Hints

MapFile = Annotated[Path, typer.Option("--map", help="Georeferenced imagery.", show_default=False)]
Elevation = Annotated[Path | None, typer.Option(help="Heights of the ground; level ground without.")]
Near = Annotated[str | None, typer.Option("--near", "--at", help="LAT,LON where to look; the whole map without.")]
Radius = Annotated[float | None, typer.Option(help="How far from there at most, metres  [100]")]
Sigma = Annotated[float | None, typer.Option(help="Or its standard deviation on each axis, metres.")]
Agl = Annotated[float | None, typer.Option(help="Height above ground, metres.")]
AltAmsl = Annotated[float | None, typer.Option(help="Or altitude above sea level, metres.")]
GroundAlt = Annotated[float | None, typer.Option(help="Altitude of level ground above sea level.")]
Heading = Annotated[float | None, typer.Option(help="Where the picture's top points; unknown without.")]
Pitch = Annotated[float | None, typer.Option(help="-90 looks straight down.")]
Roll = Annotated[float | None, typer.Option(help="Of the gimbal.")]
Hfov = Annotated[float | None, typer.Option(help="Field of view from left to right, degrees.")]
CameraFile = Annotated[Path | None, typer.Option(help="Or a camera file: flight.json or its camera section.")]
Priors = Annotated[Path | None, typer.Option(help="CSV with any of these for each photo.")]
UseExifGps = Annotated[bool, typer.Option("--use-exif-gps", help="Look about the position in the photo's own file.")]


def given_hints(
    near: str | None, radius: float | None, sigma: float | None, agl: float | None, alt_amsl: float | None,
    heading: float | None, pitch: float | None, roll: float | None, hfov: float | None, camera: Path | None,
) -> Hints:  # fmt: skip
    """What the options say of a photo; typer.BadParameter where they contradict each other or make no sense."""
    if camera is not None and hfov is not None:
        raise typer.BadParameter("give --hfov or --camera, not both")
    if radius is not None and sigma is not None:
        raise typer.BadParameter("give --radius or --sigma, not both")
    if agl is not None and alt_amsl is not None:
        raise typer.BadParameter("give --agl or --alt-amsl, not both")
    lat_deg, lon_deg = _position(near)
    try:
        return Hints(lat_deg, lon_deg, radius, sigma, agl, alt_amsl, heading, pitch, roll, hfov)
    except HintError as error:
        raise typer.BadParameter(str(error)) from None


def pair(text: str) -> tuple[float, float] | None:
    """Two finite numbers with a comma between; None where the text is anything else."""
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        return None
    return (first, second) if math.isfinite(first) and math.isfinite(second) else None


def _position(text: str | None) -> tuple[float | None, float | None]:
    if text is None:
        return None, None
    found = pair(text)
    if found is None:
        raise typer.BadParameter(f"--near '{text}' is not LAT,LON in degrees, such as 41.0350,-83.3051")
    return found
