"""MAVLink messages to what the operator is shown; nothing here reaches the estimator."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from backend.link import modes
from backend.link.events import (
    LinkEvent,
    StatusText,
    TelemetryBattery,
    TelemetryGps,
    TelemetryHeartbeat,
    TelemetryMission,
    TelemetryOrigin,
    TelemetryPosition,
    TelemetrySpeed,
    TelemetryWind,
)
from backend.link.samples import gnss_accuracy_m

HEARTBEAT = 0
SYS_STATUS = 1
GPS_RAW_INT = 24
GLOBAL_POSITION_INT = 33
MISSION_CURRENT = 42
GPS_GLOBAL_ORIGIN = 49
VFR_HUD = 74
BATTERY_STATUS = 147
WIND = 168
WIND_COV = 231
STATUSTEXT = 253

_FLAG_ARMED = 128
_FLAG_HIL = 32
_FIX_2D = 2
_UINT16_UNKNOWN = 0xFFFF
_UINT8_UNKNOWN = 0xFF
_STATUS_CHUNK_CHARS = 50
_STATUS_WAIT_US = 2_000_000


def heartbeat(m: Any, t_us: int, system_id: int) -> TelemetryHeartbeat:
    """An autopilot's heartbeat."""
    autopilot = modes.autopilot_from_heartbeat(m.autopilot)
    vehicle_type = modes.vehicle_type_from_heartbeat(m.type)
    return TelemetryHeartbeat(
        t_us=t_us,
        system_id=system_id,
        autopilot=autopilot,
        vehicle_type=vehicle_type,
        armed=bool(m.base_mode & _FLAG_ARMED),
        mode=modes.mode_name(autopilot, vehicle_type, m.base_mode, m.custom_mode),
        simulated=bool(m.base_mode & _FLAG_HIL),
    )


def _battery_from_sys_status(m: Any, t_us: int, system_id: int) -> TelemetryBattery | None:
    return _battery(
        t_us,
        system_id,
        None if m.voltage_battery in (0, _UINT16_UNKNOWN) else m.voltage_battery * 1e-3,
        m.battery_remaining,
        m.current_battery,
    )


def _battery_from_battery_status(m: Any, t_us: int, system_id: int) -> TelemetryBattery | None:
    if m.id != 0:
        return None
    # Without cell voltages the total is in the first, and what exceeds 65.534 V in the next.
    cells_mv = [mv for mv in m.voltages if mv != _UINT16_UNKNOWN]
    return _battery(
        t_us, system_id, sum(cells_mv) * 1e-3 if any(cells_mv) else None, m.battery_remaining, m.current_battery
    )


def _battery(
    t_us: int, system_id: int, voltage_v: float | None, remaining: int, current_ca: int
) -> TelemetryBattery | None:
    if voltage_v is None and remaining < 0:
        return None
    remaining_pct = float(remaining) if 0 <= remaining <= 100 else None
    return TelemetryBattery(t_us, system_id, voltage_v, remaining_pct, current_ca * 1e-2 if current_ca >= 0 else None)


def _gps(m: Any, t_us: int, system_id: int) -> TelemetryGps:
    has_fix = m.fix_type >= _FIX_2D and (m.lat != 0 or m.lon != 0)
    return TelemetryGps(
        t_us=t_us,
        system_id=system_id,
        fix_type=m.fix_type,
        satellites=None if m.satellites_visible == _UINT8_UNKNOWN else m.satellites_visible,
        lat_rad=math.radians(m.lat * 1e-7) if has_fix else None,
        lon_rad=math.radians(m.lon * 1e-7) if has_fix else None,
        alt_amsl_m=m.alt * 1e-3 if has_fix else None,
        std_horizontal_m=gnss_accuracy_m(m)[0] if has_fix else None,
    )


def _position(m: Any, t_us: int, system_id: int) -> TelemetryPosition | None:
    if (m.lat == 0 and m.lon == 0) or abs(m.lat) > 900_000_000 or abs(m.lon) > 1_800_000_000:
        return None
    return TelemetryPosition(
        t_us=t_us,
        system_id=system_id,
        lat_rad=math.radians(m.lat * 1e-7),
        lon_rad=math.radians(m.lon * 1e-7),
        alt_amsl_m=m.alt * 1e-3,
        alt_rel_m=m.relative_alt * 1e-3,
        vn_m_s=m.vx * 1e-2,
        ve_m_s=m.vy * 1e-2,
        vd_m_s=m.vz * 1e-2,
    )


