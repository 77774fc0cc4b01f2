"""The benchmark's own arithmetic: distances, verdicts, pages; and one flight from a seed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from benchmarks import path_following
from benchmarks.path_flights import (
    Flight,
    Manoeuvre,
    Navigation,
    NavigationErrors,
    dense,
    distances_m,
    fly,
    line,
    quick_bends,
    turn,
)
from benchmarks.path_following import OURS, Published, halves, holds, summary
from estimator.geometry.local import LocalFrame
from guidance.path import CubicSegment, straight
from simulator.vehicles.rmax import Rmax, YacsInput

SHORT = Manoeuvre("SLN", 3.0, 0.0, (straight((0.0, 0.0, -40.0), (20.0, 0.0, -40.0)),))


def test_distance_is_to_the_piece_that_is_flown_not_to_the_one_that_is_crossed() -> None:
    """A path out and, a metre above, back; the track is 0.8 m above the way out, so 0.2 m below the way back."""
    path = dense([straight((0.0, 0.0, 0.0), (50.0, 0.0, 0.0)), straight((50.0, 0.0, 0.0), (0.0, 0.0, -1.0))])
    track = np.column_stack((np.arange(0.0, 20.0, 0.2), np.zeros(100), np.full(100, -0.8)))
    assert_allclose(distances_m(path, track), 0.8, atol=1e-3)
    assert_allclose(distances_m(path[:, :2], track[:, :2] + (0.0, 0.3)), 0.3, atol=2e-3)


@pytest.mark.parametrize("curves", [turn(0.0, True), turn(-30.0, False), turn(30.0, True), line(), quick_bends()])
def test_paths_are_joined(curves: tuple[CubicSegment, ...]) -> None:
    for one, after in pairwise(curves):
        assert_allclose(one.end_ned_m, after.start_ned_m, atol=1e-9)
        out, on = one.end_tangent_ned_m, after.start_tangent_ned_m
        assert float(out @ on) / float(np.linalg.norm(out) * np.linalg.norm(on)) == pytest.approx(1.0, abs=1e-6)


def test_turns_climb_by_thirty_metres_to_the_side_that_is_named() -> None:
    right, left = turn(30.0, True), turn(-30.0, False)
    assert right[1].start_ned_m[2] - right[-2].end_ned_m[2] == pytest.approx(30.0)
    assert left[1].start_ned_m[2] == pytest.approx(-40.0)
    assert right[4].end_ned_m[1] > 80.0 and left[4].end_ned_m[1] < -80.0


def test_a_flight_is_its_seeds_and_is_measured_on_the_true_position() -> None:
    first, again, other = (fly(SHORT, OURS, seed) for seed in (5, 5, 6))
    assert np.array_equal(first.track_ned_m, again.track_ned_m)
    assert not np.array_equal(first.error_m[:100], other.error_m[:100])
    assert first.arrived
    assert_allclose(first.error_m, np.hypot(first.track_ned_m[:, 1], first.track_ned_m[:, 2] + 40.0), atol=0.06)
    # A blunder of navigation by metres is an error of the flight, though the control sees none of it.
    lost = fly(SHORT, OURS, 5, NavigationErrors(position_m=5.0, position_time_s=1e6))
    assert lost.error_m.mean() > 1.0 > lost.seen_error_m[-100:].mean()


def test_navigation_errs_by_what_it_says() -> None:
    rmax = Rmax(LocalFrame(1.0, 0.2, 0.0), np.zeros(3), 0.0, 1, np.zeros(3), 0.0)
    state, errors = rmax.step(0, 0.02, YacsInput()), NavigationErrors()
    known = [Navigation(seed, errors).of(state, 0.02) for seed in range(400)]
    sigma = np.std([one.pos_ned_m - state.pos_ned_m for one in known], axis=0)
    assert_allclose(sigma, (0.1, 0.1, 0.15), rtol=0.12)
    assert np.std([one.vel_ned_m_s for one in known]) == pytest.approx(0.06, rel=0.12)
    assert np.std([one.roll_rad for one in known]) == pytest.approx(math.radians(math.hypot(1.0, 0.2)), rel=0.12)


def flight(errors: list[float], arrived: bool = True) -> Flight:
    error = np.array(errors)
    track, speed = np.zeros((len(error), 3)), np.full(len(error), 3.0)
    return Flight(error, 0.5 * error, 0.25 * error, track, speed, np.zeros((1, 3)), arrived)


def test_summary_and_verdict() -> None:
    row = summary(SHORT, "ours", [flight([0.1, 0.3]), flight([0.2, 0.6])])
    assert (row.mean_m, row.max_m, row.worst_m) == pytest.approx((0.3, 0.45, 0.6))
    assert (row.seen_mean_m, row.level_max_m, row.arrived) == pytest.approx((0.15, 0.1125, 2))
    assert (
        holds(row, Published(0.31, 0.6, 0.2))
        and not halves(row, Published(0.5, 0.91, 0.2))
        and not halves(row, Published(0.61, 0.8, 0.2))
    )
    assert not holds(row, Published(0.29, 0.6, 0.2)) and not holds(row, Published(0.31, 0.59, 0.2))
    assert not holds(replace(row, arrived=1), Published(0.31, 0.6, 0.2))
    assert halves(row, Published(0.61, 0.91, 0.2))


@pytest.mark.parametrize(("published", "status"), [(Published(0.6, 1.9, 0.2), 0), (Published(0.001, 0.001, 0.2), 1)])
def test_the_command_writes_its_page_and_fails_where_it_is_worse(
    published: Published, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(path_following, "table_cases", lambda: [(SHORT, published)])
    monkeypatch.setattr(path_following, "quick_bends", lambda: SHORT.curves)
    result = CliRunner().invoke(path_following.app, ["--seeds", "3-9", "--short", "--out", str(tmp_path)])
    assert result.exit_code == status, result.output
    figures = json.loads((tmp_path / "path-following.json").read_text())
    assert figures["table_4_1"][0]["ours"]["flights"] == 2
    assert len(figures["figure_4_12"]) == 3
    page = (tmp_path / "path-following.md").read_text()
    assert ("all rows." in page) == (status == 0)
    assert (tmp_path / "path-following.svg").read_text().startswith("<svg")


def test_the_table_is_that_of_the_thesis() -> None:
    rows = [(m.name, m.wind_m_s, m.cruise_m_s, p.mean_m, p.max_m) for m, p in path_following.table_cases()]
    assert rows[0] == ("HR", 4.0, 10.0, 1.2, 3.4) and rows[-1] == ("SLN", 0.0, 3.0, 0.3, 0.8)
    assert [row[0] for row in rows] == ["HR", "HL", "DR", "DL", "CR", "CL", "HR", "HL", "DL", "SLN"]
