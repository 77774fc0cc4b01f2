"""One live vehicle: what its link said, its estimator, its tracks."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

from backend.event_loop import call_from_thread
from backend.fleet.feed import FrameIdentity
from backend.fleet.messages import state_fields
from backend.fleet.telemetry import Telemetry, telemetry_fields
from backend.fleet.tracks import TrackPoint, TrackRing
from backend.link.events import (
    Autopilot,
    CommandStatus,
    PositionAnswer,
    TelemetryGps,
    TelemetryLocalPosition,
    TelemetryOrigin,
    TelemetryPosition,
    VehicleType,
)
from backend.navigation.setup import NavigationSetup, Place
from backend.navigation.worker import NavigationWorker, StateUpdate
from estimator.landing.pad import Pad
from estimator.types import FixReport, FrameSample, GnssSample, HomeSample, NavigationState, Sample

TrackSource = Literal["gps", "vision", "fused"]
GPS_USED_FOR_US = 2_000_000


@dataclass(frozen=True, slots=True)
class GpsReading:
    """The receiver's last report; the position is None without a fix."""

    t_us: int
    fix_type: int
    satellites: int | None
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_amsl_m: float | None = None
    std_horizontal_m: float | None = None

    @property
    def has_fix(self) -> bool:
        """Whether the receiver claims a position in three dimensions."""
        return self.fix_type >= 3 and self.lat_deg is not None


class VehicleView(Protocol):
    """What the API shows of a vehicle, live or replayed."""

    id: str
    tracks: dict[str, TrackRing]

    @property
    def video_source(self) -> str | None:
        """The id of its camera."""

    @property
    def setup(self) -> NavigationSetup | None:
        """Camera, frame and ground, None before they are known."""

    def summary(self) -> dict[str, Any]:
        """What lists of vehicles show."""

    def state_message(self) -> dict[str, Any] | None:
        """Fields of the ``state`` message."""

    async def state_at(self, t_us: int) -> NavigationState | None:
        """The state at a time, None when it is not known."""

    def exposure_us(self, frame: FrameIdentity) -> int:
        """When a frame was exposed, on the clock of the states."""

    def assumption_at(self, t_us: int) -> str | None:
        """What the state at a time assumes beyond what was estimated, in words for a target's method."""