def _origin(m: Any, t_us: int, system_id: int) -> TelemetryOrigin | None:
    if (m.latitude == 0 and m.longitude == 0) or abs(m.latitude) > 900_000_000 or abs(m.longitude) > 1_800_000_000:
        return None
    lat_rad, lon_rad = math.radians(m.latitude * 1e-7), math.radians(m.longitude * 1e-7)
    return TelemetryOrigin(t_us, system_id, lat_rad, lon_rad, m.altitude * 1e-3)


def _speed(m: Any, t_us: int, system_id: int) -> TelemetrySpeed | None:
    if not (math.isfinite(m.airspeed) and math.isfinite(m.groundspeed)):
        return None
    return TelemetrySpeed(t_us, system_id, m.airspeed, m.groundspeed, float(m.throttle))


def _mission(m: Any, t_us: int, system_id: int) -> TelemetryMission:
    return TelemetryMission(t_us, system_id, m.seq)


def _wind(m: Any, t_us: int, system_id: int) -> TelemetryWind | None:
    # ArduPilot's message: degrees the wind comes from, -180 to 180.
    if not (math.isfinite(m.direction) and math.isfinite(m.speed)) or m.speed < 0:
        return None
    return TelemetryWind(t_us, system_id, m.speed, math.radians(m.direction) % math.tau)


def _wind_cov(m: Any, t_us: int, system_id: int) -> TelemetryWind | None:
    # PX4's message: the velocity of the air, north and east, so it comes from the other side.
    if not (math.isfinite(m.wind_x) and math.isfinite(m.wind_y)):
        return None
    from_rad = math.atan2(-m.wind_y, -m.wind_x) % math.tau
    return TelemetryWind(t_us, system_id, math.hypot(m.wind_x, m.wind_y), from_rad)


TELEMETRY: dict[int, Callable[[Any, int, int], LinkEvent | None]] = {
    SYS_STATUS: _battery_from_sys_status,
    GPS_RAW_INT: _gps,
    GLOBAL_POSITION_INT: _position,
    GPS_GLOBAL_ORIGIN: _origin,
    VFR_HUD: _speed,
    MISSION_CURRENT: _mission,
    BATTERY_STATUS: _battery_from_battery_status,
    WIND: _wind,
    WIND_COV: _wind_cov,
}


@dataclass(slots=True)
class _Unfinished:
    first_us: int
    severity: int
    chunks: dict[int, str]
    last_seq: int | None = None


@dataclass(slots=True)
class StatusTexts:
    """Puts one vehicle's STATUSTEXT chunks together; one with a lost chunk comes with a gap after two seconds."""

    system_id: int
    _unfinished: dict[tuple[int, int], _Unfinished] = field(default_factory=dict)

    def add(self, m: Any, component_id: int, t_us: int) -> list[LinkEvent]:
        """Take one message; gives the text when it is whole."""
        if m.id == 0:
            return [StatusText(t_us, self.system_id, component_id, m.severity, m.text)]
        key = (component_id, m.id)
        text = self._unfinished.setdefault(key, _Unfinished(t_us, m.severity, {}))
        text.chunks[m.chunk_seq] = m.text
        if len(m.text) < _STATUS_CHUNK_CHARS:
            text.last_seq = m.chunk_seq
        if text.last_seq is not None and len(text.chunks) == text.last_seq + 1:
            return [self._close(key, t_us)]
        return []

    def expire(self, t_us: int) -> list[LinkEvent]:
        """Give up waiting for lost chunks."""
        late = [key for key, text in self._unfinished.items() if t_us - text.first_us > _STATUS_WAIT_US]
        return [self._close(key, t_us) for key in late]

    def _close(self, key: tuple[int, int], t_us: int) -> LinkEvent:
        text = self._unfinished.pop(key)
        last = max(text.chunks) if text.last_seq is None else text.last_seq
        whole = "".join(text.chunks.get(i, "[…]") for i in range(last + 1))
        return StatusText(t_us, self.system_id, key[0], text.severity, whole)
