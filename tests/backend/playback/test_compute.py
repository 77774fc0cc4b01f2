"""The computation of a flight's estimate, as the process of its own that it is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from backend.playback.estimate import EstimateTable
from tests.backend.replay.flown import write_known_flight


def compute(flight: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "backend.playback.compute", str(flight), str(out)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def test_it_tells_how_far_it_is_and_leaves_an_estimate_that_clicks_can_use(tmp_path: Path) -> None:
    write_known_flight(tmp_path / "f")
    done = compute(tmp_path / "f", tmp_path / "out")
    table = EstimateTable.read(tmp_path / "out" / "estimate.csv")

    assert done.returncode == 0, done.stderr
    parts = [float(line) for line in done.stdout.splitlines()]
    assert parts == sorted(parts)
    assert parts[-1] == 1.0
    assert table.camera_pose_at(int(table.t_us[-1])) is not None


def test_a_flight_that_cannot_be_computed_is_told_in_the_last_line(tmp_path: Path) -> None:
    write_known_flight(tmp_path / "f")
    (tmp_path / "f" / "telemetry.tlog").write_bytes(b"")
    done = compute(tmp_path / "f", tmp_path / "out")

    assert done.returncode == 1
    assert "telemetry.tlog" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
