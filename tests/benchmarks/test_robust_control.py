"""The benchmark's own arithmetic and air: gusts, wrong aeroplanes, noise, verdicts, pages."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from benchmarks import robust_control
from benchmarks.robust_control import MUST, Row, halves, ratios, report, summary
from benchmarks.robust_flights import (
    BASELINE,
    CONDITIONS,
    DT_S,
    LAWS,
    NO_SIGN,
    ROBUST,
    Condition,
    Flight,
    Seen,
    Sensors,
    discrete_gust_m_s,
    fly,
    wrong,
)
from simulator.vehicles.airframes import OSPREY

LEVEL = Seen(25.0, 0.0, 0.0, np.zeros(3), 0.1, 0.05)
ROW = Row("gusts", BASELINE, 10, 10, (2.0, 0.4, 4.0, 1.0), (9.0, 1.0, 9.0, 9.0), 30.0)


def test_discrete_gust_is_of_the_regulation() -> None:
    """U_ds = 10.12 m/s is reached after H = 15.24 m, half of it at H / 2, none outside of 2 H."""
    assert discrete_gust_m_s(15.24 / 25.0, 25.0) == pytest.approx(10.12)
    assert discrete_gust_m_s(7.62 / 25.0, 25.0) == pytest.approx(5.06)
    assert [discrete_gust_m_s(t, 25.0) for t in (-0.1, 0.0, 1.3)] == [0.0, 0.0, 0.0]


def test_wrong_aeroplanes_are_wrong_by_as_much_as_is_said() -> None:
    shares = []
    for seed in range(30):
        one = wrong(OSPREY, seed, 0.4)
        shares += [a / b for a, b in zip(one.roll_rad_s2, OSPREY.roll_rad_s2, strict=True)]
        assert one.lift_m_s2[0] == OSPREY.lift_m_s2[0]
        assert one.drag_m_s2[0] == OSPREY.drag_m_s2[0]
    assert 0.6 <= min(shares) < 0.65
    assert 1.35 < max(shares) <= 1.4
    assert wrong(OSPREY, 3, 0.0).roll_rad_s2 == OSPREY.roll_rad_s2


def test_sensors_err_within_table_3_1() -> None:
    sensors = Sensors(5, Condition("noise", sensors=True))
    seen = [sensors.of(LEVEL) for _ in range(2000)]
    rates = np.degrees([one.rate_rad_s for one in seen])
    assert 1.6 < np.abs(rates).max() <= 1.7
    assert np.abs(rates.mean()) < 0.1
    speeds = np.array([one.speed_m_s for one in seen]) - 25.0
    assert 0.37 < np.abs(speeds).max() <= 0.4
    assert seen[0].roll_rad == LEVEL.roll_rad
    assert Sensors(5, Condition("none")).of(LEVEL) is LEVEL


def test_pictures_are_late_and_their_scale_is_wrong() -> None:
    """4 rad/s: 63 % of a step after 0.25 s; 5 % of 25 m/s are 1.25 m/s."""
    sensors = Sensors(5, Condition("camera", sensors=True, camera=True))
    first = [sensors.of(LEVEL) for _ in range(300)]
    off = np.mean([one.speed_m_s for one in first]) - 25.0
    assert abs(abs(off) - 1.25) < 0.05
    rolled = [sensors.of(replace(LEVEL, roll_rad=0.6)).roll_rad for _ in range(100)]
    assert rolled[round(0.25 / DT_S)] == pytest.approx(0.1 + 0.5 * (1 - math.exp(-1)), abs=0.03)
    assert rolled[-1] == pytest.approx(0.6, abs=0.02)


def test_a_flight_is_its_seed_and_the_robust_law_is_better_in_it() -> None:
    condition = next(one for one in CONDITIONS if one.name == MUST)
    plain, robust = (fly(condition, LAWS[name], 3) for name in (BASELINE, ROBUST))
    assert plain.held and robust.held
    assert_allclose(fly(condition, LAWS[ROBUST], 3).error, robust.error, rtol=0, atol=0)
    plain_rms, rms = (np.sqrt(np.mean(one.error**2, axis=0)) for one in (plain, robust))
    assert np.all(rms < plain_rms)


def test_summary_is_in_degrees_and_metres() -> None:
    error = np.tile((math.radians(3.0), 0.5, math.radians(1.0), -math.radians(2.0)), (10, 1))
    rows = summary(Condition("x"), "law", [Flight(error, math.radians(7.0), True), Flight(2 * error, math.nan, False)])
    assert_allclose(rows.rms, (4.5, 0.75, 1.5, 3.0))
    assert_allclose(rows.worst, (6.0, 1.0, 2.0, 4.0))
    assert (rows.held, rows.activity_deg_s) == (1, None)


def test_half_is_of_every_channel_and_every_flight() -> None:
    half = replace(ROW, rms=(1.0, 0.2, 2.0, 0.5))
    assert halves(half, ROW)
    assert not halves(replace(half, rms=(1.0, 0.2, 2.1, 0.5)), ROW)
    assert not halves(replace(half, held=9), ROW)
    assert_allclose(ratios(half, ROW), 0.5)


def test_page_says_what_was_missed() -> None:
    robust = {"calm": (0.5, 0.1, 3.0, 0.2), MUST: (0.5, 0.1, 1.0, 0.2)}
    rows = [
        replace(ROW, condition=condition, law=law, rms=rms)
        for condition in ("calm", MUST)
        for law, rms in ((BASELINE, ROW.rms), (NO_SIGN, ROW.rms), (ROBUST, robust[condition]))
    ]
    page = report(rows, "the command")
    assert "**but calm**" in page
    assert "0.25 (q), 0.25 (V), 0.25 (p), 0.20 (r)" in page
    assert (
        "| gusts, parameters | **robust** | 10 of 10 | 0.50 | 0.10 | 1.00 | 0.20 | 0.25, 0.25, 0.25, 0.20 | yes | 30 |"
        in page
    )


def test_short_run_writes_page_figures_and_figure(tmp_path: Path) -> None:
    result = CliRunner().invoke(robust_control.app, ["--seeds", "4-5", "--short", "--out", str(tmp_path)])
    figures = json.loads((tmp_path / "robust-control.json").read_text())
    rows = {row["law"]: row for row in figures["rows"]}
    assert set(rows) == set(LAWS)
    assert {row["flights"] for row in rows.values()} == {1}
    won = max(a / b for a, b in zip(rows[ROBUST]["rms"], rows[BASELINE]["rms"], strict=True)) <= 0.5
    assert result.exit_code == (0 if won else 1), result.output
    assert "robust" in (tmp_path / "robust-control.svg").read_text()
    assert (tmp_path / "robust-control.md").read_text().startswith("# Robust control results")
