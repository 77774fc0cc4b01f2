"""Where a follower's pictures and states come from: a live vehicle with its camera, or a flight that is replayed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from typing import Protocol

from backend.clock import unix_us
from backend.errors import CannotFollowTargetError, FrameGoneError
from backend.fleet.cameras import ColourPicture, LiveCamera, PictureWatcher, fitted
from backend.fleet.feed import FrameIdentity
from backend.fleet.vehicle import LiveVehicle, VehicleView
from backend.navigation.setup import NavigationSetup
from backend.playback.playback import Playback
from backend.video.errors import VideoError
from estimator.types import Image, NavigationState

STATE_TIMEOUT_S = 1.0
LINK_LOST = "the link to the vehicle was lost"
REPLAY_ENDED = "the replay was ended"
REPLAY_MOVED = "the replay was moved to another time"


class FollowSource(Protocol):
    """One vehicle with its camera; made anew for each target. States and pictures may be asked for in any thread."""

    vehicle: VehicleView
    is_live: bool

    @property
    def setup(self) -> NavigationSetup | None:
        """Camera, frame and ground now."""

    @property
    def over(self) -> str | None:
        """Why no picture will come any more, None while some may."""

    @property
    def is_waiting(self) -> bool:
        """Whether pictures stay away because somebody wants it so."""

    def identify(self, frame_id: int) -> FrameIdentity:
        """A frame that is held; FrameGoneError for others."""

    async def picture(self, frame_id: int) -> ColourPicture:
        """The same in colour, at the calibrated size."""

    def pictures_after(self, frame_id: int, step_us: int) -> Iterator[ColourPicture]:
        """What comes after a frame, at least ``step_us`` apart, as far as it is there."""

    def watch(self, watcher: PictureWatcher) -> None:
        """Hand what comes further to a watcher, if there is more than `pictures_after` gives."""

    def exposure_us(self, frame: FrameIdentity) -> int:
        """When a frame was exposed, on the states' clock."""

    def is_due(self, frame: FrameIdentity) -> bool:
        """Whether the state of a frame is known: before that it would be a guess."""

    def state_at(self, t_us: int) -> NavigationState | None:
        """The state at an exposure; waits for it."""


class LiveSource:
    """A vehicle that flies now."""

    is_live = True
    is_waiting = False

    def __init__(self, vehicle: LiveVehicle, camera: LiveCamera, now_us: Callable[[], int] = unix_us) -> None:
        self.vehicle: VehicleView = vehicle
        self._live = vehicle
        self._camera = camera
        self._now_us = now_us

    @property
    def setup(self) -> NavigationSetup | None:
        """As the estimator has it."""
        return self._live.setup

    @property
    def over(self) -> str | None:
        """When nothing is heard of it."""
        return None if self._live.connected else LINK_LOST

    def identify(self, frame_id: int) -> FrameIdentity:
        """One of the last minute."""
        return self._camera.identify(frame_id)

    async def picture(self, frame_id: int) -> ColourPicture:
        """One of the last minute."""
        return await self._camera.picture(frame_id)

    def pictures_after(self, frame_id: int, step_us: int) -> Iterator[ColourPicture]:
        """Up to now."""
        return self._camera.pictures_after(frame_id, step_us)

    def watch(self, watcher: PictureWatcher) -> None:
        """The camera's pictures as they come."""
        self._camera.watcher = watcher

    def exposure_us(self, frame: FrameIdentity) -> int:
        """By the video's clock as it is known."""
        return self._live.exposure_us(frame)

    def is_due(self, frame: FrameIdentity) -> bool:
        """Whether the estimator has passed it."""
        worker = self._live.worker
        delay_us = 0 if worker is None else worker.delay_us
        return self._now_us() - self._live.exposure_us(frame) >= delay_us

    def state_at(self, t_us: int) -> NavigationState | None:
        """As the estimator answers a click."""
        worker = self._live.worker
        if worker is None:
            return None
        try:
            return worker.state_at(t_us).result(STATE_TIMEOUT_S)
        except (TimeoutError, CancelledError):
            return None


class ReplaySource:
    """A flight that is replayed: its pictures as far as they are shown, with the numbers they are shown under."""

    is_live = False

    def __init__(self, playback: Playback) -> None:
        self.vehicle: VehicleView = playback
        self._playback = playback
        self._epoch = playback.epoch

    @property
    def setup(self) -> NavigationSetup | None:
        """Of the flight."""
        return self._playback.setup

    @property
    def over(self) -> str | None:
        """When it ends, or another time of it is shown."""
        if self._playback.closed:
            return REPLAY_ENDED
        return None if self._playback.epoch == self._epoch else REPLAY_MOVED

    @property
    def is_waiting(self) -> bool:
        """While it is paused."""
        return self._playback.paused

    def identify(self, frame_id: int) -> FrameIdentity:
        """Any of the flight."""
        return self._playback.identify(frame_id)

    async def picture(self, frame_id: int) -> ColourPicture:
        """Any of the flight."""
        video, index = self._playback.video_and_index(frame_id)
        try:
            recorded = await asyncio.to_thread(video.frame, index)
        except VideoError:
            raise FrameGoneError(self._playback.source, frame_id) from None
        found = self._coloured(frame_id, recorded.image)
        if found is None:
            raise FrameGoneError(self._playback.source, frame_id)
        return found

    def pictures_after(self, frame_id: int, step_us: int) -> Iterator[ColourPicture]:
        """Up to the end of the flight, whose rest is not due yet."""
        video, index = self._playback.video_and_index(frame_id)
        last_us = self._playback.recording.frame_time_us(index)
        for recorded in video.frames(index + 1, colour=True):
            t_us = self._playback.recording.frame_time_us(recorded.index)
            if t_us is None or (last_us is not None and t_us - last_us < step_us):
                continue
            found = self._coloured(self._playback.frame_id_of(recorded.index, self._epoch), recorded.image)
            if found is not None:
                last_us = t_us
                yield found

    def watch(self, watcher: PictureWatcher) -> None:
        """There is no more than the flight has."""

    def exposure_us(self, frame: FrameIdentity) -> int:
        """By the flight's clocks."""
        return self._playback.exposure_us(frame)

    def is_due(self, frame: FrameIdentity) -> bool:
        """Whether it is shown."""
        return frame.t_us <= self._playback.t_us

    def state_at(self, t_us: int) -> NavigationState | None:
        """As it was recorded or computed."""
        return self._playback.recorded_state_at(t_us)

    def _coloured(self, frame_id: int, image: Image) -> ColourPicture | None:
        calibrated = self._playback.recording.folder.meta.camera
        t_us = self._playback.recording.frame_time_us(self._playback.video_and_index(frame_id)[1])
        if calibrated is None or t_us is None:
            return None
        rows, columns = image.shape[:2]
        whole, _ = fitted(image, calibrated)
        return None if whole is None else ColourPicture(FrameIdentity(frame_id, t_us, columns, rows), whole)


def source_of(vehicle: VehicleView, camera: LiveCamera | None) -> FollowSource:
    """The pictures and states of a vehicle; CannotFollowTargetError where there is no video."""
    if isinstance(vehicle, Playback):
        if vehicle.recording.video is None:
            raise CannotFollowTargetError("the flight has no video")
        return ReplaySource(vehicle)
    if not isinstance(vehicle, LiveVehicle) or camera is None or camera.vehicle_id != vehicle.id:
        raise CannotFollowTargetError("the vehicle has no video")
    return LiveSource(vehicle, camera)
