"""The landing pad of a flight: the ``pad`` section of ``flight.json``.

Either the description itself (``geodata.pad_file``) or ``{"file": "pad.json"}``, a description in the folder. Beside it
may stand where a survey puts the pad's centre: ``lat_deg``, ``lon_deg``, ``alt_amsl_m`` and ``std_m`` (0.05 if absent).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from estimator.landing.pad import Pad
from geodata.errors import PadFileError
from geodata.flight import FlightFolder
from geodata.pad_file import pad_from, read_pad

SURVEY_FIELDS = ("lat_deg", "lon_deg", "alt_amsl_m", "std_m")


class PadSurvey(BaseModel):
    """Where a pad's centre lies, and to which standard deviation on each axis."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    lat_deg: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
    lon_deg: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
    alt_amsl_m: Annotated[float, Field(ge=-1000, le=10000, allow_inf_nan=False)]
    std_m: Annotated[float, Field(ge=0.001, le=1000, allow_inf_nan=False)] = 0.05


@dataclass(frozen=True, slots=True)
class FlightPad:
    """The pad of a flight, and where it lies if that was surveyed."""

    pad: Pad
    survey: PadSurvey | None


def pad_of_flight(folder: FlightFolder) -> FlightPad | None:
    """The pad that a flight names, None where it names none; `PadFileError` says what is wrong with one."""
    section = folder.meta.pad
    if not section:
        return None
    pad = pad_of_section(section, folder.path / "flight.json", lambda name: folder.named("pad.file", name))
    placed = {key: section[key] for key in SURVEY_FIELDS if section.get(key) is not None}
    return FlightPad(pad, _survey(placed, folder))


def pad_of_section(section: dict[str, Any], path: Path, named: Callable[[str], Path | None]) -> Pad:
    """The pad that a ``pad`` section in the file ``path`` describes; ``named`` finds the file that it may name instead.

    `PadFileError` says what is wrong with it. Where a survey has the pad is not looked at.
    """
    described = {key: value for key, value in section.items() if key not in SURVEY_FIELDS}
    if "file" not in described:
        return pad_from(described, path)
    others = sorted(set(described) - {"file"})
    if others:
        remedy = "give either the file's name or the description itself"
        raise PadFileError(path, f"has both 'file' and {', '.join(map(repr, others))}", remedy, field="pad")
    if not isinstance(described["file"], str):
        raise PadFileError(path, f"is no file name: {described['file']!r:.60}", "name a file", field="pad.file")
    file = named(described["file"])
    if file is None:
        raise PadFileError(path, "is empty", "name the description's file, or leave out pad", field="pad.file")
    return read_pad(file)


def _survey(placed: dict[str, Any], folder: FlightFolder) -> PadSurvey | None:
    if not placed:
        return None
    try:
        return PadSurvey.model_validate(placed)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(("pad", *(str(part) for part in first["loc"])))
        remedy = "a survey needs lat_deg, lon_deg and alt_amsl_m together; leave out all three where there is none"
        raise PadFileError(folder.path / "flight.json", first["msg"].lower(), remedy, field=field) from None
