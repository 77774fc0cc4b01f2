"""Alarms with hysteresis: a condition must hold for a while to alarm, and be gone for a while to clear."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Literal

from estimator.types import Doubt, Mode

Severity = Literal["info", "caution", "warning"]


@dataclass(frozen=True, slots=True)
class AlarmKind:
    """What an alarm is called, how grave it is, and how long its condition must hold or be gone."""

    code: str
    severity: Severity
    raise_after_s: float
    clear_after_s: float


GPS_LOST = AlarmKind("gps_lost", "warning", 2.0, 3.0)
VIDEO_STOPPED = AlarmKind("video_stopped", "warning", 1.0, 2.0)
VIDEO_FROZEN = AlarmKind("video_frozen", "warning", 0.5, 2.0)
VIDEO_SIZE = AlarmKind("video_size", "warning", 0.0, 2.0)
LINK_LOST = AlarmKind("link_lost", "warning", 0.0, 1.0)
NAVIGATOR_LOST = AlarmKind("navigator_lost", "warning", 1.0, 2.0)
NAVIGATOR_FAILED = AlarmKind("navigator_failed", "warning", 0.0, 5.0)
DEAD_RECKONING = AlarmKind("dead_reckoning", "caution", 3.0, 2.0)
NO_TEXTURE = AlarmKind("no_texture", "caution", 1.0, 3.0)
MAP_MISMATCH = AlarmKind("map_mismatch", "caution", 1.0, 5.0)
MAP_OFFSET = AlarmKind("map_offset", "caution", 1.0, 5.0)
BAROMETER_DRIFT = AlarmKind("barometer_drift", "caution", 1.0, 2.0)
DISK_LOW = AlarmKind("disk_low", "caution", 0.0, 30.0)
RECORDING_FAILED = AlarmKind("recording_failed", "warning", 0.0, 10.0)


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm of one vehicle (or of the station, ``vehicle_id`` None), raised or cleared."""

    id: str
    vehicle_id: str | None
    severity: Severity
    code: str
    text: str
    active: bool
    since_unix_us: int


def estimator_checks(
    vehicle_id: str, mode: Mode | None, doubts: Collection[Doubt]
) -> tuple[tuple[AlarmKind, bool, str], ...]:
    """What a state of the estimator says for each of its alarms: kind, condition, text for the operator."""
    said = (
        (NAVIGATOR_LOST, mode is Mode.LOST, "the estimator does not know where it is"),
        (DEAD_RECKONING, mode is Mode.DEAD_RECKONING, "no position fix; the error grows until one succeeds"),
        (
            NO_TEXTURE, Doubt.NO_TEXTURE in doubts,
            "the picture shows too little to navigate by: fog, darkness, glare, or bare water",
        ),
        (
            MAP_MISMATCH, Doubt.MAP_MISMATCH in doubts,
            "the pictures do not fit the map here: wrong or outdated imagery, or a wrong camera file",
        ),
        (
            MAP_OFFSET, Doubt.MAP_OFFSET in doubts,
            "the map and GPS disagree by a steady distance: one of them is displaced",
        ),
        (
            BAROMETER_DRIFT, Doubt.BAROMETER_DRIFT in doubts,
            "pressure says another climb than the pictures: a drifting barometer; height is held by the pictures",
        ),
    )  # fmt: skip
    return tuple((kind, condition, f"vehicle {vehicle_id}: {text}") for kind, condition, text in said)


@dataclass(slots=True)
class _Watch:
    kind: AlarmKind
    condition: bool = False
    changed_us: int = 0
    alarm: Alarm | None = None


@dataclass(slots=True)
class AlarmBoard:
    """All conditions that are watched, and the alarms they raised. Pure: time is an argument."""

    _watches: dict[tuple[str | None, str], _Watch] = field(default_factory=dict)

    @property
    def active(self) -> list[Alarm]:
        """Alarms that stand now, the oldest first."""
        alarms = [watch.alarm for watch in self._watches.values() if watch.alarm is not None]
        return sorted(alarms, key=lambda alarm: alarm.since_unix_us)

    def watch(self, kind: AlarmKind, vehicle_id: str | None, condition: bool, text: str, t_us: int) -> Alarm | None:
        """Report whether a condition holds at ``t_us``; returns the alarm when it is raised or cleared by this."""
        watch = self._watches.setdefault((vehicle_id, kind.code), _Watch(kind, changed_us=t_us))
        if condition != watch.condition:
            watch.condition = condition
            watch.changed_us = t_us
        held_s = (t_us - watch.changed_us) / 1e6
        if condition and watch.alarm is None and held_s >= kind.raise_after_s:
            identity = f"{kind.code}:{vehicle_id or 'station'}:{watch.changed_us}"
            watch.alarm = Alarm(identity, vehicle_id, kind.severity, kind.code, text, True, watch.changed_us)
            return watch.alarm
        if not condition and watch.alarm is not None and held_s >= kind.clear_after_s:
            cleared = watch.alarm
            watch.alarm = None
            return Alarm(
                cleared.id, vehicle_id, cleared.severity, cleared.code, cleared.text, False, cleared.since_unix_us
            )
        return None

    def forget(self, vehicle_id: str) -> list[Alarm]:
        """Drop everything about a vehicle; returns its standing alarms as cleared."""
        cleared = []
        for key in [key for key in self._watches if key[0] == vehicle_id]:
            alarm = self._watches.pop(key).alarm
            if alarm is not None:
                cleared.append(
                    Alarm(alarm.id, vehicle_id, alarm.severity, alarm.code, alarm.text, False, alarm.since_unix_us)
                )
        return cleared
