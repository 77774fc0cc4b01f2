"""Plays one flight: a clock that can pause, run at any speed and jump, and what the flight has at its time."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import structlog

from backend.clock import mono_us, unix_us
from backend.errors import FrameGoneError, NoStateForFrameError
from backend.fleet.feed import FrameIdentity
from backend.fleet.messages import finite, state_fields
from backend.fleet.telemetry import telemetry_fields
from backend.fleet.tracks import TrackPoint, TrackRing
from backend.fleet.viewers import Audience
from backend.hub import Hub
from backend.navigation.setup import NavigationSetup
from backend.playback.estimate import EstimateTable, RecordedStates
from backend.playback.recording import FlightRecording
from backend.refining.later import Hindsight
from backend.schemas.vehicles import ReplayBody
from backend.video.errors import VideoError
from backend.video.frames import EncodedFrame
from backend.video.recorded import RecordedPacket, RecordedVideo
from estimator.types import NavigationState

TICK_S = 0.02
SAY_EVERY_US = 100_000
SAY_TELEMETRY_EVERY_US = 500_000
BATCH_PACKETS = 24
MAX_STEP_US = 500_000  # a stalled event loop must not make the flight jump

_log = structlog.get_logger(__name__)


class Playback:
    """One replayed flight as a vehicle with a video feed. Lives on the event loop.

    Frames are numbered ``epoch * stride + index``, so that an id is never used twice and still names its picture.
    """

    def __init__(self, flight_id: str, recording: FlightRecording, hub: Hub, speed: float, start_s: float) -> None:
        self.id = f"replay-{flight_id}"
        self.flight_id = flight_id
        self.recording = recording
        self.audience = Audience()
        self.jpeg_audience = Audience()
        self.tracks = {"gps": TrackRing(), "vision": TrackRing()}
        self.epoch = 1
        self.speed = speed
        self.paused = False
        self.closed = False
        self.estimate_progress: float | None = 0.0
        self.estimate_problem: str | None = None
        self._hub = hub
        self._states: RecordedStates | None = None
        self._hindsight: RecordedStates | None = None
        self._no_hindsight = False
        self._hindsight_offset_us = 0
        self._stride = 1 if recording.video is None else recording.video.last_index + 1
        self._t_us = recording.start_us
        self._packets: Iterator[RecordedPacket] | None = None
        self._ready: list[RecordedPacket] = []
        self._jpeg_busy: asyncio.Task[None] | None = None
        self._shown_index = -1
        self._shown_us = recording.start_us
        self._other_sizes: dict[int, tuple[int, int]] = {}  # of shown pictures that are not of the video's first size
        self._found_offset_us = 0
        self._video_done = False
        self._said_us = 0
        self._said_telemetry_us = 0
        self._task: asyncio.Task[None] | None = None
        self._jump(min(recording.start_us + round(start_s * 1e6), recording.end_us))

    @property
    def source(self) -> str:
        """The id of the replayed camera."""
        return f"cam-{self.id}"

    @property
    def vehicle_id(self) -> str:
        """The replay's vehicle id."""
        return self.id

    @property
    def video_source(self) -> str | None:
        """The id of the replayed camera, None when the flight has no video."""
        return None if self.recording.video is None else self.source

    @property
    def setup(self) -> NavigationSetup | None:
        """Camera, frame and ground of the flight."""
        return self.recording.setup

    @property
    def t_us(self) -> int:
        """The time of the flight that is shown."""
        return self._t_us

    @property
    def ended(self) -> bool:
        """Whether the end of the flight is reached."""
        return self._t_us >= self.recording.end_us

    def start(self) -> None:
        """Begin to play."""
        self._task = asyncio.create_task(self._run())

    async def close(self) -> None:
        """Stop playing."""
        self.closed = True
        tasks = [task for task in (self._task, self._jpeg_busy) if task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self.audience.close()
        self.jpeg_audience.close()

    def use_estimate(self, table: EstimateTable, found_offset_us: int = 0) -> None:
        """Show this estimate from now on; ``found_offset_us`` is what was added to frame times when it was made."""
        self._found_offset_us = found_offset_us
        setup = self.recording.setup
        self.estimate_progress = None
        if setup is None:
            self.estimate_problem = "the flight tells no home and has no GPS fix"
            return
        self._states = self._states_of(table, setup)
        self._refill_tracks()

    def tell_estimate_progress(self, done: float) -> None:
        """The part done, 0 to 1, of computing the estimate."""
        self.estimate_progress = done

    def use_hindsight(self, table: EstimateTable | None, found_offset_us: int = 0) -> None:
        """What the flight's later fixes make of its states; None where that cannot be known.

        ``found_offset_us`` is what was added to frame times when it was made.
        """
        setup = self.recording.setup
        self._hindsight_offset_us = found_offset_us
        self._no_hindsight = table is None or setup is None
        self._hindsight = None if table is None or setup is None else self._states_of(table, setup)

    def _states_of(self, table: EstimateTable, setup: NavigationSetup) -> RecordedStates:
        return RecordedStates(
            table, setup.frame, setup.ground, setup.mount, setup.gimbal, self.recording.gimbal_reports
        )

    def expects_more(self, _: int, /) -> bool:
        """Whether hindsight is still to come; `LaterFixes`."""
        return not self.closed and self._hindsight is None and not self._no_hindsight

    def hindsight(self, _: int, __: NavigationSetup, /) -> Hindsight | None:
        """On all states of the flight at once, by all its fixes; `LaterFixes`."""
        return None if self._hindsight is None else Hindsight(self._better_at, lambda _: True)

    def _better_at(self, t_us: int) -> NavigationState | None:
        """None where the replayed estimate is another's, who does not tell how good its attitude is."""
        if self._hindsight is None or self.assumption_at(t_us) is not None:
            return None
        return self._hindsight.at(t_us + self._hindsight_offset_us - self._found_offset_us)

    def change(self, paused: bool | None, speed: float | None, seek_unix_us: int | None) -> None:
        """Pause or go on, change the speed, jump; a jump begins a new epoch."""
        self.speed = self.speed if speed is None else speed
        self.paused = self.paused if paused is None else paused
        if seek_unix_us is not None:
            self.epoch += 1
            self._jump(min(max(seek_unix_us, self.recording.start_us), self.recording.end_us))
        self.say()

    def body(self) -> ReplayBody:
        """Where it stands."""
        return ReplayBody(
            vehicle_id=self.id, flight_id=self.flight_id, t_unix_us=self._t_us,
            start_unix_us=self.recording.start_us, end_unix_us=self.recording.end_us, speed=self.speed,
            paused=self.paused, ended=self.ended, progress=self.estimate_progress,
        )  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """What lists of vehicles show."""
        telemetry = self.recording.telemetry_at(self._t_us)
        setup = self.recording.setup
        return {
            "id": self.id, "vehicle_type": telemetry.vehicle_type, "simulated": telemetry.simulated,
            "connected": True, "replay": True, "video_source": self.video_source, "flight_id": self.flight_id,
            "has_camera": setup is not None and setup.has_camera, "estimate_problem": self.estimate_problem,
        }  # fmt: skip

    def state_message(self) -> dict[str, Any] | None:
        """Fields of the ``state`` message, None where the flight has no estimate."""
        state = None if self._states is None else self._states.at(self._t_us)
        if state is None:
            return None
        denied = self.recording.folder.is_gps_denied(self._t_us)
        return {"vehicle_id": self.id, **state_fields(state, self.epoch, denied, self.recording.setup)}

    async def state_at(self, t_us: int) -> NavigationState | None:
        """The recorded or computed state at a time."""
        return self.recorded_state_at(t_us)

    def recorded_state_at(self, t_us: int) -> NavigationState | None:
        """The same, in any thread."""
        states = self._states
        return None if states is None else states.at(t_us)

    def exposure_us(self, frame: FrameIdentity) -> int:
        """When a frame was exposed: a known offset is in the recording's times, one found with the estimate is not."""
        return frame.t_us + self._found_offset_us

    def assumption_at(self, t_us: int) -> str | None:
        """What the state at a time assumes beyond what the flight's estimate tells."""
        return None if self._states is None else self._states.assumption_at(t_us)

    def identify(self, frame_id: int) -> FrameIdentity:
        """A frame of the flight by the id it was shown under.

        Raises
        ------
        FrameGoneError
            It is not of this flight.
        NoStateForFrameError
            The flight does not say when it was taken.
        """
        video, index = self.video_and_index(frame_id)
        t_us = self.recording.frame_time_us(index)
        if t_us is None:
            raise NoStateForFrameError(self.id, frame_id, "the flight does not say when it was taken")
        width_px, height_px = self._other_sizes.get(index, (video.width_px, video.height_px))
        return FrameIdentity(frame_id, t_us, width_px, height_px)

    async def jpeg(self, frame_id: int) -> bytes:
        """A frame of the flight as JPEG; FrameGoneError for others."""
        video, index = self.video_and_index(frame_id)
        try:
            return await asyncio.to_thread(video.jpeg, index)
        except VideoError:
            raise FrameGoneError(self.source, frame_id) from None

    def frame_id_of(self, index: int, epoch: int) -> int:
        """The id under which a picture of the flight is shown in an epoch."""
        return epoch * self._stride + index

    def video_and_index(self, frame_id: int) -> tuple[RecordedVideo, int]:
        """The picture of the flight that an id names; FrameGoneError for those of other flights."""
        video = self.recording.video
        epoch, index = divmod(frame_id, self._stride)
        if video is None or not 1 <= epoch <= self.epoch or not video.first_index <= index <= video.last_index:
            raise FrameGoneError(self.source, frame_id)
        return video, index

    def video_message(self) -> dict[str, Any]:
        """Fields of the ``video`` message."""
        video = self.recording.video
        playing = not self.paused and not self.ended
        return {
            "source": self.source, "vehicle_id": self.id, "status": "flowing" if playing else "stopped", "fps": 0.0,
            "width": 0 if video is None else video.width_px, "height": 0 if video is None else video.height_px,
            "codec": "" if video is None else video.codec, "last_frame_age_s": None, "latency_ms": None,
            "decode_errors": 0 if video is None else video.decode_errors, "epoch": self.epoch,
        }  # fmt: skip

    def say(self) -> None:
        """Publish where the replay stands, and the vehicle's state there."""
        body = self.body()
        self._hub.publish("replay", **body.model_dump())
        state = self.state_message()
        if state is not None:
            self._hub.publish("state", **state)

    def _jump(self, t_us: int) -> None:
        self._t_us = t_us
        self._packets = None
        self._ready.clear()
        self._video_done = False
        self._shown_index = -1
        self.audience.restart()
        self.jpeg_audience.restart()
        self._refill_tracks()

    def _refill_tracks(self) -> None:
        """Tracks as they were at the present time of the flight."""
        for ring in self.tracks.values():
            ring.clear()
        self._add_to_tracks(self.recording.start_us - 1, self._t_us)

    def _add_to_tracks(self, after_us: int, until_us: int) -> None:
        for reading in self.recording.gps_between(after_us, until_us):
            if reading.has_fix and reading.lat_deg is not None and reading.lon_deg is not None:
                self.tracks["gps"].add(
                    TrackPoint(reading.t_us, self.epoch, reading.lat_deg, reading.lon_deg, reading.alt_amsl_m or 0.0)
                )
        if self._states is not None:
            table = self._states.table
            for index in range(table.index_at(after_us) + 1, table.index_at(until_us) + 1):
                lat_deg, lon_deg, alt_m = (float(value) for value in table.values[index, :3])
                self.tracks["vision"].add(TrackPoint(int(table.t_us[index]), self.epoch, lat_deg, lon_deg, alt_m))

    async def _run(self) -> None:
        last_us = mono_us()
        while True:
            await asyncio.sleep(TICK_S)
            now_us = mono_us()
            step_us = 0 if self.paused else round(min(now_us - last_us, MAX_STEP_US) * self.speed)
            last_us = now_us
            before_us = self._t_us
            self._t_us = min(before_us + step_us, self.recording.end_us)
            if self._t_us > before_us:
                self._add_to_tracks(before_us, self._t_us)
            try:
                await self._show_frames()
            except VideoError as error:
                _log.warning("replayed video ends early", flight=self.flight_id, error=str(error))
                self._video_done = True
            self._say_now(now_us, before_us)

    def _say_now(self, now_us: int, before_us: int) -> None:
        if now_us - self._said_us < SAY_EVERY_US:
            return
        self._said_us = now_us
        self.say()
        readings = self.recording.gps_between(before_us - round(0.1e6 * self.speed), self._t_us)
        if readings:
            gps = readings[-1]
            self._hub.publish(
                "gps", vehicle_id=self.id, lat_deg=gps.lat_deg, lon_deg=gps.lon_deg, alt_amsl_m=gps.alt_amsl_m,
                fix_type=gps.fix_type, satellites=gps.satellites,
                std_horizontal_m=None if gps.std_horizontal_m is None else finite(gps.std_horizontal_m),
                used=gps.has_fix and not self.recording.folder.is_gps_denied(gps.t_us),
            )  # fmt: skip
        if now_us - self._said_telemetry_us >= SAY_TELEMETRY_EVERY_US:
            self._said_telemetry_us = now_us
            said = self.recording.telemetry_at(self._t_us)
            self._hub.publish("telemetry", vehicle_id=self.id, **telemetry_fields(said, self._t_us))
            self._hub.publish("video", **self.video_message())

    async def _show_frames(self) -> None:
        """Send what is due. After a jump the pictures from the last key frame on come at once, to decode from."""
        video = self.recording.video
        if video is None or self._video_done:
            return
        epoch = self.epoch
        if self._packets is None:
            self._packets = video.packets(self.recording.frame_at(self._t_us))
        packets = self._packets
        while True:
            if not self._ready:
                batch = await asyncio.to_thread(_next_batch, packets)
                if epoch != self.epoch:
                    return  # a jump came in between; the batch belongs to the time before it
                if not batch:
                    self._video_done = True
                    return
                self._ready = batch
            t_us = self.recording.frame_time_us(self._ready[0].index)
            if t_us is not None and t_us > self._t_us and self._shown_index >= 0:
                return
            # One without a time goes along with its predecessor: those after it are decoded from it.
            self._shown_us = self._shown_us if t_us is None else t_us
            self._show(self._ready.pop(0), self._shown_us)

    def _show(self, packet: RecordedPacket, t_us: int) -> None:
        self._shown_index = packet.index
        video, size_px = self.recording.video, (packet.width_px, packet.height_px)
        if video is not None and size_px != (video.width_px, video.height_px):
            self._other_sizes[packet.index] = size_px
        frame = EncodedFrame(
            self.frame_id_of(packet.index, self.epoch), self.epoch, t_us, unix_us(), packet.codec, packet.codec_string,
            packet.key, packet.width_px, packet.height_px, packet.payload,
        )  # fmt: skip
        self.audience.show(frame)
        if not self.jpeg_audience.size:
            return
        if packet.codec == "jpeg":
            self.jpeg_audience.show(frame)
        elif self._jpeg_busy is None or self._jpeg_busy.done():
            self._jpeg_busy = asyncio.create_task(self._show_jpeg(frame))

    async def _show_jpeg(self, frame: EncodedFrame) -> None:
        # One at a time: a viewer without a decoder sees fewer pictures, each with its right identity.
        try:
            payload = await self.jpeg(frame.frame_id)
        except FrameGoneError:
            return
        if frame.epoch == self.epoch:
            self.jpeg_audience.show(
                EncodedFrame(
                    frame.frame_id, frame.epoch, frame.t_us, frame.t_wire_us, "jpeg", "jpeg", True, frame.width,
                    frame.height, payload,
                )
            )  # fmt: skip


def _next_batch(packets: Iterator[RecordedPacket]) -> list[RecordedPacket]:
    batch: list[RecordedPacket] = []
    for packet in packets:
        batch.append(packet)
        if len(batch) >= BATCH_PACKETS:
            break
    return batch
