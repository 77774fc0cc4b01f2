"""The studies by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from benchmarks.studies.study import Column, FlownRow, Study
from estimator.measurements.map_fix import MapFixConfig
from estimator.navigator import NavigatorConfig
from estimator.registration.alignment import MatcherConfig
from simulator.scenario import CameraSection, FlightSection, Scenario

# the odometry takes a picture every 0.25 s and the thesis sampled its video at 4 Hz: more would only take time
PICTURES = CameraSection(frames_per_s=8.0)
NAVIGATION = (
    Column("rms, m", "rms_m"),
    Column("95 %, m", "p95_m"),
    Column("available", "availability", 1, percent=True),
    Column("> 5 sigma", "wrong", 2, percent=True),
    Column("NEES / dof", "nees_per_dof"),
    Column("inside 50 %", "inside_50", 0, percent=True),
    Column("90 %", "inside_90", 0, percent=True),
    Column("95 %", "inside_95", 0, percent=True),
    Column("fixes accepted", "accepted", 0, percent=True),
    Column("ms a fix", "fix_ms", 1),
)
MEANING = (
    "Errors are horizontal, unaligned, while GPS is denied. Available: mode `vision` and within 10 m. "
    "More than 5 sigma: share of states whose normalised error exceeds five. Inside: share of states within the stated "
    "50, 90 and 95 % ellipses."
)


def flight(short: bool, name: str = "study", flying: FlightSection | None = None) -> Scenario:
    """The demo's helicopter on a shorter flight: 25 s with GPS, then 120 s (60 s in short) without."""
    denied_s = 60.0 if short else 120.0
    return Scenario(
        name=name, duration_s=27.0 + denied_s, gps_denied_s=((25.0, 25.0 + denied_s),), camera=PICTURES,
        flight=flying or FlightSection(),
    )  # fmt: skip


def ladder(short: bool) -> Study:
    """The published baseline and upwards, one change a rung."""
    scenario = flight(short)
    intensity = NavigatorConfig(matcher=MatcherConfig(channels="intensity"), map_fix=MapFixConfig(min_agreement=1.1))
    gradients = replace(intensity, matcher=MatcherConfig())
    rungs = (
        ("intensity", "intensity correlation", intensity),
        ("gradients", "double-angle gradients", gradients),
        ("windows", "windows that agree give the whole pose", NavigatorConfig()),
    )
    rows = tuple(FlownRow(name, change, scenario, config) for name, change, config in rungs)
    return Study("ladder", "What each step gains", MEANING, rows, NAVIGATION, "rms_m", "horizontal rms, m")


STUDIES: dict[str, Callable[[bool], Study]] = {"ladder": ladder}
"""Studies by name: called with whether they are to be short."""
