"""``pilotage pad``: a landing pad to print, with the description that the detector needs."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from backend.landing.drawing import as_pdf, as_svg, sheet_mm
from estimator.errors import GeometryError
from estimator.landing.pad import CODES, Pad, circle_pad, tag_pad
from geodata.errors import GeodataError
from geodata.pad_file import as_description, read_pad, write_pad


class Kind(StrEnum):
    """What is on the pad."""

    CIRCLES = "circles"
    TAGS = "tags"


def register(app: typer.Typer) -> None:
    """Add ``pad`` to the console command."""
    app.command("pad", epilog="Example: pilotage pad mypad --side 1.5 --radius 0.3")(make_pad)


def make_pad(
    out: Annotated[Path, typer.Argument(help="Files to write, without suffix.", show_default=False)],
    kind: Annotated[Kind, typer.Option(help="Nested triples of circles, or AprilTags 36h11.")] = Kind.CIRCLES,
    side: Annotated[
        float | None, typer.Option(help="Between centres of the largest triple, or of the largest tag, m.  [1.5; 0.9]")
    ] = None,
    radius: Annotated[float | None, typer.Option(help="Of the largest discs, m.  [a fifth of the side]")] = None,
    triples: Annotated[int, typer.Option(help=f"Nested triples, 1 to {len(CODES)}.")] = 4,
    shrink: Annotated[float, typer.Option(help="Each triple is so many times smaller than the one around it.")] = 3.0,
    sizes: Annotated[int, typer.Option(help="Sizes of tags, 1 to 4.")] = 3,
    name: Annotated[str | None, typer.Option(help="The pad's name.  [that of the files]")] = None,
    description: Annotated[
        Path | None, typer.Option("--from", help="Draw the pad of a description file again.", show_default=False)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the description.")] = False,
) -> None:
    """Write a landing pad as SVG and PDF of true size, and its description file.

    Print at 100 % ("actual size"), measure the largest circle, and lay the pad flat.
    """
    console = Console(stderr=True)
    try:
        pad = _pad(kind, side, radius, triples, shrink, sizes, name or out.name, description)
        base = out.with_suffix("") if out.suffix.lower() in (".svg", ".pdf", ".json") else out
        pdf, svg = as_pdf(pad), as_svg(pad)
        _named(base, ".svg").write_text(svg, encoding="utf-8")
        _named(base, ".pdf").write_bytes(pdf)
        write_pad(_named(base, ".json"), pad)
    except (GeometryError, GeodataError) as error:
        console.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except OSError as error:
        console.print(f"error: {out}: cannot be written ({error.strerror})", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    if as_json:
        typer.echo(json.dumps(as_description(pad)))
        return
    width, height = sheet_mm(pad)
    typer.echo(f"{base}.svg, {base}.pdf, {base}.json: sheet of {width:.1f} x {height:.1f} mm")


def _named(base: Path, suffix: str) -> Path:
    """The file beside the others; a dot in the name is part of it."""
    return base.with_name(base.name + suffix)


def _pad(
    kind: Kind, side: float | None, radius: float | None, triples: int, shrink: float, sizes: int, name: str,
    description: Path | None,
) -> Pad:  # fmt: skip
    if description is not None:
        return read_pad(description)
    if kind is Kind.TAGS:
        if radius is not None:
            message = "--radius is of circles; the size of tags is --side"
            raise GeometryError(message)
        return tag_pad(name, 0.9 if side is None else side, sizes)
    side = 1.5 if side is None else side
    return circle_pad(name, side, 0.2 * side if radius is None else radius, triples, shrink)
