"""The command: what is misused is said, lists and seeds are read."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from benchmarks.studies.catalogue import STUDIES
from benchmarks.studies.cli import FIRST_SEED, parse_seeds, register
from benchmarks.studies.study_file import StudyError, load_study


def run(*arguments: str) -> tuple[int, str]:
    app = typer.Typer()
    register(app)
    app.callback()(lambda: None)
    result = CliRunner().invoke(app, ["monte-carlo", *arguments])
    return result.exit_code, result.output


@pytest.mark.parametrize(("text", "seeds"), [("7", [7]), ("201-203", [201, 202, 203]), ("5-5", [5])])
def test_seeds_are_one_or_a_range(text: str, seeds: list[int]) -> None:
    assert parse_seeds(text, short=False) == seeds


def test_thirty_seeds_unless_said() -> None:
    assert parse_seeds(None, short=False) == list(range(FIRST_SEED, FIRST_SEED + 30))
    assert len(parse_seeds(None, short=True)) == 2


@pytest.mark.parametrize("text", ["", "a", "3-1", "-4", "1-2-3", "1,2", "1-999999999"])
def test_other_seeds_are_refused_before_anything_flies(text: str, tmp_path: Path) -> None:
    status, said = run("ladder", "--seeds", text, "--out", str(tmp_path))

    assert status == 2
    assert "--seeds" in said
    assert not list(tmp_path.iterdir())


def test_an_unknown_study_is_named_with_those_there_are() -> None:
    with pytest.raises(StudyError, match=r"lader.*ladder, channels"):
        load_study("lader", False, STUDIES)


def test_list_names_every_study() -> None:
    status, said = run("list")

    assert status == 0
    assert "ladder" in said


def test_the_console_command_has_it() -> None:
    """Commands are found by entry points, which name a function by text."""
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    commands = project["project"]["entry-points"]["pilotage.commands"]

    assert commands["monte-carlo"] == f"{register.__module__}:{register.__name__}"
