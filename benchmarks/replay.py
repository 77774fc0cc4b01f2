"""Speed of ``pilotage replay``, the full chain."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from benchmarks.budget import Measurement, unmeasured
from benchmarks.flying import command

TIMES_REAL_TIME = 2.0
NAME = "replay, 640x480 at 25 frames/s"


def measure_replay(folder: Path, short: bool, flight: Path | None = None) -> list[Measurement]:
    """Replay a flight, by default one that the simulator records first, as the command that a user types."""
    if flight is None:
        flight = folder / "flight"
        duration_s = "20" if short else "120"
        record = ["sim", "demo", "--offline", "--record", str(flight), "--duration", duration_s, "--seed", "5"]
        said = _failure(record)
        if said:
            return unmeasured([NAME], f"the simulator recorded no flight: {said}")
    said = _failure(["replay", str(flight), "--out", str(folder / "results")])
    if said:
        return unmeasured([NAME], f"the replay failed: {said}")
    report = json.loads((folder / "results" / "report.json").read_text())
    timing = report["timing"]
    stages = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in timing["stages_s"].items())
    note = f"{timing['flight_s']:.0f} s in {timing['elapsed_s']:.1f} s: {stages}"
    return [Measurement(NAME, timing["times_real_time"], "x", TIMES_REAL_TIME, at_least=True, note=note)]


def _failure(arguments: list[str]) -> str | None:
    done = subprocess.run(command(arguments), stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    return None if done.returncode == 0 else done.stderr.strip()[-200:] or f"status {done.returncode}"
