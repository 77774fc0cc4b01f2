"""What a vehicle says about itself, folded from its link's events, live or recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from backend.link.events import (
    LinkEvent,
    TelemetryBattery,
    TelemetryHeartbeat,
    TelemetryPosition,
    TelemetrySpeed,
    TelemetryWind,
)


@dataclass(frozen=True, slots=True)
class Telemetry:
    """None where the vehicle has not said it; ``*_t_us`` is when it last said what is named before."""

    vehicle_type: str | None = None
    simulated: bool = False
    armed: bool = False
    flight_mode: str | None = None
    battery_pct: float | None = None
    battery_v: float | None = None
    battery_a: float | None = None
    battery_t_us: int | None = None
    airspeed_m_s: float | None = None
    airspeed_t_us: int | None = None
    alt_rel_m: float | None = None
    alt_rel_t_us: int | None = None
    wind_speed_m_s: float | None = None
    wind_from_deg: float | None = None
    wind_t_us: int | None = None
    mission_item: int | None = None


def told(said: Telemetry, event: LinkEvent, t_us: int) -> Telemetry:
    """The telemetry after an event that came at ``t_us``; unchanged by events of other kinds."""
    match event:
        case TelemetryHeartbeat():
            return replace(
                said, vehicle_type=str(event.vehicle_type), simulated=event.simulated, armed=event.armed,
                flight_mode=event.mode,
            )  # fmt: skip
        case TelemetryBattery():
            return replace(
                said, battery_pct=event.remaining_pct, battery_v=event.voltage_v, battery_a=event.current_a,
                battery_t_us=t_us,
            )  # fmt: skip
        case TelemetrySpeed():
            return replace(said, airspeed_m_s=event.airspeed_m_s, airspeed_t_us=t_us)
        case TelemetryPosition():
            return replace(said, alt_rel_m=event.alt_rel_m, alt_rel_t_us=t_us)
        case TelemetryWind():
            from_deg = math.degrees(event.from_rad)
            return replace(said, wind_speed_m_s=event.speed_m_s, wind_from_deg=from_deg, wind_t_us=t_us)
        case _:
            return said


def telemetry_fields(said: Telemetry, now_us: int) -> dict[str, Any]:
    """Fields of a ``telemetry`` message but the vehicle's; ages instead of times, since the page has another clock."""
    return {
        "vehicle_type": said.vehicle_type, "simulated": said.simulated,
        "armed": said.armed, "flight_mode": said.flight_mode,
        "battery_pct": said.battery_pct, "battery_v": said.battery_v, "battery_a": said.battery_a,
        "battery_age_s": _age_s(said.battery_t_us, now_us),
        "airspeed_m_s": said.airspeed_m_s, "airspeed_age_s": _age_s(said.airspeed_t_us, now_us),
        "alt_rel_m": said.alt_rel_m, "alt_rel_age_s": _age_s(said.alt_rel_t_us, now_us),
        "wind_speed_m_s": said.wind_speed_m_s, "wind_from_deg": said.wind_from_deg,
        "wind_age_s": _age_s(said.wind_t_us, now_us), "mission_item": said.mission_item,
    }  # fmt: skip


def _age_s(t_us: int | None, now_us: int) -> float | None:
    return None if t_us is None else max(now_us - t_us, 0) * 1e-6
