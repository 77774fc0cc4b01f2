"""``pilotage verify``: is a target where its evidence says?"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from backend.errors import BundleError
from backend.evidence.bundle import Bundle, read_bundle
from backend.evidence.repeat import COV_TOLERANCE, TOLERANCE_M, Outcome, Repetition, repeat
from backend.evidence.verify import FileMatch, Recomputed, Verdict, matching_file, verify
from geodata.errors import GeodataError


@dataclass(frozen=True, slots=True, eq=False)
class Checked:
    """All that was found out about a bundle; ``given`` is which of its files those on the command line are."""

    path: Path
    bundle: Bundle
    verdict: Verdict
    given: tuple[tuple[Path, FileMatch | None], ...]
    repetition: Repetition

    @property
    def agrees(self) -> bool:
        """Whether nothing speaks against the coordinate."""
        files = all(match is not None for _, match in self.given)
        return files and self.verdict.agrees and self.repetition.outcome is not Outcome.DISAGREES


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("verify", epilog="Example: pilotage verify target.zip --map ortho.tif")(verify_files)


def verify_files(
    files: Annotated[
        list[Path], typer.Argument(help="Evidence of targets: .zip, or its evidence.json alone.", show_default=False)
    ],
    map: Annotated[
        Path | None,
        typer.Option(help="The map: was it the one in use, and is the picture there on it?", show_default=False),
    ] = None,
    elevation: Annotated[
        Path | None, typer.Option(help="The elevation: was it the one in use?", show_default=False)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for each file.")] = False,
) -> None:
    """Compute targets again from their evidence (GET /api/v1/targets/ID/evidence) and compare.

    The picture is registered to the map again, to the piece of it in the evidence where none is given.

    Exit status 0 when every one agrees, 1 when one does not or cannot be believed.
    """
    refused = 0
    for path in files:
        try:
            checked = _check(path, [given for given in (map, elevation) if given is not None])
        except (BundleError, GeodataError) as error:
            if as_json:
                typer.echo(json.dumps({"file": str(path), "agrees": False, "error": str(error)}))
            else:
                typer.echo(f"error: {error}", err=True)
            refused += 1
            continue
        if as_json:
            typer.echo(json.dumps(_json(checked), allow_nan=False))
        else:
            _tell(checked)
        refused += not checked.agrees
    if refused:
        raise typer.Exit(1)


def _check(path: Path, given: list[Path]) -> Checked:
    bundle = read_bundle(path)
    verdict = verify(bundle.evidence, str(path))
    matches = tuple((file, matching_file(bundle.evidence, file)) for file in given)
    known = [match for _, match in matches if match is not None]
    if bundle.evidence.registration is not None and len(known) < len(matches):
        repetition = Repetition(Outcome.NOT_REPEATED, "a file that was given is none of those in use")
    else:
        repetition = repeat(bundle, verdict, known, str(path))
    return Checked(path, bundle, verdict, matches, repetition)


def _tell(checked: Checked) -> None:
    bundle, verdict = checked.bundle, checked.verdict
    evidence = bundle.evidence
    frame = evidence.frame
    typer.echo(f"{checked.path}: target {evidence.target.id}, version {evidence.target.version}")
    typer.echo(
        f"  frame {frame.frame_id} of {frame.source}, exposed {_time(frame.t_unix_us)}, pixel "
        f"({evidence.click.u_px:g}, {evidence.click.v_px:g}); {evidence.program.name} {evidence.program.version}"
    )
    if bundle.status is not None:
        typer.echo(f"  note of the station: {bundle.status}")
    for title, place in (("stated    ", _stated(bundle)), ("recomputed", _found(verdict.recomputed))):
        cov = np.array(place["cov_ned_m2"])
        std_n, std_e, std_d = np.sqrt(np.maximum(np.diag(cov), 0.0))
        typer.echo(
            f"  {title} {place['lat_deg']:.9f}, {place['lon_deg']:.9f}, {place['alt_amsl_m']:.3f} m AMSL; sigma N "
            f"{std_n:.3f} E {std_e:.3f} D {std_d:.3f} m; NE {cov[0, 1]:.4g} m2; {place['method']}"
        )
    typer.echo(
        f"  distance   {verdict.distance_m:.6f} m, {verdict.distance_sigmas:.6f} sigmas; "
        f"covariances differ by {verdict.cov_change:.1e}"
    )
    if evidence.placement is not None:
        placed = evidence.placement
        typer.echo(
            f"  placement  by {placed.by}, {math.hypot(*placed.correction[:2]):.2f} m from where the pose had it, "
            f"outlier probability {placed.outlier_probability:.2f}"
        )
    typer.echo(f"  picture    {_picture(bundle)}")
    for path, match in checked.given:
        typer.echo(f"  file       {path} is {_none_of(bundle) if match is None else match.words}")
    _tell_repetition(checked.repetition)
    not_repeated = checked.repetition.outcome is Outcome.NOT_REPEATED
    agreement = "  agrees, but its registration was not repeated" if not_repeated else "  agrees"
    typer.echo(agreement if checked.agrees else "  does not agree")


def _tell_repetition(repetition: Repetition) -> None:
    """The line on the registration, none where there was none."""
    match repetition.outcome:
        case Outcome.NONE:
            return
        case Outcome.NOT_REPEATED:
            typer.echo(f"  registration not repeated: {repetition.reason}")
        case _:
            told = f"  registration repeated on {repetition.on}: {repetition.outcome}"
            if repetition.displacement_ne_m is not None:
                north_m, east_m = repetition.displacement_ne_m
                told += (
                    f"; displacement N {north_m:.3f} E {east_m:.3f} m; the coordinate by it {repetition.distance_m:.6f}"
                    f" m away (at most {TOLERANCE_M:g}), covariances differ by {repetition.cov_change:.1e} (at most "
                    f"{COV_TOLERANCE:g})"
                )
            typer.echo(f"{told}; {repetition.reason}" if repetition.reason else told)


def _json(checked: Checked) -> dict[str, Any]:
    bundle, verdict, again = checked.bundle, checked.verdict, checked.repetition
    return {
        "file": str(checked.path), "target": bundle.evidence.target.id, "version": bundle.evidence.target.version,
        "agrees": checked.agrees, "note": bundle.status,
        "stated": _stated(bundle), "recomputed": _found(verdict.recomputed),
        "distance_m": verdict.distance_m, "distance_sigmas": verdict.distance_sigmas,
        "cov_change": verdict.cov_change, "picture": _picture(bundle),
        "files": [
            {"file": str(path), "is": None if match is None else match.words} for path, match in checked.given
        ],
        "registration": {
            "outcome": str(again.outcome), "reason": again.reason or None, "on": again.on or None,
            "displacement_ne_m": again.displacement_ne_m, "distance_m": again.distance_m,
            "cov_change": again.cov_change, "tolerance_m": TOLERANCE_M, "cov_tolerance": COV_TOLERANCE,
        },
    }  # fmt: skip


def _stated(bundle: Bundle) -> dict[str, Any]:
    result = bundle.evidence.result
    cov = [[value or 0.0 for value in row] for row in result.cov_ned_m2]
    place = {"lat_deg": result.lat_deg, "lon_deg": result.lon_deg, "alt_amsl_m": result.alt_amsl_m}
    return {**place, "cov_ned_m2": cov, "method": result.method}


def _found(found: Recomputed) -> dict[str, Any]:
    return {
        "lat_deg": math.degrees(found.lat_rad), "lon_deg": math.degrees(found.lon_rad),
        "alt_amsl_m": found.alt_amsl_m, "cov_ned_m2": found.cov_ned_m2.tolist(), "method": found.method,
    }  # fmt: skip


def _picture(bundle: Bundle) -> str:
    part = bundle.evidence.picture
    if part.file is None:
        return f"none: {part.problem}"
    return "not checked: it is in the .zip" if bundle.picture is None else f"as it was, SHA-256 {part.sha256}"


def _none_of(bundle: Bundle) -> str:
    files = bundle.evidence.files
    known = [f"{file.role} '{file.file}' ({file.sha256 or file.problem})" for file in files]
    return f"none of the files in use: {', '.join(known) or 'there were none'}"


def _time(t_unix_us: int) -> str:
    try:
        return datetime.fromtimestamp(t_unix_us / 1e6, UTC).isoformat(timespec="milliseconds")
    except (OverflowError, OSError, ValueError):
        return f"{t_unix_us} us"
