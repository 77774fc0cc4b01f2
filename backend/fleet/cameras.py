"""The station's live camera: one video channel, who watches it, and what the estimator gets of it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np

from backend.clock import unix_us
from backend.errors import FrameGoneError, StartError
from backend.event_loop import call_from_thread
from backend.fleet.feed import FrameIdentity
from backend.fleet.viewers import Audience
from backend.metrics import Metrics
from backend.navigation.setup import CameraProfile
from backend.recorder.recorder import Recorder
from backend.video.catch_up import pictures_after
from backend.video.channel import VideoChannel
from backend.video.errors import FrameNotFoundError, UndecodableFrameError, VideoSourceError
from backend.video.frames import DecodedFrame, EncodedFrame, VideoHealth, VideoStatus
from estimator.types import FrameSample, Image
from geodata.flight_meta import CameraMeta

ASPECT_TOLERANCE = 0.01
LONGEST_REVISION_US = 5_000_000
FIRST_VEHICLE = "1"


@dataclass(frozen=True, slots=True, eq=False)
class ColourPicture:
    """A frame of the video and its picture (rows, columns, 3) BGR at the size that the camera is calibrated for."""

    frame: FrameIdentity
    image: Image


class PictureWatcher(Protocol):
    """Looks at pictures in colour. Called in the decoder's thread, and must not wait."""

    def wants(self, t_us: int) -> bool:
        """Whether the picture of a time (of its frame) is worth decoding in colour."""

    def offer(self, picture: ColourPicture) -> None:
        """Take a picture."""


