"""What a set of landings is summed up to, and that half of a measurement is kept."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.closed_loop import Coded
from benchmarks.landing_flights import Landing, scenario_for
from benchmarks.landings import app, summary

LANDING = Landing(401, 3.0, "landed", "", 0.06, 0.07, 0.25, 0.05, 0.02, 4.0, 45.0, 1.5, 0.4, 0.5)


def test_only_landings_count_for_the_error() -> None:
    aborted = replace(LANDING, seed=402, outcome="abort", reason="lost", touch_m=math.nan)
    worse = replace(LANDING, seed=403, touch_m=0.20, estimate_m=0.10)
    found = summary([LANDING, aborted, worse])

    assert (found.landings, found.landed, found.aborted, found.within_15_cm) == (3, 2, 1, 1)
    assert found.touch_mean_m == pytest.approx(0.13)
    assert found.touch_max_m == pytest.approx(0.20)
    assert found.estimate_rms_m == pytest.approx(math.sqrt((0.02**2 + 0.10**2) / 2))


def test_kept_landings_are_not_flown_again_and_a_missed_bound_is_told(tmp_path: Path) -> None:
    out = tmp_path / "landings.jsonl"
    out.write_text(json.dumps(asdict(LANDING)) + "\n")
    done = CliRunner().invoke(app, ["--seeds", "401", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "touched 0.060 m off" in done.output

    out.write_text(json.dumps(asdict(replace(LANDING, touch_m=0.6))) + "\n")
    assert CliRunner().invoke(app, ["--seeds", "401", "--out", str(out)]).exit_code == 1
    assert CliRunner().invoke(app, ["--seeds", "401", "--gimbal", "none"]).exit_code == 2


def test_wind_is_of_the_seed_and_within_what_is_claimed() -> None:
    winds = [scenario_for(seed, "fixed").flight.wind_m_s for seed in range(401, 421)]
    assert 0.0 <= min(winds) < 1.5
    assert 4.5 < max(winds) <= 6.0
    assert scenario_for(401, "fixed") == scenario_for(401, "fixed")


def test_pictures_come_out_of_the_codec_one_by_one() -> None:
    coded = Coded(320, 240, 25.0, 2_000_000)
    shade = np.repeat(np.linspace(40, 200, 320, dtype=np.uint8)[None], 240, axis=0)
    for _ in range(3):
        out = coded.through(np.repeat(shade[..., None], 3, axis=2))
        assert out is not None
        assert out.shape == (240, 320)
    # Limited range and back costs a grey level or two, the codec little on a slope.
    assert np.abs(out.astype(int) - shade).mean() < 2
