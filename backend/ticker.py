"""What the station says at its own pace: states, telemetry, health, alarms."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import TYPE_CHECKING

import structlog

from backend import alarms
from backend.clock import mono_us, unix_us
from backend.fleet.vehicle import LiveVehicle
from backend.video.frames import VideoStatus

if TYPE_CHECKING:
    from backend.station import Station

TICK_S = 0.1
GPS_SILENT_US = 3_000_000

_log = structlog.get_logger(__name__)


class Ticker:
    """A task that ticks ten times a second."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._task: asyncio.Task[None] | None = None
        self._ticks = 0
        self._waiting: list[str] | None = None
        self._said_us: dict[str, int] = {}

    def start(self) -> None:
        """Begin."""
        self._task = asyncio.create_task(self._run())

    async def stop(self) -> None:
        """End."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None

    async def _run(self) -> None:
        due_us = mono_us()
        while True:
            try:
                self.tick()
            except Exception:  # one failed message must not silence all later ones
                _log.exception("ticker failed")
            due_us = max(due_us + int(TICK_S * 1e6), mono_us())
            await asyncio.sleep((due_us - mono_us()) / 1e6)

    def tick(self) -> None:
        """One tick: states; every fifth telemetry; every tenth health and alarms."""
        self._ticks += 1
        station = self._station
        for vehicle in station.fleet.vehicles.values():
            self._say_state(vehicle)
            if self._ticks % 5 == 0:
                station.hub.publish("telemetry", **vehicle.telemetry_message(unix_us()))
        station.guided.tick()
        station.aidings.tick()
        station.landings.tick()
        station.homings.tick()
        if self._ticks % 10 == 0:
            self._say_health()
            self._watch()

    def _say_state(self, vehicle: LiveVehicle) -> None:
        latest = vehicle.latest
        if latest is None or latest.state.t_us == self._said_us.get(vehicle.id):
            return
        self._said_us[vehicle.id] = latest.state.t_us
        fields = vehicle.state_message()
        if fields is not None:
            self._station.metrics.stage.labels("state_age").observe(max(unix_us() - latest.state.t_us, 0) / 1e6)
            self._station.hub.publish("state", **fields)

    def _say_health(self) -> None:
        station, metrics = self._station, self._station.metrics
        if station.camera is not None:
            station.hub.publish("video", **station.camera.video_message())
        status = station.recorder.status
        if status.active:
            station.hub.publish("recording", **asdict(status))
        metrics.recording_bytes.set(status.bytes)
        metrics.recording_dropped.set(station.recorder.dropped)
        metrics.disk_free.set(station.disk_free_bytes())
        for vehicle in station.fleet.vehicles.values():
            if vehicle.worker is not None:
                counts = vehicle.worker.counts
                metrics.samples_dropped.labels(vehicle.id).set(counts.samples_dropped)
                metrics.frames_dropped.labels(vehicle.id).set(counts.frames_dropped)
                metrics.navigator_failures.labels(vehicle.id).set(counts.failures)
                while counts.advance_ms:
                    metrics.stage.labels("navigator_advance").observe(counts.advance_ms.popleft() / 1e3)
        waiting = station.waiting_for()
        if waiting != self._waiting:
            self._waiting = waiting
            _log.info("waiting for", waiting_for=waiting)
            station.hub.publish("waiting", waiting_for=waiting)

    def _watch(self) -> None:
        station, now_us = self._station, unix_us()
        for vehicle in station.fleet.vehicles.values():
            self._watch_vehicle(vehicle, now_us)
        if station.camera is not None:
            self._watch_video(now_us)
        free = station.disk_free_bytes()
        text = f"only {free / 1e9:.1f} GB left in the data folder: delete flights, or record elsewhere"
        station.tell_alarm(
            station.alarms.watch(alarms.DISK_LOW, None, free < station.settings.disk_low_bytes, text, now_us)
        )
        trouble = station.recorder.failure
        if trouble is None and station.recorder.dropped:
            trouble = f"{station.recorder.dropped} records lost: the disk is too slow"
        text = f"the recording has holes: {trouble}"
        station.tell_alarm(station.alarms.watch(alarms.RECORDING_FAILED, None, trouble is not None, text, now_us))

    def _watch_vehicle(self, vehicle: LiveVehicle, now_us: int) -> None:
        station, name = self._station, vehicle.id
        latest = None if vehicle.latest is None else vehicle.latest.state
        mode, doubts = (None, ()) if latest is None else (latest.mode, latest.doubts)
        gps = vehicle.gps
        # Before the first report nothing has been lost.
        gps_lost = gps is not None and (not gps.has_fix or now_us - gps.t_us > GPS_SILENT_US)
        failure = None if vehicle.worker is None else vehicle.worker.failure
        checks = (
            (alarms.LINK_LOST, not vehicle.connected, f"vehicle {name}: no heartbeat; the position shown is old"),
            (alarms.GPS_LOST, gps_lost and vehicle.connected, f"vehicle {name}: the GPS receiver has no fix"),
            *alarms.estimator_checks(name, mode, doubts),
            (
                alarms.NAVIGATOR_FAILED, failure is not None,
                f"vehicle {name}: the estimator failed and starts anew ({failure})",
            ),
        )  # fmt: skip
        for kind, condition, text in checks:
            station.tell_alarm(station.alarms.watch(kind, name, condition, text, now_us))

    def _watch_video(self, now_us: int) -> None:
        station, camera = self._station, self._station.camera
        if camera is None:
            return
        health = camera.health()
        name, text = camera.vehicle_id, f"{camera.source}: {health.text}"
        checks = (
            (alarms.VIDEO_STOPPED, health.status is VideoStatus.STOPPED, text),
            (alarms.VIDEO_FROZEN, health.status is VideoStatus.FROZEN, text),
            (alarms.VIDEO_SIZE, camera.size_problem is not None, f"{camera.source}: {camera.size_problem}"),
        )
        for kind, condition, words in checks:
            station.tell_alarm(station.alarms.watch(kind, name, condition, words, now_us))