class LiveCamera:
    """Wires a `VideoChannel` to viewers, recorder and estimator. Lives on the event loop; pictures come from threads.

    The camera belongs to the vehicle that the camera file names, else to the first one heard.
    ``on_picture`` is called in the decoder's thread with pictures of the calibrated size.
    """

    def __init__(
        self, url: str, time_offset_s: float, profile: CameraProfile | None, metrics: Metrics, recorder: Recorder,
        on_picture: Callable[[FrameSample], None], map_vehicle_unix: Callable[[int], int | None],
    ) -> None:  # fmt: skip
        self.audience = Audience()
        self.jpeg_audience = Audience()
        self.size_problem: str | None = None
        self.watcher: PictureWatcher | None = None
        self.size_px: tuple[int, int] | None = None
        self._calibrated: CameraMeta | None = None if profile is None else profile.camera
        named = None if profile is None or profile.vehicle is None else profile.vehicle.system_id
        self._vehicle_id = None if named is None else str(named)
        self._metrics = metrics
        self._recorder = recorder
        self._on_picture = on_picture
        self._loop = asyncio.get_running_loop()
        self._frames = metrics.frames.labels("camera")
        self._newest = (0, 0)  # epoch and exposure of the newest picture for the estimator
        try:
            self._channel = VideoChannel(
                url, on_encoded=self._take_encoded, on_decoded=self._take_decoded, on_jpeg=self._take_jpeg,
                on_colour=self._take_colour, wants_colour=self._wants_colour,
                map_vehicle_unix=map_vehicle_unix, time_offset_s=time_offset_s,
            )  # fmt: skip
        except VideoSourceError as error:
            raise StartError(f"--video: {error}") from None

    @property
    def vehicle_id(self) -> str:
        """The vehicle that carries the camera."""
        return self._vehicle_id or FIRST_VEHICLE

    @property
    def source(self) -> str:
        """The id of the video source."""
        return f"cam-{self.vehicle_id}"

    def answers_to(self, source: str) -> bool:
        """Whether a source id means this camera; before its vehicle is known it goes by the first one's name."""
        return source in (self.source, f"cam-{FIRST_VEHICLE}")

    def belongs_to(self, vehicle_id: str) -> None:
        """A vehicle was heard: the first one carries the camera unless the camera file says otherwise."""
        if self._vehicle_id is None:
            self._vehicle_id = vehicle_id

    def start(self) -> None:
        """Begin to receive."""
        self._channel.start()

    def close(self) -> None:
        """End; takes up to two seconds."""
        self._channel.close()

    def close_audience(self) -> None:
        """Send the viewers away."""
        self.audience.close()
        self.jpeg_audience.close()

    def health(self) -> VideoHealth:
        """How the video does."""
        return self._channel.health()

    def waiting_for(self) -> str | None:
        """What does not come, None while video flows."""
        health = self.health()
        if health.status in (VideoStatus.WAITING, VideoStatus.STOPPED):
            return f"video: {health.text}"
        return None

    def video_message(self) -> dict[str, Any]:
        """Fields of the ``video`` message."""
        health = self.health()
        return {
            "source": self.source, "vehicle_id": self.vehicle_id, "status": str(health.status), "fps": health.fps,
            "width": health.width, "height": health.height, "codec": health.codec,
            "last_frame_age_s": health.last_frame_age_s, "latency_ms": health.latency_ms,
            "decode_errors": health.decode_errors, "epoch": health.epoch, "text": health.text,
        }  # fmt: skip

    def identify(self, frame_id: int) -> FrameIdentity:
        """A frame of the last minute; FrameGoneError for others."""
        try:
            frame = self._channel.ring.get(frame_id)
        except FrameNotFoundError:
            raise FrameGoneError(self.source, frame_id) from None
        return FrameIdentity(frame.frame_id, frame.t_us, frame.width, frame.height, frame.stamped)

    async def jpeg(self, frame_id: int) -> bytes:
        """A frame of the last minute as JPEG; FrameGoneError for others."""
        try:
            return await asyncio.to_thread(self._channel.ring.jpeg, frame_id)
        except (FrameNotFoundError, UndecodableFrameError):
            raise FrameGoneError(self.source, frame_id) from None

    async def picture(self, frame_id: int) -> ColourPicture:
        """A frame of the last minute in colour; FrameGoneError for others, and where its shape is not the camera's."""
        identity = self.identify(frame_id)
        try:
            image = await asyncio.to_thread(self._channel.ring.image, frame_id)
        except (FrameNotFoundError, UndecodableFrameError):
            raise FrameGoneError(self.source, frame_id) from None
        found = self._coloured(identity, image)
        if found is None:
            raise FrameGoneError(self.source, frame_id)
        return found

    def pictures_after(self, frame_id: int, step_us: int) -> Iterator[ColourPicture]:
        """What came after a frame of the last minute up to now, at least ``step_us`` apart; for any one thread."""
        for frame, image in pictures_after(self._channel.ring, frame_id, step_us):
            identity = FrameIdentity(frame.frame_id, frame.t_us, frame.width, frame.height, frame.stamped)
            found = self._coloured(identity, image)
            if found is not None:
                yield found

    def _wants_colour(self, frame: EncodedFrame) -> bool:
        watcher = self.watcher
        return watcher is not None and watcher.wants(frame.t_us)

    def _take_colour(self, frame: DecodedFrame) -> None:
        watcher = self.watcher
        rows, columns = frame.image.shape[:2]
        identity = FrameIdentity(frame.frame_id, frame.t_us, columns, rows, frame.stamped)
        found = self._coloured(identity, frame.image)
        if watcher is not None and found is not None:
            watcher.offer(found)

    def _coloured(self, identity: FrameIdentity, image: Image) -> ColourPicture | None:
        if self._calibrated is None:
            return None
        whole, _ = fitted(image, self._calibrated)
        return None if whole is None else ColourPicture(identity, whole)

    def _take_encoded(self, frame: EncodedFrame) -> None:
        self._recorder.frame(frame)
        call_from_thread(self._loop, self._show, frame)

    def _show(self, frame: EncodedFrame) -> None:
        self._frames.inc()
        self.audience.show(frame)
        self._channel.jpeg_wanted = self.jpeg_audience.size > 0

    def _take_jpeg(self, frame: EncodedFrame) -> None:
        call_from_thread(self._loop, self.jpeg_audience.show, frame)

    def _take_decoded(self, frame: DecodedFrame) -> None:
        self._metrics.stage.labels("exposure_to_decoded").observe(max(unix_us() - frame.t_us, 0) / 1e6)
        rows, columns = frame.image.shape[:2]
        self.size_px = (columns, rows)
        if self._calibrated is None:
            return
        image, self.size_problem = fitted(frame.image, self._calibrated)
        if image is not None and self._runs_forward(frame):
            self._on_picture(FrameSample(frame.t_us, frame.frame_id, image, frame.epoch, frame.stamped))

    def _runs_forward(self, frame: DecodedFrame) -> bool:
        # When the delay proves smaller than thought, the next exposures lie before those of pictures already given:
        # the estimator would see the motion between them backwards. A longer step is another clock.
        epoch, t_us = self._newest
        if frame.epoch == epoch and 0 <= t_us - frame.t_us < LONGEST_REVISION_US:
            return False
        self._newest = frame.epoch, frame.t_us
        return True


def fitted(image: Image, camera: CameraMeta) -> tuple[Image | None, str | None]:
    """A picture at the calibrated size; None, and why, when its shape says that it is cut or of another camera."""
    rows, columns = image.shape[:2]
    if (columns, rows) == (camera.width_px, camera.height_px):
        return image, None
    if abs((columns / rows) / (camera.width_px / camera.height_px) - 1.0) > ASPECT_TOLERANCE:
        return None, (
            f"the video's {columns} x {rows} contradicts the camera file's {camera.width_px} x {camera.height_px}: "
            "navigation goes on without it"
        )
    shrinks = columns > camera.width_px
    resized = cv2.resize(
        image, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    )
    return resized.astype(np.uint8, copy=False), None
