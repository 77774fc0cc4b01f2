"""What the stream said of each vehicle in the last hour, for a page that comes late: rings of numbers, flat in memory.

It listens to what is published, so that a page which was there and one which asks later know the same.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator.types import Float

MODES = ("gps", "vision", "dead_reckoning", "lost")
STATE_NUMBERS = (
    "lat_deg", "lon_deg", "alt_amsl_m", "alt_agl_m", "std_n_m", "std_e_m", "std_d_m", "cov_ne_m2", "vn_m_s", "ve_m_s",
    "vd_m_s", "roll_deg", "pitch_deg", "heading_deg", "last_fix_age_s",
)  # fmt: skip
STATE_COLUMNS = (*STATE_NUMBERS, "epoch", "mode", "gps_denied", "age_ms", "video_offset_ms")
GPS_COLUMNS = ("lat_deg", "lon_deg", "alt_amsl_m", "std_horizontal_m", "used")
FIX_COLUMNS = ("lat_deg", "lon_deg", "var_n_m2", "var_e_m2", "cov_ne_m2", "score", "elapsed_ms", "accepted")
VIDEO_COLUMNS = ("latency_ms",)
DIGITS = {"lat_deg": 8, "lon_deg": 8}
OTHER_DIGITS = 4

STEP_US = 190_000  # five a second, with room for jitter
STATES_KEPT = 18_000  # an hour at five a second
FIXES_KEPT = 18_000
VIDEO_KEPT = 3_600
EVENTS_KEPT = 2_000
CLOCK_SET_US = 5_000_000


class ColumnRing:
    """The newest rows of numbers, ascending in time, at least ``step_us`` apart; NaN where nothing is known."""

    def __init__(self, columns: tuple[str, ...], capacity: int, step_us: int = 0) -> None:
        self.columns = columns
        self._step_us = step_us
        self._t_us = np.zeros(capacity, dtype=np.int64)
        self._values = np.full((capacity, len(columns)), np.nan)
        self._next = 0
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def add(self, t_us: int, values: Mapping[str, float | None]) -> bool:
        """Keep a row, unless it comes too soon after, or before, the last one."""
        if self._length and t_us - int(self._t_us[self._next - 1]) < max(self._step_us, 1):
            return False
        self._t_us[self._next] = t_us
        row = [values.get(name) for name in self.columns]
        self._values[self._next] = [np.nan if value is None else value for value in row]
        self._next = (self._next + 1) % len(self._t_us)
        self._length = min(self._length + 1, len(self._t_us))
        return True

    @property
    def last_us(self) -> int | None:
        """The time of the newest row."""
        return int(self._t_us[self._next - 1]) if self._length else None

    def clear(self) -> None:
        """Forget everything."""
        self._next = self._length = 0

    def since(self, since_us: int, step_us: int = 0) -> tuple[np.ndarray, Float]:
        """Times (n,) and values (n, columns) after a time, of each ``step_us`` the first row."""
        capacity = len(self._t_us)
        order = np.arange(self._next - self._length, self._next) % capacity
        order = order[self._t_us[order] > since_us]
        if step_us > 0 and len(order):
            _, first = np.unique(self._t_us[order] // step_us, return_index=True)
            order = order[first]
        return self._t_us[order], self._values[order]


@dataclass(slots=True, eq=False)
class VehicleHistory:
    """The rings of one vehicle, and words that belong to rows of its fixes by their time."""

    states: ColumnRing = field(default_factory=lambda: ColumnRing(STATE_COLUMNS, STATES_KEPT, STEP_US))
    gps: ColumnRing = field(default_factory=lambda: ColumnRing(GPS_COLUMNS, STATES_KEPT, STEP_US))
    fixes: ColumnRing = field(default_factory=lambda: ColumnRing(FIX_COLUMNS, FIXES_KEPT))
    fix_words: deque[tuple[int, str, str]] = field(default_factory=lambda: deque(maxlen=FIXES_KEPT))
    video: ColumnRing = field(default_factory=lambda: ColumnRing(VIDEO_COLUMNS, VIDEO_KEPT, 900_000))
    descent_phase: str | None = None

    def state(self, fields: Mapping[str, Any], now_us: int) -> None:
        """A ``state`` message. Where time goes backwards the clock was set: what was before is of another one."""
        t_us = int(fields["t_state_unix_us"])
        last_us = self.states.last_us
        if last_us is not None and t_us < last_us - CLOCK_SET_US:
            for ring in (self.states, self.gps, self.fixes, self.video):
                ring.clear()
            self.fix_words.clear()
        clock = fields.get("video_clock") or {}
        offset_s = clock.get("time_offset_s")
        values = {name: fields.get(name) for name in STATE_NUMBERS}
        values |= {
            "epoch": fields["epoch"], "mode": MODES.index(fields["mode"]), "gps_denied": bool(fields["gps_denied"]),
            "age_ms": (now_us - t_us) / 1e3, "video_offset_ms": None if offset_s is None else 1e3 * offset_s,
        }  # fmt: skip
        self.states.add(t_us, values)

    def reading(self, fields: Mapping[str, Any], now_us: int) -> None:
        """A ``gps`` message; without a fix there is nothing to keep."""
        if fields["fix_type"] >= 2 and fields["lat_deg"] is not None and fields["lon_deg"] is not None:
            self.gps.add(int(fields.get("t_gps_unix_us") or now_us), {name: fields.get(name) for name in GPS_COLUMNS})

    def fix(self, fields: Mapping[str, Any]) -> None:
        """A ``fix`` message."""
        cov = fields["cov_ne_m2"] or ((None, None), (None, None))
        values = {name: fields.get(name) for name in FIX_COLUMNS}
        values |= {"var_n_m2": cov[0][0], "var_e_m2": cov[1][1], "cov_ne_m2": cov[0][1]}
        t_us = int(fields["t_fix_unix_us"])
        if self.fixes.add(t_us, values):
            self.fix_words.append((t_us, str(fields["kind"]), str(fields["reason"] or "")))


class Histories:
    """Folds published messages into the histories of live vehicles; those of replays are in their flights."""

    def __init__(self, now_us: Callable[[], int]) -> None:
        self._now_us = now_us
        self._vehicles: dict[str, VehicleHistory] = {}
        self._events: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)

    def take(self, kind: str, fields: Mapping[str, Any]) -> None:
        """One published message."""
        vehicle_id = fields.get("vehicle_id")
        if kind == "alarm":
            self._alarm(fields)
        if not isinstance(vehicle_id, str) or vehicle_id.startswith("replay-"):
            return
        match kind:
            case "state":
                self._of(vehicle_id).state(fields, self._now_us())
            case "gps":
                self._of(vehicle_id).reading(fields, self._now_us())
            case "fix":
                self._of(vehicle_id).fix(fields)
            case "video":
                self._of(vehicle_id).video.add(self._now_us(), {"latency_ms": fields.get("latency_ms")})
            case "landing":
                self._landing(vehicle_id, fields)
            case _:
                pass

    def body(self, vehicle_id: str, since_us: int, step_us: int) -> dict[str, Any]:
        """Fields of `HistoryBody`; empty columns for a vehicle that has said nothing yet."""
        history = self._vehicles.get(vehicle_id) or VehicleHistory()
        events = [
            event for event in self._events
            if event["t_unix_us"] > since_us and event["vehicle_id"] in (vehicle_id, None)
        ]  # fmt: skip
        return history_body(vehicle_id, history, events, since_us, step_us)

    def _of(self, vehicle_id: str) -> VehicleHistory:
        return self._vehicles.setdefault(vehicle_id, VehicleHistory())

    def _alarm(self, fields: Mapping[str, Any]) -> None:
        now_us = self._now_us()
        said = fields.get("code") == "vehicle_text"
        kind = "said" if said else "alarm_raised" if fields.get("active") else "alarm_cleared"
        t_us = now_us if kind == "alarm_cleared" else int(fields.get("since_unix_us") or now_us)
        words = [str(fields.get(name) or "") for name in ("severity", "text", "id")]
        self._note(t_us, kind, fields.get("vehicle_id"), *words)

    def _landing(self, vehicle_id: str, fields: Mapping[str, Any]) -> None:
        history = self._of(vehicle_id)
        descent = fields.get("descent") or {}
        phase = descent.get("phase")
        if phase != history.descent_phase:
            history.descent_phase = phase
            if phase is not None:
                reason = str(descent.get("reason") or "")
                text = f"landing: {phase}" + (f" ({reason})" if reason else "")
                now_us = self._now_us()
                self._note(now_us, "landing", vehicle_id, "info", text, f"{vehicle_id}:{phase}:{now_us}")

    def _note(self, t_us: int, kind: str, vehicle_id: str | None, severity: str, text: str, identity: str) -> None:
        self._events.append({
            "t_unix_us": t_us, "kind": kind, "vehicle_id": vehicle_id, "severity": severity, "text": text,
            "id": identity,
        })  # fmt: skip


def history_body(
    vehicle_id: str, history: VehicleHistory, events: list[dict[str, Any]], since_us: int, step_us: int
) -> dict[str, Any]:
    """Fields of `HistoryBody`: states and GPS thinned to one in ``step_us``, fixes and events all."""
    states = _columns(history.states, since_us, step_us)
    states["mode"] = [MODES[int(mode)] for mode in states["mode"]]
    states["gps_denied"] = [bool(denied) for denied in states["gps_denied"]]
    states["epoch"] = [int(epoch) for epoch in states["epoch"]]
    gps = _columns(history.gps, since_us, step_us)
    gps["used"] = [bool(used) for used in gps["used"]]
    fixes = _columns(history.fixes, since_us, 0)
    words = [(kind, reason) for t_us, kind, reason in history.fix_words if t_us > since_us]
    fixes["accepted"] = [bool(accepted) for accepted in fixes["accepted"]]
    fixes["kind"], fixes["reason"] = [kind for kind, _ in words], [reason for _, reason in words]
    return {
        "vehicle_id": vehicle_id, "states": states, "gps": gps, "fixes": fixes,
        "video": _columns(history.video, since_us, step_us), "events": events,
    }  # fmt: skip


def _columns(ring: ColumnRing, since_us: int, step_us: int) -> dict[str, list[Any]]:
    t_us, values = ring.since(since_us, step_us)
    columns: dict[str, list[Any]] = {"t_unix_us": t_us.tolist()}
    for name, column in zip(ring.columns, values.T, strict=True):
        # NaN is no JSON.
        rounded = np.round(column, DIGITS.get(name, OTHER_DIGITS)).tolist()
        known = np.isfinite(column).tolist()
        columns[name] = [value if is_known else None for value, is_known in zip(rounded, known, strict=True)]
    return columns
