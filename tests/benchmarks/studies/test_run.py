"""A study end to end: simulated, replayed, cached, tabulated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.studies.catalogue import NAVIGATION
from benchmarks.studies.degraded import Degradation, PictureFault
from benchmarks.studies.flights import flown, source_digest
from benchmarks.studies.run import run_study
from benchmarks.studies.study import Column, ComputedRow, FlownRow, Study
from benchmarks.studies.tables import write_results
from estimator.navigator import NavigatorConfig
from simulator.scenario import CameraSection, FlightSection, Scenario, WorldSection

SCENARIO = Scenario(
    name="small",
    duration_s=14.0,
    gps_denied_s=((8.0, 13.0),),
    world=WorldSection(half_size_m=180.0, gsd_m=0.25),
    camera=CameraSection(width_px=320, height_px=240, frames_per_s=4.0),
    flight=FlightSection(height_agl_m=(70.0, 80.0), waypoints=6, hover_stops=0),
)
FLOWN = Study(
    "small", "A small study", "About it.",
    (
        FlownRow("map", "as it is", SCENARIO, NavigatorConfig()),
        FlownRow("no map", "no fixes", SCENARIO, NavigatorConfig(fix_interval_s=float("inf"))),
    ),
    NAVIGATION, "rms_m", "rms, m", segments_m=(20.0,),
)  # fmt: skip


def seconds_of(seed: int) -> dict[str, float]:
    return {"double": 2.0 * seed}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def test_flights_are_flown_replayed_and_tabulated(cache: Path, tmp_path: Path) -> None:
    said: list[str] = []
    with_map, without = run_study(FLOWN, [7], cache, 1, False, said.append)

    assert with_map.failures == without.failures == {}
    assert with_map.figures["fixes"] > 5
    assert without.figures["fixes"] == 0
    assert "fix_ms" not in without.figures
    # five seconds at about 10 Hz of states, only those without GPS
    assert 15 <= with_map.figures["states"] <= 55
    # a metre or two of GPS carried on for five seconds
    assert 0.0 < without.figures["rms_m"] < 8.0
    assert without.figures["by_vision"] < with_map.figures["by_vision"]
    assert "drift_20_m" in without.figures

    page = write_results(FLOWN, [with_map, without], "the command", [7], tmp_path)
    text = page.read_text()
    assert "the command" in text
    assert "| no map | no fixes |" in text
    stored = json.loads((tmp_path / "small.json").read_text())
    assert stored["rows"][0]["figures"]["rms_m"] == pytest.approx(with_map.figures["rms_m"])
    assert (tmp_path / "small.svg").exists()

    again: list[str] = []
    resumed = run_study(FLOWN, [7], cache, 1, True, again.append)
    assert [r.figures["rms_m"] for r in resumed] == [with_map.figures["rms_m"], without.figures["rms_m"]]
    assert again == [f"2 of 2 outcomes taken from {cache}"]


def test_a_degraded_row_is_given_other_input_and_has_an_outcome_of_its_own(cache: Path, tmp_path: Path) -> None:
    """The same flight and configuration: by night from its first half second without GPS there are fewer fixes."""
    row = FLOWN.rows[0]
    assert isinstance(row, FlownRow)
    rows = tuple(
        replace(row, name=name, degrade=degrade)
        for name, degrade in (
            ("as flown", Degradation((0.5, 9.0))),
            ("night", Degradation((0.5, 9.0), picture=PictureFault.NIGHT)),
        )
    )
    study = replace(FLOWN, rows=rows, columns=(Column("alarms", "alarms"), Column("before", "before")), segments_m=())
    clear, night = run_study(study, [7], cache, 1, False, lambda _: None)

    assert clear.failures == night.failures == {}
    assert "no_texture" in night.figures["alarms"]
    assert "no_texture" not in clear.figures["alarms"]
    assert night.figures["fixes"] < clear.figures["fixes"]
    assert night.figures["rms_during_m"] > 0.0
    assert (
        f"| night | as it is | {night.figures['alarms']} |"
        in write_results(study, [clear, night], "c", [7], tmp_path).read_text()
    )
    again: list[str] = []
    resumed = run_study(study, [7], cache, 1, True, again.append)
    assert [r.figures["alarms"] for r in resumed] == [clear.figures["alarms"], night.figures["alarms"]]


def test_a_whole_flight_in_the_cache_is_not_flown_again(cache: Path) -> None:
    digest = source_digest(("simulator",))
    before = flown(SCENARIO, 7, cache, digest)
    mark = before / "telemetry.tlog"
    written = mark.stat().st_mtime_ns
    assert flown(SCENARIO, 7, cache, digest) == before
    assert mark.stat().st_mtime_ns == written
    assert not list((cache / "flights").glob(".*")), "nothing half done stays behind"


@pytest.mark.parametrize("name", ["a.py", "calibration.toml"])
def test_other_code_has_another_digest(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("benchmarks.studies.flights.ROOT", tmp_path)
    (tmp_path / "part").mkdir()
    source = tmp_path / "part" / name
    source.write_text("x = 1\n")
    before = source_digest(("part",))
    source.write_text("x = 2\n")
    assert source_digest(("part",)) != before


def test_computed_rows_are_averaged_over_seeds(tmp_path: Path) -> None:
    study = Study("c", "t", "a", (ComputedRow("twice", "x", seconds_of),), (Column("d", "double"),), "double", "d")
    (result,) = run_study(study, [1, 3], tmp_path, 1, False, lambda _: None)

    assert result.figures["double"] == 4.0
    assert result.figures["seeds"] == 2


def test_a_replay_that_fails_is_told_and_in_no_figure(cache: Path, tmp_path: Path) -> None:
    # denied from the start: the estimator has nothing to begin with but home, three seconds on
    scenario = SCENARIO.model_copy(update={"name": "brief", "duration_s": 1.0, "gps_denied_s": ((0.0, 0.9),)})
    study = replace(FLOWN, rows=(FlownRow("brief", "too short", scenario, NavigatorConfig()),), segments_m=())
    (result,) = run_study(study, [7], cache, 1, False, lambda _: None)

    assert result.figures["seeds"] == 0
    assert "no estimate" in result.failures[7]
    assert "no estimate" in write_results(study, [result], "c", [7], tmp_path).read_text()
