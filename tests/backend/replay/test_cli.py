"""``pilotage replay`` and ``pilotage evaluate`` from the command line."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from backend import cli
from estimator.registration.calibration import calibration_of, toml_of
from geodata.flight_tables import Click
from tests.backend.flight_maker import T0_US
from tests.backend.replay.flown import EARTH_M, SPEED_M_S, write_known_flight

FILES = {"estimate.csv", "smoothed.csv", "fixes.csv", "sightings.csv", "targets.csv", "report.json", "report.html"}


def test_replay_writes_its_results_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_known_flight(tmp_path / "f")

    assert cli.run(["replay", str(tmp_path / "f"), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    assert "known: 12 s in" in said
    assert "x real time" in said


def test_a_second_replay_replaces_the_first(tmp_path: Path) -> None:
    write_known_flight(tmp_path / "f")
    arguments = ["replay", str(tmp_path / "f"), "--out", str(tmp_path / "out")]
    cli.run(arguments)
    first = (tmp_path / "out" / "estimate.csv").read_bytes()

    assert cli.run(arguments) == 0
    assert (tmp_path / "out" / "estimate.csv").read_bytes() == first


def test_evaluate_prints_every_flight_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a", "b"):
        write_known_flight(tmp_path / name)

    assert cli.run(["evaluate", str(tmp_path / "a"), str(tmp_path / "b"), "--json"]) == 0
    reports = json.loads(capsys.readouterr().out)
    assert len(reports) == 2
    assert all(report["errors"]["horizontal_m"]["rms"] < 0.02 for report in reports)


def test_a_delay_of_the_video_can_be_given_instead_of_the_folders(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A click is dated like the frames: 2 s later the aircraft is 10 m further north."""
    click = Click(T0_US + 5_000_000, 159.5, 119.5, "below")
    write_known_flight(tmp_path / "f", clicks=(click,))
    for name, option in (("as_told", []), ("later", ["--time-offset-s", "2.0"])):
        assert cli.run(["replay", str(tmp_path / "f"), "--out", str(tmp_path / name), *option]) == 0
    lats = [
        float((tmp_path / name / "targets.csv").read_text().splitlines()[1].split(",")[1])
        for name in ("as_told", "later")
    ]
    capsys.readouterr()

    assert math.radians(lats[1] - lats[0]) * EARTH_M == pytest.approx(2.0 * SPEED_M_S, abs=0.1)


def test_a_calibration_of_ones_own_is_used_and_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_known_flight(tmp_path / "f")
    (tmp_path / "mine.toml").write_text(toml_of(replace(calibration_of("mind"), version="mind/mine")))
    versions = []
    for option in ([], ["--calibration", str(tmp_path / "mine.toml")]):
        assert cli.run(["evaluate", str(tmp_path / "f"), "--json", *option]) == 0
        versions.append(json.loads(capsys.readouterr().out)[0]["estimator"]["calibration"])

    assert versions == [calibration_of("double_angle").version, "mind/mine"]


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["replay", "nowhere", "--out", "out"], 1, "nowhere"),
        (["replay", "f"], 2, "--out"),
        (["evaluate", "f", "--leave-out", "SMOKE_SIGNAL"], 2, "SMOKE_SIGNAL"),
        (["evaluate", "f", "--leave-out", "ATTITUDE"], 1, "waiting for"),
        (["replay", "f", "--out", "out", "--calibration", "none.toml"], 2, "none.toml"),
        (["evaluate", "f", "--calibration", "f/flight.json"], 2, "is not TOML"),
        (["evaluate", "no_truth"], 1, "truth.csv"),
        (["evaluate", "no_telemetry"], 1, "telemetry.tlog"),
        (["replay", "f", "--out", "f/flight.json"], 1, "flight.json"),
    ],
)
def test_failures_name_the_input_and_show_no_traceback(
    tmp_path: Path, arguments: list[str], status: int, words: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    write_known_flight(tmp_path / "f")
    write_known_flight(tmp_path / "no_truth", truth=False)
    write_known_flight(tmp_path / "no_telemetry")
    (tmp_path / "no_telemetry" / "telemetry.tlog").unlink()

    assert cli.run(arguments) == status
    said = capsys.readouterr().err
    assert words in said.replace("\n", " ")
    assert "Traceback" not in said
