"""Files of JSON lines, one for each seed, so that what was measured until an interruption is not lost."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import typer

from simulator.errors import SimulatorError


class Row(Protocol):
    """A dataclass of what one seed gave; a float that is not known is NaN, null in the file."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def seed(self) -> int:
        """Of which seed it is."""


Kept = TypeVar("Kept", bound=Row)


def measured(
    seeds: Sequence[int], kind: type[Kept], measure: Callable[[int], Kept], line: Callable[[Kept], str],
    out: Path | None,
) -> list[Kept]:  # fmt: skip
    """A row of each seed, in their order: from the file where it has it, else measured, said and added to the file.

    A seed whose world does not serve is left out, and that is said.
    """
    done = {} if out is None or not out.is_file() else {one.seed: one for one in read_rows(out, kind)}
    rows = []
    for seed in seeds:
        row = done.get(seed)
        if row is None:
            try:
                row = measure(seed)
            except SimulatorError as error:
                typer.echo(f"seed {seed}: left out, {error}", err=True)
                continue
            if out is not None:
                with out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(finite(asdict(row)), allow_nan=False) + "\n")
        rows.append(row)
        typer.echo(line(row))
    return rows


def read_rows(path: Path, kind: type[Kept]) -> list[Kept]:
    """The rows of a file."""
    texts = [text for text in path.read_text(encoding="utf-8").splitlines() if text.strip()]
    found: list[dict[str, Any]] = [json.loads(text) for text in texts]
    names = [field.name for field in fields(kind)]
    return [kind(**{name: math.nan if row[name] is None else row[name] for name in names}) for row in found]


def finite(row: dict[str, object]) -> dict[str, object]:
    """A row fit for JSON."""
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()}
