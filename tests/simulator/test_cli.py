"""The command line: what it refuses and what it prepares."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from geodata.elevation import ElevationGrid
from geodata.raster import open_raster
from simulator.cli import app, default_cache, parse_video
from simulator.errors import LinkAddressError
from simulator.scenario import Scenario
from simulator.world.world import World

RUNNER = CliRunner()


def run(*arguments: str) -> tuple[int, str]:
    result = RUNNER.invoke(app, list(arguments))
    return result.exit_code, result.output


def test_help_has_an_example() -> None:
    code, text = run("--help")
    assert code == 0
    assert "pilotage sim demo" in text


def test_offline_needs_a_folder() -> None:
    code, text = run("demo", "--offline")
    assert code == 2
    assert "--record" in text


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("nowhere",), 1, "demo"),
        (("demo", "--mavlink", "carrier-pigeon"), 2, "udpout:127.0.0.1:14550"),
        (("demo", "--video", "rtsp://x/y"), 2, "udp://127.0.0.1:5600"),
    ],
)
def test_errors_say_what_to_do(arguments: tuple[str, ...], code: int, said: str) -> None:
    status, text = run(*arguments)
    assert status == code
    assert said in text.replace("\n", "")
    assert "Traceback" not in text


def test_video_addresses() -> None:
    assert parse_video("udp://127.0.0.1:5600") == ("127.0.0.1", 5600)
    for wrong in ("", "udp://127.0.0.1", "udp://h:99999", "file:x"):
        with pytest.raises(LinkAddressError):
            parse_video(wrong)


def test_cache_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_cache() == tmp_path / "pilotage" / "worlds"


def test_prepare_writes_the_set_up_only(world: World, scenario: Scenario, world_cache: Path, tmp_path: Path) -> None:
    file = tmp_path / "small.toml"
    section = scenario.world
    file.write_text(
        f"[world]\nhalf_size_m = {section.half_size_m}\ngsd_m = {section.gsd_m}\n"
        "[flight]\nheight_agl_m = [70.0, 80.0]\n"
    )
    out = tmp_path / "set-up"
    code, text = run(str(file), "--seed", "7", "--prepare", str(out), "--cache", str(world_cache))
    assert code == 0, text
    assert {path.name for path in out.iterdir()} == {"flight.json", "reference.tif", "elevation.tif"}
    meta = json.loads((out / "flight.json").read_text())
    assert meta["vehicle"]["type"] == "helicopter"
    assert meta["camera"]["mount"]["pitch_deg"] == -90.0
    raster = open_raster(out / "reference.tif")
    assert raster.band_count == 3
    assert raster.gsd_m == pytest.approx(0.5, rel=0.002)
    ground = ElevationGrid.open(out / "elevation.tif", world.frame)
    landmark = world.landmarks[0]
    height_m = float(ground.alt_amsl_m(landmark.north_m, landmark.east_m))
    assert height_m == pytest.approx(84.0 + landmark.height_m, abs=0.8)
