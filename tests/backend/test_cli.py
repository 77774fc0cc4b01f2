"""The command: statuses and messages, never a traceback."""

from pathlib import Path

import pytest
import typer

from backend import cli
from backend.settings import load_settings


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("pilotage ")


def test_help_names_every_parts_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["--help"]) == 0
    said = capsys.readouterr().out
    for command in ("serve", "demo", "sim"):
        assert command in said


@pytest.mark.parametrize("arguments", [["serve", "--bogus"], ["nonsense"], ["serve", "--port", "many"]])
def test_misuse_is_status_two(arguments: list[str]) -> None:
    assert cli.run(arguments) == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["serve", "--host", "0.0.0.0"], "login"),  # noqa: S104
        (["serve", "--port", "99999"], "port"),
        (["serve", "--config", "nowhere.toml"], "nowhere.toml"),
        (["serve", "--port", "0", "--camera", "nowhere.json"], "nowhere.json"),
        (["serve", "--port", "0", "--map", "nowhere.tif"], "nowhere.tif"),
        (["serve", "--port", "0", "--video", "carrier-pigeon:1"], "--video"),
        (["serve", "--port", "0", "--mavlink", "smoke:1"], "--mavlink"),
    ],
)
def test_failures_are_status_one_with_words(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if arguments[1] == "--port":
        arguments = [*arguments, "--data-dir", str(tmp_path)]
    if "--mavlink" not in arguments:
        arguments = [*arguments, "--mavlink", "none"]

    assert cli.run(arguments) == 1
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said


def test_an_unexpected_error_is_told_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> typer.Typer:
        raise RuntimeError("the moon is wrong")

    monkeypatch.setattr(cli, "build_app", broken)

    assert cli.run([]) == 1
    said = capsys.readouterr().err
    assert "the moon is wrong" in said
    assert "Traceback" not in said


def test_every_serve_option_is_a_setting() -> None:
    names = {"host", "port", "data_dir", "mavlink", "video", "map", "camera", "time_offset_s", "flights", "record"}

    assert names <= set(type(load_settings()).model_fields)
