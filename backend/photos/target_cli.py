"""``pilotage target``: where is what this pixel shows?"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from backend.errors import StationError
from backend.navigation.setup import read_camera_profile
from backend.photos.exports import as_object as photo_as_object
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
    pair,
)
from backend.photos.session import PhotoSession
from backend.photos.target import (
    Method,
    PhotoTarget,
    PhotoTargets,
    TargetOptions,
    as_geojson,
    as_object,
    locate_pixels,
)
from backend.pointing import CLICK_STD_PX
from geodata.errors import GeodataError
from geodata.flight_write import write_atomically

MAX_HEIGHT_M = 1000.0


def locate_target(
    photo: Annotated[Path, typer.Argument(help="The picture.", show_default=False)],
    pixel: Annotated[
        list[str], typer.Option("--pixel", help="U,V of the target: right and down from 0,0 at top left; repeatable.")
    ],
    map: MapFile,
    elevation: Elevation = None,
    target_height: Annotated[float, typer.Option(help="How far the target stands above ground, metres.")] = 0.0,
    target_height_std: Annotated[
        float | None, typer.Option(help="Standard deviation of that  [a quarter of it]")
    ] = None,
    pixel_std: Annotated[float, typer.Option(help="Standard deviation of the click on each axis.")] = CLICK_STD_PX,
    map_std: Annotated[
        float | None, typer.Option(help="The map's own local error, metres on each axis  [the calibration's]")
    ] = None,
    map_offset_std: Annotated[
        float | None, typer.Option(help="How far the whole map may be displaced, metres on each axis  [not counted]")
    ] = None,
    method: Annotated[
        Method, typer.Option(help="By which registration the photo is laid on the map: ours, or contours as published.")
    ] = Method.REGISTERED,
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
    out: Annotated[Path | None, typer.Option(help="Write the coordinates to a .geojson file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
) -> None:
    """Find the coordinates of what pixels of a photo show, by laying the photo on a map.

    The match of picture and map carries the pixel to the map; the camera's pose is not what the coordinate is made of.
    A coordinate comes with its uncertainty, or is refused with a reason.
    """
    console = Console(stderr=True)
    if out is not None and out.suffix.lower() not in (".geojson", ".json"):
        raise typer.BadParameter(f"--out {out}: the name must end in .geojson")
    pixels = [_pixel(text) for text in pixel]
    options = _options(target_height, target_height_std, pixel_std, map_std, map_offset_std, method)
    given = given_hints(near, radius, sigma, agl, alt_amsl, heading, pitch, roll, hfov, camera)
    try:
        hints = given if priors is None else read_priors(priors).get(photo.name, Hints()).over(given)
        session = PhotoSession(map, elevation, read_camera_profile(camera) if camera is not None else None, ground_alt)
        try:
            with console.status(f"locating {photo.name}"):
                found = locate_pixels(session, photo, pixels, hints, options, use_exif_gps)
        finally:
            session.close()
        if out is not None:
            text = json.dumps(as_geojson(photo.name, found.targets), indent=1)
            write_atomically(out, f"{text}\n".encode())
    except (StationError, GeodataError, OSError) as error:
        if as_json:
            refused = [{"pixel": list(uv), "accepted": False, "reason": str(error)} for uv in pixels]
            typer.echo(json.dumps({"photo": photo.name, "accepted": False, "reason": str(error), "targets": refused}))
        console.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    if as_json:
        typer.echo(json.dumps(_object(found)))
    else:
        for target in found.targets:
            _print(target, found)
    if any(target.found is None for target in found.targets):
        raise typer.Exit(1)


def _pixel(text: str) -> tuple[float, float]:
    found = pair(text)
    if found is None:
        raise typer.BadParameter(f"--pixel '{text}' is not U,V in pixels, such as 1210,655")
    return found


def _options(
    height_m: float, height_std_m: float | None, pixel_std_px: float, map_std_m: float | None,
    map_offset_std_m: float | None, method: Method,
) -> TargetOptions:  # fmt: skip
    if not abs(height_m) <= MAX_HEIGHT_M:
        raise typer.BadParameter(f"--target-height is at most {MAX_HEIGHT_M:g} m above or below ground, not {height_m}")
    if not 0.0 < pixel_std_px < math.inf:
        raise typer.BadParameter(f"--pixel-std is a positive number of pixels, not {pixel_std_px}")
    named = (("--target-height-std", height_std_m), ("--map-std", map_std_m), ("--map-offset-std", map_offset_std_m))
    for name, value in named:
        if value is not None and not 0.0 <= value <= MAX_HEIGHT_M:
            raise typer.BadParameter(f"{name} is 0 to {MAX_HEIGHT_M:g} m, not {value}")
    return TargetOptions(height_m, height_std_m, pixel_std_px, map_std_m, map_offset_std_m, method)


def _object(found: PhotoTargets) -> dict[str, Any]:
    targets = [as_object(target) for target in found.targets]
    return {
        "photo": found.located.photo, "accepted": all(t["accepted"] for t in targets), "reason": "",
        "match": found.placement.by, "map_std_m": round(found.placement.map_std_m, 3),
        "camera": photo_as_object(found.located), "targets": targets,
    }  # fmt: skip


def _print(target: PhotoTarget, found: PhotoTargets) -> None:
    say = Console(soft_wrap=True, highlight=False, markup=False)
    name = f"pixel {target.uv_px[0]:g},{target.uv_px[1]:g}"
    if target.found is None:
        say.print(f"{name}: refused: {target.reason}")
        return
    a = as_object(target)
    e = a["ellipse95"]
    height = "height unknown (give --elevation or --ground-alt)"
    if a["alt_amsl_m"] is not None:
        height = f"{a['alt_amsl_m']:.1f} m AMSL, standard deviation {math.sqrt(a['cov_ned_m2'][2][2]):.1f} m"
    offset = "the whole map's displacement is not counted (--map-offset-std)"
    if target.map_offset_known:
        offset = f"with {a['map_offset_std_m']:g} m on each axis for the whole map's displacement"
    say.print(f"{name}: {a['lat_deg']:.7f}, {a['lon_deg']:.7f}   MGRS {a['mgrs'] or 'none here'}")
    say.print(f"  {height}")
    say.print(
        f"  CE90 {a['ce90_m']:.1f} m; 95 % ellipse {e['semi_major_m']:.1f} x {e['semi_minor_m']:.1f} m, major axis"
        f" {e['azimuth_deg']:.0f} degrees; {offset}"
    )
    say.print(
        f"  by the match ({found.placement.by}) with the map; {a['lever_m']:.0f} m from its middle,"
        f" {a['off_nadir_deg']:.0f} degrees off the vertical"
    )
    say.print(f"  wrong place altogether: {found.located.outlier_probability or 0.0:.1%}")
    ray = a["ray"]
    if ray is None:
        say.print("  by the camera's pose and the terrain: no ground met")
        return
    say.print(
        f"  by the camera's pose and the terrain: {ray['lat_deg']:.7f}, {ray['lon_deg']:.7f},"
        f" CE90 {ray['ce90_m']:.1f} m; {ray['apart_m']:.2f} m apart, {ray['apart_sigmas']:.2f} sigmas"
    )
