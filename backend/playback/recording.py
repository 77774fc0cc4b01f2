"""A flight folder read for playback: what the vehicle said, when each frame was, where the estimate is."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from backend.fleet.telemetry import Telemetry, told
from backend.fleet.vehicle import GpsReading, gps_reading
from backend.link.events import SampleEvent, TelemetryGps
from backend.link.link import VehicleLink
from backend.link.tlog import running_forward
from backend.navigation.setup import MapFiles, NavigationSetup, Place, build_setup, profile_of_flight
from backend.video.recorded import RecordedVideo
from estimator.types import CameraAttitudeSample, GnssSample, HomeSample
from geodata.errors import GeodataError
from geodata.flight import FlightFolder

TELEMETRY_STEP_US = 200_000


@dataclass(frozen=True, slots=True)
class TelemetryAt:
    """What was known of the vehicle's telemetry from a time on."""

    t_us: int
    telemetry: Telemetry


@dataclass(frozen=True, slots=True, eq=False)
class FlightRecording:
    """Everything of a flight but its estimate. Lists ascend in time; frame lists run parallel."""

    folder: FlightFolder
    start_us: int
    end_us: int
    telemetry: list[TelemetryAt]
    gps: list[GpsReading]
    gimbal_reports: list[CameraAttitudeSample]
    video: RecordedVideo | None
    frame_index: list[int]
    frame_t_us: list[int]
    setup: NavigationSetup | None

    def telemetry_at(self, t_us: int) -> Telemetry:
        """What was known of the telemetry at a time."""
        at = bisect.bisect_right(self.telemetry, t_us, key=lambda entry: entry.t_us) - 1
        return Telemetry() if at < 0 else self.telemetry[at].telemetry

    def gps_between(self, after_us: int, until_us: int) -> list[GpsReading]:
        """The receiver's reports in (after, until]."""
        first = bisect.bisect_right(self.gps, after_us, key=lambda reading: reading.t_us)
        last = bisect.bisect_right(self.gps, until_us, key=lambda reading: reading.t_us)
        return self.gps[first:last]

    def frame_time_us(self, index: int) -> int | None:
        """Exposure of a frame, None for one that has no time."""
        at = bisect.bisect_left(self.frame_index, index)
        return self.frame_t_us[at] if at < len(self.frame_index) and self.frame_index[at] == index else None

    def frame_at(self, t_us: int) -> int:
        """Index of the last frame at or before a time, else of the first."""
        at = bisect.bisect_right(self.frame_t_us, t_us) - 1
        return self.frame_index[max(at, 0)] if self.frame_index else 0


def read_recording(path: Path, progress: Callable[[float], None]) -> FlightRecording:
    """Read a flight folder; a minute of a busy link takes about a second. FlightFolderError, VideoError."""
    folder = FlightFolder.open(path)
    reader = _Reader(folder)
    start_us, end_us = folder.telemetry_span()
    span_us: tuple[int, int] | None = None
    entries = running_forward(folder.telemetry(), lambda what: folder.warn(f"{folder.telemetry_path}: {what}"))
    for packets, (t_us, data) in enumerate(entries):
        if packets % 2000 == 0:
            progress(0.9 * min(max((t_us - start_us) / max(end_us - start_us, 1), 0.0), 1.0))
        span_us = (t_us, t_us) if span_us is None else (min(span_us[0], t_us), max(span_us[1], t_us))
        reader.take(t_us, data)
    reader.sort()
    start_us, end_us = span_us or (start_us, end_us)
    video = None if folder.video_path is None else RecordedVideo.open(folder.video_path)
    index, times = ([], []) if video is None else _frame_times(folder, video)
    if times:
        start_us, end_us = min(start_us, times[0]), max(end_us, times[-1])
    progress(1.0)
    return FlightRecording(
        folder, start_us, end_us, reader.telemetry, reader.gps, reader.gimbal_reports, video, index, times,
        _setup(folder, reader),
    )  # fmt: skip


class _Reader:
    """Folds the packets of a log into what is shown."""

    def __init__(self, folder: FlightFolder) -> None:
        self.telemetry: list[TelemetryAt] = []
        self.gps: list[GpsReading] = []
        self.gimbal_reports: list[CameraAttitudeSample] = []
        self.home: HomeSample | None = None
        self.first_fix: GnssSample | None = None
        self._link = VehicleLink(passive=True)
        self._system_id = folder.meta.vehicle.system_id
        self._now = Telemetry(vehicle_type=folder.meta.vehicle.type)

    def sort(self) -> None:
        """Put in order what a relay swapped."""
        self.telemetry.sort(key=lambda entry: entry.t_us)
        self.gps.sort(key=lambda reading: reading.t_us)
        self.gimbal_reports.sort(key=lambda report: report.t_us)

    def take(self, t_us: int, data: bytes) -> None:
        for event in self._link.receive(data, t_us):
            if self._system_id is not None and event.system_id != self._system_id:
                continue
            self._say(t_us, told(self._now, event, t_us))
            match event:
                case TelemetryGps():
                    self.gps.append(gps_reading(event))
                case SampleEvent(sample=CameraAttitudeSample() as report):
                    self.gimbal_reports.append(report)
                case SampleEvent(sample=HomeSample() as home):
                    self.home = home
                case SampleEvent(sample=GnssSample() as fix) if self.first_fix is None:
                    self.first_fix = fix
                case _:
                    pass

    def _say(self, t_us: int, telemetry: Telemetry) -> None:
        if telemetry is self._now:
            return
        self._now = telemetry
        if self.telemetry and t_us - self.telemetry[-1].t_us < TELEMETRY_STEP_US:
            self.telemetry[-1] = TelemetryAt(self.telemetry[-1].t_us, telemetry)
        else:
            self.telemetry.append(TelemetryAt(t_us, telemetry))


def _frame_times(folder: FlightFolder, video: RecordedVideo) -> tuple[list[int], list[int]]:
    offset_us = folder.time_offset_us or 0
    table = folder.frame_times()
    if table is not None:
        numbers = table.frame.tolist()
        times = table.t_video_us.tolist()
        keep = [(n, t + offset_us) for n, t in zip(numbers, times, strict=True) if n <= video.last_index]
        return [n for n, _ in keep], [t for _, t in keep]
    index: list[int] = []
    found: list[int] = []
    for packet in video.packets():
        t_us = folder.frame_time_us(packet.index, packet.pts_s)
        if t_us is not None:
            index.append(packet.index)
            found.append(t_us + offset_us)
    order = sorted(range(len(index)), key=lambda i: index[i])
    return [index[i] for i in order], [found[i] for i in order]


def _setup(folder: FlightFolder, reader: _Reader) -> NavigationSetup | None:
    """What turns states into coordinates; a map that cannot be read is missed, and said."""
    home = folder.meta.home
    if home is not None:
        here = Place(math.radians(home.lat_deg), math.radians(home.lon_deg), home.alt_amsl_m)
    elif reader.home is not None:
        here = Place(reader.home.lat_rad, reader.home.lon_rad, reader.home.alt_amsl_m)
    elif reader.first_fix is not None:
        here = Place(reader.first_fix.lat_rad, reader.first_fix.lon_rad, reader.first_fix.alt_amsl_m)
    else:
        return None
    profile, elevation = profile_of_flight(folder.meta), folder.elevation_path
    try:
        return build_setup(profile, MapFiles(None, folder.reference_path, elevation, None), here)
    except GeodataError as error:
        if folder.reference_path is None:
            raise
        setup = build_setup(profile, MapFiles(None, None, elevation, None), here)
        folder.warn(f"clicks are not registered to the map: {error}")
        return setup
