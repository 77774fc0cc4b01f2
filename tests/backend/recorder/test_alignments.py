"""The operator's alignments in a flight folder: written, read with care, and given to the estimator in time."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.recorder.alignments import ALIGNMENT_COLUMNS, AlignmentFeed, AlignmentRow, read_alignments
from backend.recorder.folder import FlightWriter
from backend.replay.offline import ReplayOptions, ReplayResult, replay_flight
from estimator.geometry.local import LocalFrame
from estimator.measurements.operator_fix import KIND
from estimator.types import AlignmentSample
from geodata.flight import FlightFolder
from tests.backend.flight_maker import GROUND_M, LAT_DEG, LON_DEG, T0_US, plan, telemetry
from tests.backend.replay.flown import SPEED_M_S, lat_deg_at, write_known_flight

FRAME = LocalFrame(math.radians(LAT_DEG), math.radians(LON_DEG), GROUND_M)
COV = np.array([[4.0, 0.5], [0.5, 2.25]])
SAMPLE = AlignmentSample(T0_US + 2_000_000, T0_US + 1_000_000, 25, np.array([30.0, -12.0]), COV)
ROW = AlignmentRow.of(SAMPLE, T0_US + 900_000, 1, FRAME, (3.0, -4.0, 1.5), 'left "seat", Ø')


def recorded(folder: Path, *rows: AlignmentRow) -> FlightFolder:
    folder.mkdir(parents=True)
    writer = FlightWriter(folder, plan(), folder.name)
    for t_us, data in telemetry(3.0):
        writer.packet(t_us, data)
    for row in rows:
        writer.alignment(row)
    writer.close()
    return FlightFolder.open(folder)


def test_what_the_estimator_was_told_comes_back(tmp_path: Path) -> None:
    later = replace(ROW, t_us=ROW.t_us + 500_000, by="")
    other = replace(ROW, system_id=7)
    flight = recorded(tmp_path / "f", later, ROW, other)
    found = read_alignments(flight)
    feed = AlignmentFeed(flight, FRAME, lambda t_us: t_us + 100_000)
    given = [feed.until(T0_US + at_us) for at_us in (1_999_999, 2_000_000, 9_000_000, 9_000_000)]

    assert [(row.t_us, row.by) for row in found] == [(ROW.t_us, ROW.by), (later.t_us, "operator")]
    assert (found[0].north_m, found[0].east_m, found[0].std_m) == (3.0, -4.0, 1.5)
    assert [len(samples) for samples in given] == [0, 1, 1, 0]
    (again,) = given[1]
    assert (again.t_us, again.t_frame_us) == (SAMPLE.t_us, T0_US + 1_000_000)  # by the video's clock as known then
    assert_allclose(again.pos_ne_m, SAMPLE.pos_ne_m, atol=1e-3)
    assert_allclose(again.cov_ne_m2, COV, atol=1e-3)


def test_a_flight_that_nobody_aligned_has_no_table(tmp_path: Path) -> None:
    flight = recorded(tmp_path / "f")

    assert not (tmp_path / "f" / "alignments.csv").exists()
    assert read_alignments(flight) == []
    assert flight.warnings == [f"{tmp_path / 'f'}: has no video"]


@pytest.mark.parametrize(
    ("column", "cell"),
    [
        ("time_us", "soon"), ("time_us", "1.5"), ("frame_time_us", str(T0_US - 90_000_000)),
        ("frame_time_us", str(T0_US + 30_000_000)), ("system_id", "0"), ("system_id", "1.5"), ("lat_deg", "91"),
        ("lat_deg", "nan"), ("lon_deg", "181"), ("lon_deg", ""), ("std_n_m", "0"), ("std_n_m", "-1"),
        ("std_e_m", "inf"), ("std_e_m", "1e9"), ("cov_ne_m2", "3.1"), ("cov_ne_m2", "x"),
    ],
)  # fmt: skip
def test_a_line_that_cannot_be_is_left_out_in_words(tmp_path: Path, column: str, cell: str) -> None:
    flight = recorded(tmp_path / "f", ROW, ROW)
    path = tmp_path / "f" / "alignments.csv"
    lines = path.read_text().splitlines()
    cells = lines[1].split(",")
    cells[ALIGNMENT_COLUMNS.index(column)] = cell
    path.write_text("\n".join([lines[0], ",".join(cells), *lines[2:]]) + "\n")

    assert len(read_alignments(flight)) == 1
    assert any(f"line 2, column {column}" in warning and "left out" in warning for warning in flight.warnings)


@pytest.mark.parametrize("text", ["", "time_us\n1\n", "\xff", ",".join(ALIGNMENT_COLUMNS) + "\n1,2\n3,4\n"])
def test_a_table_that_is_none_is_done_without(tmp_path: Path, text: str) -> None:
    flight = recorded(tmp_path / "f")
    (tmp_path / "f" / "alignments.csv").write_bytes(text.encode("latin-1"))

    assert read_alignments(flight) == []
    assert any("done without it" in warning for warning in flight.warnings)


def test_a_place_on_another_continent_is_not_given_to_the_estimator(tmp_path: Path) -> None:
    flight = recorded(tmp_path / "f", replace(ROW, lat_deg=-33.0))

    assert AlignmentFeed(flight, FRAME, lambda t_us: t_us).until(T0_US + 9_000_000) == []
    assert any("beyond 100 km" in warning for warning in flight.warnings)


def test_a_replay_takes_the_operators_word_at_its_time(tmp_path: Path) -> None:
    """
    Flight: 5 m/s to the north, GPS denied from the fifth second on, nobody looks at the ground. After eight seconds
    the operator lays a picture of the seventh 25 m further east.
    Expected: from then on the estimate is about there, and has come as far north as it flew since; without the table,
    or told to do without it, the estimate goes straight on.
    """
    denied = ((T0_US + 5_000_000, T0_US + 60_000_000),)
    flight = write_known_flight(tmp_path / "f", 12.0, gps_denied=denied)
    plain = replay_flight(flight, tmp_path / "plain")
    of_frame_us = T0_US + 7_000_000
    row = replace(
        ROW, t_us=T0_US + 8_000_000, t_frame_us=of_frame_us, lat_deg=lat_deg_at(of_frame_us),
        lon_deg=LON_DEG + math.degrees(25.0 / (6.368e6 * math.cos(math.radians(LAT_DEG)))), std_ne_m=(1.0, 1.0),
        cov_ne_m2=0.0,
    )  # fmt: skip
    with (tmp_path / "f" / "alignments.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(ALIGNMENT_COLUMNS)
        table.writerow(row.cells())
    aligned = replay_flight(FlightFolder.open(tmp_path / "f"), tmp_path / "aligned")
    without = replay_flight(
        FlightFolder.open(tmp_path / "f"), tmp_path / "without", options=ReplayOptions(alignments=False)
    )

    (fix,) = [each for each in aligned.fixes if each.kind == KIND]
    assert fix.accepted
    assert fix.t_us == row.t_us
    assert east_at(aligned, row.t_us - 200_000) == pytest.approx(0.0, abs=1.0)
    assert fix.east_m == pytest.approx(25.0, abs=0.1)
    assert 20.0 < east_at(aligned, row.t_us + 200_000) < 25.5  # the map itself may be displaced by a little
    last = aligned.states[-1]
    assert last.pos_ned_m[0] == pytest.approx(SPEED_M_S * (last.t_us - T0_US) / 1e6, abs=2.0)
    assert "operator" in (tmp_path / "aligned" / "fixes.csv").read_text()
    assert not [each for each in (*plain.fixes, *without.fixes) if each.kind == KIND]
    assert_allclose(without.states[-1].pos_ned_m, plain.states[-1].pos_ned_m)
    assert abs(east_at(plain, row.t_us + 200_000)) < 1.0


def east_at(result: ReplayResult, t_us: int) -> float:
    states = result.states
    return float(np.interp(t_us, [s.t_us for s in states], [s.pos_ned_m[1] for s in states]))
