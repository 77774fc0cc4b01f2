"""Resident memory of a station that flies."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.budget import Measurement
from benchmarks.flying import FlyingStation

RESIDENT_MB = 600.0
# A line through the second half of a soak that rises by less than this in an hour is flat.
GROWTH_MB_PER_H = 20.0
SAMPLE_S = 1.0
LONG_ENOUGH_MIN = 30.0


def measure_memory(station: FlyingStation, minutes: float) -> list[Measurement]:
    """The largest resident memory within some minutes, and its growth where they are many enough to tell."""
    times_s, sizes_mb = [], []
    started_s = time.monotonic()
    while (elapsed_s := time.monotonic() - started_s) < 60.0 * minutes:
        times_s.append(elapsed_s)
        sizes_mb.append(station.resident_mb())
        time.sleep(SAMPLE_S)
    half = len(times_s) // 2
    growth = float(np.polyfit(np.array(times_s[half:]) / 3600.0, sizes_mb[half:], 1)[0]) if half > 2 else float("nan")
    judged = minutes >= LONG_ENOUGH_MIN
    return [
        Measurement(
            "resident memory, 1 aircraft, 1 km2 at 0.25 m", max(sizes_mb), "MB", RESIDENT_MB,
            note=f"over {minutes:g} min, {sizes_mb[0]:.0f} to {sizes_mb[-1]:.0f} MB",
        ),
        Measurement(
            "growth of resident memory", growth, "MB/h", GROWTH_MB_PER_H if judged else None,
            note="" if judged else f"too short to judge: give --soak-minutes {LONG_ENOUGH_MIN:g} or more",
        ),
    ]  # fmt: skip
