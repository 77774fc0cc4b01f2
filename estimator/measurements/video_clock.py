"""The video's clock while flying: which offset to add to frame times, and when it may be trusted.

The turns that pictures show (``odometry.image_gyro``) are laid against the telemetry's (``timing.camera_clock``).
Until the offset is observable no picture may steer the filter: at 20 m/s a tenth of a second is two metres, and in a
turn more.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.camera import Camera, Mount
from estimator.measurements.innovation import Innovation
from estimator.odometry.image_gyro import ImageGyro
from estimator.timing.camera_clock import CameraClock, CameraClockConfig
from estimator.timing.offset import OffsetEstimate
from estimator.types import Float, Image, OffsetSource, Sample, VideoOffset


@dataclass(frozen=True, slots=True)
class VideoClockConfig:
    """``patience_s`` is how long pictures are held back for an offset; after it they count as they are stamped."""

    clock: CameraClockConfig = field(default_factory=CameraClockConfig)
    first_interval_s: float = 1.0
    interval_s: float = 5.0
    patience_s: float = 20.0
    max_std_s: float = 0.02


class VideoClock:
    """Follows the offset between a camera's frame times and the telemetry."""

    def __init__(self, camera: Camera, mount: Mount, gimbal: str, config: VideoClockConfig | None = None) -> None:
        self.config = config or VideoClockConfig()
        self.estimate: OffsetEstimate | None = None
        self._camera = camera
        self._gyro = ImageGyro(camera)
        self._estimating: Generator[None, None, OffsetEstimate] | None = None
        self._clock = CameraClock(mount, gimbal, self.config.clock)
        self._first_t_us: int | None = None
        self._asked_t_us: int | None = None
        self._waited_s = 0.0
        self._offset_us = 0
        self._known = False
        self._boresight_told = False

    def offer(self, sample: Sample) -> None:
        """Take a sample of the telemetry."""
        self._clock.offer(sample)

    def restart(self) -> None:
        """The pictures' clock begins anew, as after a reconnect: the offset of before serves until one is found."""
        self._clock.reset()
        self._gyro = ImageGyro(self._camera)
        self._estimating = None
        self._asked_t_us = None

    def see(self, t_frame_us: int, image: Image, down_camera: Float) -> None:
        """Take a grey picture with its own frame time; ``down_camera`` (3,) is about where down is, in camera axes.

        The estimate is computed a little with each picture: at once, it would hold up the filter for too long.
        """
        if self._first_t_us is None:
            self._first_t_us = t_frame_us
        if self._asked_t_us is None:
            self._asked_t_us = t_frame_us
        self._waited_s = max(self._waited_s, (t_frame_us - self._first_t_us) / 1e6)
        turn = self._gyro.step(t_frame_us, image, down_camera)
        if turn is not None:
            self._clock.add_turn(turn.t_first_us, turn.t_second_us, turn.rotvec_camera_rad, turn.cov_rotvec_rad2)
        interval_s = self.config.interval_s if self._known else self.config.first_interval_s
        if self._estimating is None:
            if t_frame_us - self._asked_t_us < interval_s * 1e6:
                return
            self._asked_t_us = t_frame_us
            self._estimating = self._clock.steps()
        try:
            next(self._estimating)
        except StopIteration as end:
            self._estimating = None
            self._take(end.value)

    def _take(self, estimate: OffsetEstimate) -> None:
        if estimate.observable and estimate.std_s <= self.config.max_std_s:
            self.estimate = estimate
            self._offset_us = round(estimate.offset_s * 1e6)
            self._known = True
        elif self.estimate is None or not self._known:
            self.estimate = estimate

    @property
    def known(self) -> bool:
        """Whether the offset has been found."""
        return self._known

    @property
    def offset_us(self) -> int:
        """What to add to frame times, zero while nothing is known."""
        return self._offset_us

    @property
    def settled(self) -> bool:
        """Whether pictures may be used: the offset is known, or has been waited for long enough."""
        return self._known or self._waited_s > self.config.patience_s

    @property
    def lag_us(self) -> int:
        """How far the filter must stay behind the newest frame time, so that no picture comes too late.

        Nothing while the offset is searched: no picture counts then, and the state must not lag behind for it.
        """
        return max(-self._offset_us, 0)

    def boresight(self, eskf: ErrorStateFilter) -> Innovation | None:
        """The misalignment that the turns show, once: what comes later is not independent of it."""
        if self._boresight_told or not self._known or self.estimate is None:
            return None
        self._boresight_told = True
        z = self.estimate.boresight_rad - eskf.nominal.boresight_rad
        return Innovation(z, eskf.layout.jacobian(3, boresight=np.eye(3)), self.estimate.cov_boresight_rad2)


def offset_of(clock: VideoClock | None, stamped: bool) -> VideoOffset:
    """What is added to frame times: nothing where they are ``stamped``; without a clock the offset was given."""
    if stamped:
        return VideoOffset(OffsetSource.STAMPED, 0.0)
    if clock is None:
        return VideoOffset(OffsetSource.GIVEN)
    found = clock.estimate
    if not clock.known or found is None:
        return VideoOffset(OffsetSource.SEARCHING, reason=found.reason if found is not None else "no pictures yet")
    return VideoOffset(OffsetSource.FOUND, clock.offset_us / 1e6, found.std_s)
