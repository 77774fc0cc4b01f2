"""Verdicts, and a command whose exit status tells them."""

from __future__ import annotations

import io
import json
import math

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from benchmarks import stages
from benchmarks.budget import Measurement, missed, percentile, print_table, unmeasured
from benchmarks.cli import register


@pytest.mark.parametrize(
    ("value", "limit", "at_least", "verdict"),
    [
        (49.9, 50.0, False, "ok"), (50.0, 50.0, False, "ok"), (50.1, 50.0, False, "MISSED"), (0.0, 0.0, False, "ok"),
        (2.0, 2.0, True, "ok"), (1.99, 2.0, True, "MISSED"), (math.nan, 2.0, True, "not measured"),
        (7.0, None, False, ""), (math.inf, 50.0, False, "MISSED"),
    ],
)  # fmt: skip
def test_a_budget_is_kept_up_to_its_limit(value: float, limit: float | None, at_least: bool, verdict: str) -> None:
    measurement = Measurement("x", value, "ms", limit, at_least)

    assert measurement.verdict == verdict
    assert missed([measurement]) == (verdict == "MISSED")
    assert json.loads(json.dumps(measurement.as_dict(), allow_nan=False))["verdict"] == verdict


def test_percentiles_are_by_nearest_rank() -> None:
    values = [float(n) for n in range(100, 0, -1)]

    assert (percentile(values, 0.5), percentile(values, 0.95), percentile(values, 0.99)) == (50.0, 95.0, 99.0)
    assert percentile(values, 1.0) == 100.0
    assert percentile([3.0], 0.01) == 3.0
    assert math.isnan(percentile([], 0.5))


def test_the_table_shows_every_quantity_with_what_it_may_take() -> None:
    out = io.StringIO()
    print_table(
        [Measurement("late", 60.0, "ms", 50.0), Measurement("fast", 3.0, "x", 2.0, at_least=True),
         *unmeasured(["browser"], "no browser at all")], Console(file=out, width=120),
    )  # fmt: skip
    lines = out.getvalue().splitlines()[1:]

    assert ["≤ 50 ms" in lines[0], "60 ms" in lines[0], "MISSED" in lines[0]] == [True] * 3
    assert ["≥ 2 x" in lines[1], "ok" in lines[1]] == [True] * 2
    assert "not measured" in lines[2]
    assert "no browser at all" in lines[2]


@pytest.mark.parametrize(("limit_ms", "status"), [(1e9, 0), (0.0, 1)])
def test_a_missed_budget_is_a_failure_of_the_command(
    limit_ms: float, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stages, "_stages", lambda: [stages.Stage("adding", limit_ms, lambda: sum(range(1000)), 20)])
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, ["--short", "--only", "stages", "--json"])

    assert result.exit_code == status, result.output
    (told,) = json.loads(result.stdout)
    assert told["name"] == "adding"
    assert told["value"] > 0.0
    assert told["verdict"] == ("ok" if status == 0 else "MISSED")


def test_every_stage_of_the_design_can_be_timed() -> None:
    measured = stages.measure_stages(short=True)

    assert sum("landing pad" in m.name for m in measured) == 4
    assert len(measured) == 9
    assert all(m.value > 0.0 and m.limit is not None for m in measured)


def test_what_cannot_be_measured_is_no_failure_but_is_told() -> None:
    assert not missed(unmeasured(["a", "b"], "no browser"))
    assert unmeasured(["a"], "no browser")[0].as_dict()["value"] is None
