"""A study of one's own: a TOML file that flies a named study's rows over another scenario."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from backend.errors import StationError
from benchmarks.studies.study import FlownRow, Row, Study
from simulator.scenario import Scenario


class StudyError(StationError):
    """A study that cannot be run as it is written."""


class StudyFile(BaseModel):
    """``study`` names the rows, ``rows`` those of them to keep, ``scenario`` what to change of every flown one.

    ``name`` is what the results are called, the file's own unless said.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    study: str
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")] | None = None
    rows: tuple[str, ...] | None = None
    scenario: dict[str, Any] = {}


def load_study(name_or_path: str, short: bool, known: Mapping[str, Callable[[bool], Study]]) -> Study:
    """A study by name, or one from a TOML file.

    Raises
    ------
    StudyError
        Neither exists, or the file says something that cannot be flown.
    """
    if name_or_path in known:
        return known[name_or_path](short)
    path = Path(name_or_path)
    if not path.is_file():
        raise StudyError(f"no study or file '{name_or_path}'; use one of: {', '.join(known)}, or a TOML file")
    try:
        file = StudyFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StudyError(f"study file '{path}' is not TOML ({error}); correct the line it names") from error
    except OSError as error:
        raise StudyError(f"study file '{path}' cannot be read ({error.strerror})") from error
    except ValidationError as error:
        raise StudyError(f"study file '{path}': {_first(error, 'study')}") from error
    if file.study not in known:
        raise StudyError(f"study file '{path}': unknown study '{file.study}'; known: {', '.join(known)}")
    base = known[file.study](short)
    rows = [_changed(row, file.scenario, path) for row in _kept(base, file.rows, path)]
    return replace(base, name=file.name or path.stem, rows=tuple(rows))


def _kept(study: Study, names: tuple[str, ...] | None, path: Path) -> list[Row]:
    if names is None:
        return list(study.rows)
    by_name = {row.name: row for row in study.rows}
    unknown = [name for name in names if name not in by_name]
    if unknown or not names:
        said = f"no row '{unknown[0]}' in '{study.name}'" if unknown else "rows is empty"
        raise StudyError(f"study file '{path}': {said}; rows: {', '.join(by_name)}")
    return [by_name[name] for name in names]


def _changed(row: Row, changes: Mapping[str, Any], path: Path) -> Row:
    if not changes:
        return row
    if not isinstance(row, FlownRow):
        raise StudyError(f"study file '{path}': row '{row.name}' flies no scenario that could be changed")
    try:
        scenario = Scenario.model_validate(_merged(row.scenario.model_dump(), changes))
    except ValidationError as error:
        raise StudyError(f"study file '{path}': {_first(error, 'scenario')}") from error
    return replace(row, scenario=scenario)


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for name, value in changes.items():
        inner = merged.get(name)
        merged[name] = _merged(inner, value) if isinstance(inner, Mapping) and isinstance(value, Mapping) else value
    return merged


def _first(error: ValidationError, where: str) -> str:
    first = error.errors()[0]
    return f"{'.'.join(str(part) for part in first['loc']) or where}: {first['msg']}"
