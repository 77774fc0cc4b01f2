"""``pilotage fit-likelihood``: what it refuses, and a whole run over small worlds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from benchmarks.likelihood import cli
from benchmarks.likelihood.samples import collect
from estimator.registration.calibration import calibration_of, parse_calibration
from simulator.scenario import WorldSection


@pytest.fixture
def app() -> typer.Typer:
    made = typer.Typer()
    cli.register(made)
    return made


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--channel", "smell"], "'smell' is none of: double_angle"),
        (["--seeds", "201-205"], "overlap"),
        (["--seeds", "x"], "neither A nor A-B"),
        (["--out", "nowhere/c.toml"], "there is no folder 'nowhere'"),
    ],
)
def test_misuse_is_said_before_anything_flies(
    app: typer.Typer, arguments: list[str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    result = CliRunner().invoke(app, arguments)

    assert result.exit_code == 2
    assert said in result.output


@pytest.mark.parametrize(("version", "following"), [("mind/3", "mind/4"), ("by hand", "mind/1"), ("mind/9", "mind/10")])
def test_versions_count_up(version: str, following: str) -> None:
    assert cli.next_version(version, "mind") == following


def test_a_run_over_small_worlds(app: typer.Typer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Worlds of 720 m, eight pictures each: the file can be read, and says what it was made of."""
    small = WorldSection(half_size_m=360.0, gsd_m=0.4)

    def collect_small(seeds, config, pictures, folder, tell):
        found = collect(seeds, config, pictures, folder, tell, small)
        right = [s for s in found if s.right_place]
        assert len(right) >= 0.8 * pictures * len(seeds)
        off = [np.hypot(*s.displacement_ne_m) for s in right if s.displacement_ne_m is not None]
        # drawn with sigmas of 1 to 25 m, and what the tilt does
        assert 1.0 < np.median(off) < 40.0
        assert len([s for s in found if not s.right_place]) >= 0.8 * pictures * len(seeds)
        assert all(s.wrong for s in found if not s.right_place)
        return found

    monkeypatch.setattr("benchmarks.likelihood.samples.collect", collect_small)
    out = tmp_path / "mine.toml"

    result = CliRunner().invoke(
        app, ["--seeds", "3", "--check-seeds", "6", "--pictures", "8", "--out", str(out), "--cache", str(tmp_path)]
    )

    assert result.exit_code == 0, result.output
    made = parse_calibration(out.read_text(), "mine.toml")
    assert made.version == cli.next_version(calibration_of("double_angle").version, "double_angle")
    assert made.fitted_on["seeds"] == "3"
    assert made.version in result.output
