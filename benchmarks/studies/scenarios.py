"""The flight that most studies replay, so that it is simulated once."""

from __future__ import annotations

from simulator.scenario import CameraSection, FlightSection, Scenario

# the odometry takes a picture every 0.25 s and the thesis sampled its video at 4 Hz: more would only take time
PICTURES = CameraSection(frames_per_s=8.0)


def denied_s(short: bool) -> float:
    """How long the studies' flight goes without GPS."""
    return 60.0 if short else 120.0


def flight(short: bool, name: str = "study", flying: FlightSection | None = None, gps_s: float = 25.0) -> Scenario:
    """The demo's helicopter on a shorter flight: ``gps_s`` with GPS, then 120 s (60 s in short) without."""
    end_s = gps_s + denied_s(short)
    return Scenario(
        name=name, duration_s=end_s + 2.0, gps_denied_s=((gps_s, end_s),), camera=PICTURES,
        flight=flying or FlightSection(),
    )  # fmt: skip
