"""``pilotage verify``: is a target where its evidence says?"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from backend.errors import BundleError
from backend.evidence.bundle import Bundle, read_bundle
from backend.evidence.verify import Verdict, matching_file, verify


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("verify", epilog="Example: pilotage verify target.zip --map ortho.tif")(verify_files)


def verify_files(
    files: Annotated[
        list[Path], typer.Argument(help="Evidence of targets: .zip, or its evidence.json alone.", show_default=False)
    ],
    map: Annotated[
        Path | None, typer.Option(help="A map or elevation file: was it the one in use?", show_default=False)
    ] = None,
) -> None:
    """Compute targets again from their evidence (GET /api/v1/targets/ID/evidence) and compare.

    Exit status 0 when every one agrees, 1 when one does not or cannot be believed.
    """
    refused = 0
    for path in files:
        try:
            bundle = read_bundle(path)
            verdict = verify(bundle.evidence, str(path))
            _tell(path, bundle, verdict)
            agrees = verdict.agrees
            if map is not None:
                agrees = _tell_map(bundle, map) and agrees
            typer.echo("  agrees" if agrees else "  does not agree")
            refused += not agrees
        except BundleError as error:
            typer.echo(f"error: {error}", err=True)
            refused += 1
    if refused:
        raise typer.Exit(1)


def _tell(path: Path, bundle: Bundle, verdict: Verdict) -> None:
    evidence, found = bundle.evidence, verdict.recomputed
    stated, frame = evidence.result, evidence.frame
    typer.echo(f"{path}: target {evidence.target.id}, version {evidence.target.version}")
    typer.echo(
        f"  frame {frame.frame_id} of {frame.source}, exposed {_time(frame.t_unix_us)}, pixel "
        f"({evidence.click.u_px:g}, {evidence.click.v_px:g}); {evidence.program.name} {evidence.program.version}"
    )
    if bundle.status is not None:
        typer.echo(f"  note of the station: {bundle.status}")
    cov_stated = [[value or 0.0 for value in row] for row in stated.cov_ned_m2]
    _tell_place("stated    ", stated.lat_deg, stated.lon_deg, stated.alt_amsl_m, cov_stated, stated.method)
    _tell_place(
        "recomputed", math.degrees(found.lat_rad), math.degrees(found.lon_rad), found.alt_amsl_m,
        found.cov_ned_m2.tolist(), found.method,
    )  # fmt: skip
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
    if evidence.picture.file is None:
        typer.echo(f"  picture    none: {evidence.picture.problem}")
    elif bundle.picture is None:
        typer.echo("  picture    not checked: it is in the .zip")
    else:
        typer.echo(f"  picture    as it was, SHA-256 {evidence.picture.sha256}")


def _tell_place(
    title: str, lat_deg: float, lon_deg: float, alt_m: float, cov_ned_m2: list[list[float]], method: str
) -> None:
    std_n, std_e, std_d = np.sqrt(np.maximum(np.diag(np.array(cov_ned_m2)), 0.0))
    typer.echo(
        f"  {title} {lat_deg:.9f}, {lon_deg:.9f}, {alt_m:.3f} m AMSL; "
        f"sigma N {std_n:.3f} E {std_e:.3f} D {std_d:.3f} m; NE {cov_ned_m2[0][1]:.4g} m2; {method}"
    )


def _tell_map(bundle: Bundle, path: Path) -> bool:
    which = matching_file(bundle.evidence, path)
    if which is not None:
        typer.echo(f"  map        {path} is {which}")
        return True
    known = [f"{file.role} '{file.file}' ({file.sha256 or file.problem})" for file in bundle.evidence.files]
    typer.echo(f"  map        {path} is none of the files in use: {', '.join(known) or 'there were none'}")
    return False


def _time(t_unix_us: int) -> str:
    try:
        return datetime.fromtimestamp(t_unix_us / 1e6, UTC).isoformat(timespec="milliseconds")
    except (OverflowError, OSError, ValueError):
        return f"{t_unix_us} us"
