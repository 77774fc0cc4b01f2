"""``pilotage pad``: files on disk, and what cannot be made is said without a traceback."""

import json
from pathlib import Path

import typer
from typer.testing import CliRunner, Result

from backend.landing.cli import register
from estimator.landing.pad import circle_pad
from geodata.pad_file import read_pad


def _run(*arguments: object) -> Result:
    app = typer.Typer()
    register(app)
    app.command("other")(lambda: None)  # one command alone would lose its name
    return CliRunner().invoke(app, ["pad", *(str(a) for a in arguments)], env={"COLUMNS": "200"})


def test_three_files_of_the_pad_that_was_asked_for(tmp_path: Path) -> None:
    result = _run(tmp_path / "roof.v2", "--side", 1.2, "--radius", 0.2, "--triples", 3, "--json")

    assert result.exit_code == 0, result.output
    assert sorted(p.name for p in tmp_path.iterdir()) == ["roof.v2.json", "roof.v2.pdf", "roof.v2.svg"]
    assert read_pad(tmp_path / "roof.v2.json") == circle_pad("roof.v2", 1.2, 0.2, 3)
    assert json.loads(result.stdout)["triples"][0]["side_m"] == 1.2


def test_a_description_is_drawn_again(tmp_path: Path) -> None:
    assert _run(tmp_path / "one", "--kind", "tags", "--side", 0.6, "--sizes", 2).exit_code == 0

    result = _run(tmp_path / "two.svg", "--from", tmp_path / "one.json")

    assert result.exit_code == 0, result.output
    assert (tmp_path / "two.svg").read_text() == (tmp_path / "one.svg").read_text()
    assert (tmp_path / "two.pdf").read_bytes() == (tmp_path / "one.pdf").read_bytes()


def test_what_cannot_be_made_is_said(tmp_path: Path) -> None:
    for arguments, words in (
        (("--side", 1.0, "--radius", 0.45), "make the side longer"),
        (("--triples", 9), "1 to 4 triples"),
        (("--shrink", 0.5), "above 1"),
        (("--side", "nan"), "positive side"),
        (("--kind", "tags", "--radius", 0.2), "size of tags is --side"),
        (("--from", tmp_path / "none.json"), "no such file"),
        (("--side", 9), "use the SVG"),
    ):
        result = _run(tmp_path / "pad", *arguments)
        assert result.exit_code == 1 and words in result.output, (arguments, result.output)
        assert "Traceback" not in result.output
    assert not list(tmp_path.iterdir())

    nowhere = _run(tmp_path / "missing" / "pad")
    assert nowhere.exit_code == 1 and "cannot be written" in nowhere.output
