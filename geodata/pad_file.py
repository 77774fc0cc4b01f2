"""The description file of a landing pad (JSON): what is on the print, in metres.

``{"schema": "pilotage.pad/1", "kind": "circles", "name": …, "triples": [{"side_m", "radius_m", "ratios": [3]}, …]}``
with the largest triple first, or
``{…, "kind": "tags", "family": "36h11", "tags": [{"number", "x_m", "y_m", "side_m"}, …]}``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from estimator.errors import GeometryError
from estimator.landing.pad import CirclePad, Pad, Tag, TagPad, Triple
from geodata.errors import PadFileError
from geodata.flight_write import write_atomically

SCHEMA = "pilotage.pad/1"
_MAX_BYTES = 1_000_000
_REMEDY = "'pilotage pad' writes a description together with the print"

Positive = Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]
Place = Annotated[float, Field(ge=-100, le=100, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=80)]


class _Section(BaseModel):
    # A misspelt key would silently describe another pad.
    model_config = ConfigDict(extra="forbid", frozen=True)


class _TripleMeta(_Section):
    side_m: Positive
    radius_m: Positive
    ratios: tuple[Positive, Positive, Positive]


class _TagMeta(_Section):
    number: Annotated[int, Field(ge=0)]
    x_m: Place
    y_m: Place
    side_m: Positive


class _CirclesMeta(_Section):
    schema_: Annotated[Literal["pilotage.pad/1"], Field(alias="schema")]
    kind: Literal["circles"]
    name: Name
    triples: Annotated[list[_TripleMeta], Field(min_length=1, max_length=8)]


class _TagsMeta(_Section):
    schema_: Annotated[Literal["pilotage.pad/1"], Field(alias="schema")]
    kind: Literal["tags"]
    name: Name
    family: Literal["36h11"]
    tags: Annotated[list[_TagMeta], Field(min_length=1, max_length=64)]


_META: TypeAdapter[_CirclesMeta | _TagsMeta] = TypeAdapter(
    Annotated[_CirclesMeta | _TagsMeta, Field(discriminator="kind")]
)


def as_description(pad: Pad) -> dict[str, Any]:
    """The JSON object of a pad."""
    if isinstance(pad, TagPad):
        tags = [{"number": t.number, "x_m": t.x_m, "y_m": t.y_m, "side_m": t.side_m} for t in pad.tags]
        return {"schema": SCHEMA, "kind": "tags", "name": pad.name, "family": "36h11", "tags": tags}
    triples = [{"side_m": t.side_m, "radius_m": t.radius_m, "ratios": list(t.ratios)} for t in pad.triples]
    return {"schema": SCHEMA, "kind": "circles", "name": pad.name, "triples": triples}


def write_pad(path: Path, pad: Pad) -> None:
    """Write a pad's description, wholly or not at all."""
    write_atomically(path, (json.dumps(as_description(pad), indent=1) + "\n").encode())


def read_pad(path: Path) -> Pad:
    """The pad that a description file is of; ``PadFileError`` says what is wrong with it."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise PadFileError(path, "is too large for a pad's description", _REMEDY)
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise PadFileError(path, "no such file", _REMEDY) from None
    except OSError as error:
        raise PadFileError(path, f"cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise PadFileError(path, f"is not JSON ({error})", _REMEDY) from None
    return pad_from(data, path)


def pad_from(data: object, path: Path) -> Pad:
    """The pad of a JSON object that stands in ``path``, a description or the ``pad`` of a ``flight.json``."""
    try:
        meta = _META.validate_python(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        raise PadFileError(path, f"{first['msg'].lower()} (it has {first['input']!r:.60})", field=field) from None
    try:
        if isinstance(meta, _TagsMeta):
            return TagPad(meta.name, tuple(Tag(t.number, t.x_m, t.y_m, t.side_m) for t in meta.tags))
        return CirclePad(meta.name, tuple(Triple(t.side_m, t.radius_m, t.ratios) for t in meta.triples))
    except GeometryError as error:
        raise PadFileError(path, str(error), "compare it with the print") from None
