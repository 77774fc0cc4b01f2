"""Scenario files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from simulator.errors import ScenarioError
from simulator.scenario import load_scenario


def test_demo_is_built_in() -> None:
    demo = load_scenario("demo")
    camera = demo.camera.intrinsics()
    assert (camera.width_px, camera.height_px) == (640, 480)
    assert 2 * np.degrees(np.arctan(320 / camera.fx_px)) == pytest.approx(60.0, abs=1e-6)
    assert sum(end - start for start, end in demo.gps_denied_s) == 600.0
    assert demo.camera.mount().pitch_rad == pytest.approx(-np.pi / 2)


def test_file_overrides_defaults(tmp_path: Path) -> None:
    file = tmp_path / "windy.toml"
    file.write_text("duration_s = 30.0\ngps_denied_s = [[1.0, 2.0]]\n[flight]\nwind_m_s = 9.0\n")
    scenario = load_scenario(str(file))
    assert (scenario.name, scenario.duration_s, scenario.flight.wind_m_s) == ("windy", 30.0, 9.0)
    assert scenario.camera.width_px == 640


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("duration_s = ", "is not TOML"),
        ("duration_s = -3.0", "duration_s"),
        ("[camera]\nwidth = 640", "camera.width"),
        ("[camera]\nwidth_px = 641", "camera.width_px"),
        ("gps_cut_s = [[5.0, 5.0]]", "does not end after its start"),
        ("[world]\nhalf_size_m = 150.0", "too small"),
        ("[flight]\nheight_agl_m = [120.0, 80.0]", "from high to low"),
        ("[sensors]\ngyro_noise_rad_s = nan", "sensors.gyro_noise_rad_s"),
    ],
)
def test_errors_name_the_value(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(ScenarioError, match=r"bad\.toml") as error:
        load_scenario(str(file))
    assert said in str(error.value)


def test_unknown_name_lists_what_there_is() -> None:
    with pytest.raises(ScenarioError, match="demo"):
        load_scenario("moon")


def test_binary_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="is not TOML"):
        load_scenario(str(file))