class LiveVehicle:
    """A vehicle heard on a link. Lives on the event loop; its estimator has a thread of its own.

    ``on_state`` and ``on_reports`` are called on the event loop.
    """

    def __init__(
        self, system_id: int, endpoint: str, delay_us: int,
        on_state: Callable[[LiveVehicle, StateUpdate], None],
        on_reports: Callable[[LiveVehicle, list[FixReport]], None],
    ) -> None:  # fmt: skip
        self.id = str(system_id)
        self.system_id = system_id
        self.endpoint = endpoint
        self.autopilot = Autopilot.OTHER
        self.vehicle_type = VehicleType.OTHER
        self.connected = True
        self.last_heartbeat_us = 0
        self.telemetry = Telemetry()
        self.gps: GpsReading | None = None
        self.home: HomeSample | None = None
        self.relative_alt_m: float | None = None
        self.local_position: TelemetryLocalPosition | None = None
        self.own_position: TelemetryPosition | None = None
        self.origin: TelemetryOrigin | None = None
        self.position_answers: Counter[CommandStatus] = Counter()
        self.last_position_answer: PositionAnswer | None = None
        self.aided = False
        """Whether its autopilot is told where it is, or was a moment ago: then its home may be made of that."""
        self.gps_is_echo = False
        """Whether what it reports as its GPS is what the station sends it."""
        self.tracks = {"gps": TrackRing(), "vision": TrackRing()}
        self.latest: StateUpdate | None = None
        self.worker: NavigationWorker | None = None
        self.last_fix_us: int | None = None
        self._setup: NavigationSetup | None = None
        self._delay_us = delay_us
        self._on_state = on_state
        self._on_reports = on_reports
        self._gps_denied = False
        self._epoch = 0
        self._heard_first_us: int | None = None

    @property
    def video_source(self) -> str | None:
        """The id of the vehicle's camera."""
        return f"cam-{self.id}"

    @property
    def setup(self) -> NavigationSetup | None:
        """What the estimator is built from, None before that is known."""
        return self._setup

    @property
    def gps_denied(self) -> bool:
        """Whether GPS is kept from the estimator."""
        return self._gps_denied

    def deny_gps(self, denied: bool) -> None:
        """Keep GPS from the estimator, or give it back."""
        self._gps_denied = denied
        if self.worker is not None:
            self.worker.deny_gps(denied)

    def heard_first_us(self, t_us: int) -> int:
        """When it was first asked for its place: ``t_us`` then."""
        if self._heard_first_us is None:
            self._heard_first_us = t_us
        return self._heard_first_us

    def here(self) -> Place | None:
        """Where the vehicle roughly is, at the height of the ground as far as that is known; None before a fix."""
        if self.home is not None:
            return Place(self.home.lat_rad, self.home.lon_rad, self.home.alt_amsl_m)
        return None

    def navigate(self, setup: NavigationSetup) -> None:
        """Start the estimator, or start it anew with another setup."""
        self.stop_navigation(wait_s=0.0)
        self._setup = setup
        loop = asyncio.get_running_loop()
        worker = NavigationWorker(
            self.id, setup.navigator, delay_us=self._delay_us,
            on_state=lambda update: call_from_thread(loop, self._take_state, update),
            on_reports=lambda reports: call_from_thread(loop, self._take_reports, reports),
            gps_denied=self._gps_denied, first_epoch=self._epoch + 1,
        )  # fmt: skip
        self.worker = worker
        worker.start()
        if self.home is not None:
            worker.offer(self.home)

    def look_for(self, pad: Pad | None) -> None:
        """Look for another landing pad, or for none: the estimator begins anew, as its pad is part of its state."""
        if self._setup is not None:
            self.navigate(replace(self._setup, pad=pad))

    def stop_navigation(self, wait_s: float = 1.0) -> None:
        """End the estimator's thread; it may finish the work it is in after ``wait_s``."""
        if self.worker is not None:
            self._epoch = self.worker.epoch
            self.worker.close(wait_s)
            self.worker = None

    def offer(self, sample: Sample) -> None:
        """Take a sample of the link or the video."""
        if self.gps_is_echo and isinstance(sample, GnssSample):
            return
        if isinstance(sample, HomeSample):
            if self.aided and self.home is not None:
                return
            self.home = sample
        if isinstance(sample, FrameSample) and (self._setup is None or not self._setup.has_camera):
            return
        if self.worker is not None:
            self.worker.offer(sample)

    def take_gps(self, reading: GpsReading) -> None:
        """Take the receiver's report, for display and the GPS track; an echo is no report of a receiver."""
        self.gps = reading = GpsReading(reading.t_us, 0, None) if self.gps_is_echo else reading
        if reading.has_fix and reading.lat_deg is not None and reading.lon_deg is not None:
            point = TrackPoint(reading.t_us, 1, reading.lat_deg, reading.lon_deg, reading.alt_amsl_m or 0.0)
            self.tracks["gps"].add(point)

    def exposure_us(self, frame: FrameIdentity) -> int:
        """When a frame was exposed, with the offset of the video's clock as far as the estimator has found it."""
        if self.worker is None or frame.stamped:
            return frame.t_us
        return self.worker.exposure_us(frame.t_us)

    def assumption_at(self, t_us: int) -> str | None:
        """Nothing: the estimator says how sure it is of everything."""
        del t_us
        return None

    async def state_at(self, t_us: int) -> NavigationState | None:
        """The state at a time, None when it is not known."""
        if self.worker is None:
            return None
        try:
            return await asyncio.wrap_future(self.worker.state_at(t_us))
        except asyncio.CancelledError:
            # The worker was stopped under the question; a cancelled task of our own still ends here.
            task = asyncio.current_task()
            if task is not None and task.cancelling():
                raise
            return None

    def state_message(self) -> dict[str, Any] | None:
        """Fields of the ``state`` message, None before the estimator has a state."""
        if self.latest is None:
            return None
        update = self.latest
        return {"vehicle_id": self.id, **state_fields(update.state, update.epoch, self._gps_denied, self._setup)}

    def gps_message(self) -> dict[str, Any] | None:
        """Fields of the ``gps`` message, None before the receiver said anything."""
        if self.gps is None:
            return None
        gps = self.gps
        used = gps.has_fix and not self._gps_denied and self.worker is not None
        return {
            "vehicle_id": self.id, "lat_deg": gps.lat_deg, "lon_deg": gps.lon_deg, "alt_amsl_m": gps.alt_amsl_m,
            "fix_type": gps.fix_type, "satellites": gps.satellites, "std_horizontal_m": gps.std_horizontal_m,
            "used": used, "t_gps_unix_us": gps.t_us,
        }  # fmt: skip

    def telemetry_message(self, now_us: int) -> dict[str, Any]:
        """Fields of the ``telemetry`` message at a time of the station's clock."""
        return {"vehicle_id": self.id, **telemetry_fields(self.telemetry, now_us), "home": self._home_fields()}

    def _home_fields(self) -> dict[str, float] | None:
        """Where the vehicle says that it began, None before it has said so."""
        home = self.home
        if home is None:
            return None
        lat_deg, lon_deg = math.degrees(home.lat_rad), math.degrees(home.lon_rad)
        return {"lat_deg": lat_deg, "lon_deg": lon_deg, "alt_amsl_m": home.alt_amsl_m}

    def summary(self) -> dict[str, Any]:
        """What lists of vehicles show."""
        mode = None if self.latest is None else str(self.latest.state.mode)
        return {
            "id": self.id, "vehicle_type": self.telemetry.vehicle_type, "simulated": self.telemetry.simulated,
            "connected": self.connected, "replay": False, "endpoint": self.endpoint,
            "video_source": self.video_source, "gps_denied": self._gps_denied, "mode": mode,
            "map_id": None if self._setup is None else self._setup.map_id,
        }  # fmt: skip

    def waiting_for(self) -> list[str]:
        """What this vehicle's estimator still needs."""
        if self.worker is None:
            return [f"vehicle {self.id}: its home position or a GPS fix, to place the local frame"]
        if self.worker.failure is not None:
            return [f"vehicle {self.id}: the estimator to recover from: {self.worker.failure}"]
        if self.worker.waiting_for is not None:
            return [f"vehicle {self.id}: {self.worker.waiting_for}"]
        return []

    def _take_state(self, update: StateUpdate) -> None:
        if update.epoch <= self._epoch:
            return  # the last words of an estimator that has been replaced
        self.latest = update
        state = update.state
        point = TrackPoint(
            state.t_us, update.epoch, math.degrees(state.lat_rad), math.degrees(state.lon_rad), state.alt_amsl_m
        )
        self.tracks["vision"].add(point)
        self._on_state(self, update)

    def _take_reports(self, reports: list[FixReport]) -> None:
        for report in reports:
            if report.accepted:
                self.last_fix_us = report.t_us
        self._on_reports(self, reports)


def gps_reading(event: TelemetryGps) -> GpsReading:
    """The receiver's report in degrees."""
    lat_deg = None if event.lat_rad is None else math.degrees(event.lat_rad)
    lon_deg = None if event.lon_rad is None else math.degrees(event.lon_rad)
    return GpsReading(
        event.t_us, event.fix_type, event.satellites, lat_deg, lon_deg, event.alt_amsl_m, event.std_horizontal_m
    )


def place_of_gnss(sample: GnssSample, relative_alt_m: float | None) -> Place:
    """Where a fix lies, with the ground's height guessed from the height above home."""
    return Place(sample.lat_rad, sample.lon_rad, sample.alt_amsl_m - (relative_alt_m or 0.0))
