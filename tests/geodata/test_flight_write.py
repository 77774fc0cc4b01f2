from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from geodata.flight import FlightFolder
from geodata.flight_meta import FlightMeta
from geodata.flight_tables import Click, FrameTimes, TargetTruth, Truth
from geodata.flight_write import (
    CsvAppender,
    write_clicks_csv,
    write_flight_json,
    write_frames_csv,
    write_targets_truth_csv,
    write_truth_csv,
)
from geodata.tlog import TlogWriter
from tests.geodata.test_tlog import T0_US, packets


def test_what_is_written_is_what_a_flight_folder_reads(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    t_us = T0_US + np.arange(20) * 100_000
    angles = rng.uniform(-1.0, 1.0, (5, 20))
    truth = Truth(t_us, *angles[:2], rng.uniform(0, 900, 20), *angles[2:], rng.normal(0, 5, (20, 3)))
    truth.yaw_rad[3] = math.nan
    clicks = [
        Click(int(t_us[2]), 12.345, 67.0, "tower, north", 30.5, "flat"), Click(int(t_us[3]), 1.0, 2.0, 'the "pond"'),
    ]  # fmt: skip
    targets = [TargetTruth("tower, north", 0.56, 0.61, 700.125), TargetTruth("T2", -0.56, -0.61, -3.5)]
    write_flight_json(tmp_path, FlightMeta.model_validate({"schema": "pilotage.flight/1", "name": "Übung", "x": 1}))
    write_frames_csv(tmp_path / "frames.csv", FrameTimes(np.arange(20), t_us))
    write_clicks_csv(tmp_path / "clicks.csv", clicks)
    write_targets_truth_csv(tmp_path / "targets_truth.csv", targets)
    write_truth_csv(tmp_path / "truth.csv", truth)
    with TlogWriter(tmp_path / "telemetry.tlog") as writer:
        for item in packets(100):
            writer.write(*item)

    flight = FlightFolder.open(tmp_path)
    read = flight.truth()

    assert flight.name == "Übung"
    assert flight.clicks() == clicks
    times = flight.frame_times()
    assert times is not None
    assert times.t_video_us.tolist() == t_us.tolist()
    assert read is not None
    assert_allclose(read.lat_rad, truth.lat_rad, atol=2e-12)  # ten decimals of a degree: 0.01 mm
    assert_allclose(read.yaw_rad, truth.yaw_rad, atol=1e-7)
    assert_allclose(read.vel_ned_m_s, truth.vel_ned_m_s, atol=1e-4)
    found = flight.targets_truth()
    assert list(found) == ["tower, north", "T2"]
    assert found["T2"].lat_rad == pytest.approx(-0.56, abs=2e-12)
    assert not [name for name in tmp_path.iterdir() if name.name.startswith(".")]


def test_lines_are_with_the_system_at_once_and_survive_a_kill(tmp_path: Path) -> None:
    """A line cut off by a kill is removed when the file is taken up again."""
    path = tmp_path / "frames.csv"
    with CsvAppender(path, ("frame", "time_us")) as table:
        table.write(0, 1000)
        assert path.read_text() == "frame,time_us\n0,1000\n"
    with path.open("a") as file:
        file.write("1,20")

    with CsvAppender(path, ("frame", "time_us")) as table:
        table.write(1, 2000)

    assert path.read_text() == "frame,time_us\n0,1000\n1,2000\n"


def test_cells_must_match_the_columns(tmp_path: Path) -> None:
    with CsvAppender(tmp_path / "a.csv", ("a", "b")) as table:
        with pytest.raises(ValueError, match="3 cells for the 2 columns"):
            table.write(1, 2, 3)
        table.write(None, math.nan)
    assert (tmp_path / "a.csv").read_text() == "a,b\n,\n"


def test_failed_write_leaves_the_old_description(tmp_path: Path) -> None:
    write_flight_json(tmp_path, FlightMeta.model_validate({"schema": "pilotage.flight/1", "name": "old"}))
    bad = FlightMeta.model_validate({"schema": "pilotage.flight/1", "pad": {"size_m": object()}})
    with pytest.raises(ValueError, match="serialize"):
        write_flight_json(tmp_path, bad)
    assert json.loads((tmp_path / "flight.json").read_text())["name"] == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["flight.json"]
