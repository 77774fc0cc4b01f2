"""Figures of flights home, and files that are gone on with."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

from typer.testing import CliRunner

from benchmarks.homing_flights import GUST_SHARE, WIND_M_S, Homing, scenario_for
from benchmarks.homings import app, line, summary
from benchmarks.kept_lines import finite, read_rows

FLIGHT = Homing(
    seed=7, wind_m_s=3.0, outcome="landed", reason="", length_m=1000.0, touch_m=1.2, sink_m_s=0.5, estimate_m=1.1,
    estimate_std_m=1.5, worst_m=4.0, worst_sigmas=2.5, aside_m=5.0, rms_m=2.0, waited_s=0.0, home_s=200.0,
    drift_of_autopilot_m_s=1.0, times_real_time=1.0,
)  # fmt: skip
LOST = replace(
    FLIGHT, seed=8, outcome="abort", reason="the place is lost", touch_m=math.nan, sink_m_s=math.nan,
    estimate_m=math.nan, estimate_std_m=math.nan, home_s=math.nan, worst_sigmas=6.0, worst_m=30.0, rms_m=4.0,
)  # fmt: skip


def test_flights_that_do_not_land_count_against_it() -> None:
    found = summary([FLIGHT, LOST, replace(FLIGHT, seed=9, touch_m=6.0)])

    assert (found.flights, found.landed, found.within_5_m, found.within_1_5_m, found.beyond_5_sigmas) == (3, 2, 1, 1, 1)
    assert (found.touch_mean_m, found.touch_max_m, found.worst_m) == (3.6, 6.0, 30.0)
    assert math.isclose(found.rms_m, math.sqrt((4.0 + 16.0 + 4.0) / 3.0))
    assert summary([]).flights == 0


def test_kept_flights_are_not_flown_again_and_a_missed_bound_is_told(tmp_path: Path) -> None:
    out = tmp_path / "homings.jsonl"
    out.write_text("".join(json.dumps(finite(asdict(one))) + "\n" for one in (FLIGHT, LOST)), encoding="utf-8")

    assert math.isnan(read_rows(out, Homing)[1].touch_m)
    good = CliRunner().invoke(app, ["--seeds", "7-7", "--out", str(out)])
    bad = CliRunner().invoke(app, ["--seeds", "7-8", "--out", str(out)])

    assert good.exit_code == 0 and line(FLIGHT) in good.output
    assert bad.exit_code == 1 and "seed 8: abort (the place is lost)" in bad.output
    assert len(out.read_text(encoding="utf-8").splitlines()) == 2


def test_nonsense_on_the_command_line_is_refused() -> None:
    for arguments in (["--blind", "30"], ["--blind", "60-30"], ["--when-lost", "pray"]):
        found = CliRunner().invoke(app, ["--seeds", "7-7", *arguments])
        assert found.exit_code == 2, found.output


def test_winds_differ_from_seed_to_seed_within_the_bound() -> None:
    winds = [scenario_for(seed).flight.wind_m_s for seed in range(1, 20)]

    assert min(winds) < 0.3 * WIND_M_S and 0.7 * WIND_M_S < max(winds) <= WIND_M_S
    assert all(scenario_for(s).flight.gust_std_m_s >= GUST_SHARE * scenario_for(s).flight.wind_m_s for s in (1, 2))
