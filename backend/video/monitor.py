"""Watches a video: does it flow, has it stopped, does it show the same picture again and again? Reads no clock."""

from __future__ import annotations

import threading
from collections import deque
from statistics import median

import numpy as np
from numpy.typing import NDArray

from backend.video.frames import EncodedFrame, VideoHealth, VideoStatus
from estimator.types import Image

STOPPED_AFTER_US = 1_500_000
FROZEN_AFTER_US = 1_000_000
_FPS_SPAN_US = 2_000_000
_LATENCIES = 50
_SAMPLE_STEP_PX = 8
# An encoder repeats a frozen camera's picture not quite exactly: each key frame codes it anew. Those differ by less
# than half a grey level on average; the noise of a live camera by more.
_SAME_PICTURE_LEVELS = 0.5


class VideoMonitor:
    """Health of one source. Any thread; all times are Unix microseconds of the station."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._arrivals: deque[int] = deque()
        self._latencies_ms: deque[float] = deque(maxlen=_LATENCIES)
        self._last: EncodedFrame | None = None
        self._last_us = 0
        self._still: NDArray[np.int16] | None = None
        self._still_since_us = 0

    def arrived(self, frame: EncodedFrame, t_us: int) -> None:
        """A coded frame is handed on at ``t_us``."""
        with self._lock:
            self._last = frame
            self._last_us = t_us
            self._arrivals.append(t_us)
            self._forget(t_us)

    def decoded(self, image: Image, t_wire_us: int, t_us: int) -> None:
        """Its picture, grey or BGR, is ready at ``t_us``."""
        sample = image[::_SAMPLE_STEP_PX, ::_SAMPLE_STEP_PX].astype(np.int16)
        with self._lock:
            self._latencies_ms.append((t_us - t_wire_us) / 1e3)
            still = self._still
            if (
                still is None
                or still.shape != sample.shape
                or float(np.abs(sample - still).mean()) > _SAME_PICTURE_LEVELS
            ):
                self._still = sample
                self._still_since_us = t_us

    def health(self, t_us: int, source_text: str, epoch: int, decode_errors: int) -> VideoHealth:
        """How the video does at ``t_us``; ``source_text`` says what the source waits for."""
        with self._lock:
            self._forget(t_us)
            last = self._last
            if last is None:
                return VideoHealth(VideoStatus.WAITING, source_text, epoch, 0.0, 0, 0, "", None, None, decode_errors)
            age_us = max(0, t_us - self._last_us)
            still_us = self._last_us - self._still_since_us if self._still is not None else 0
            status, text = VideoStatus.FLOWING, f"{last.codec} {last.width} x {last.height}"
            if age_us > STOPPED_AFTER_US:
                status, text = VideoStatus.STOPPED, f"no picture for {age_us / 1e6:.0f} s; {source_text}"
            elif still_us > FROZEN_AFTER_US:
                status, text = (
                    VideoStatus.FROZEN,
                    f"frames come, but the picture has not changed for {still_us / 1e6:.0f} s",
                )
            return VideoHealth(
                status,
                text,
                epoch,
                self._fps(),
                last.width,
                last.height,
                last.codec,
                age_us / 1e6,
                median(self._latencies_ms) if self._latencies_ms else None,
                decode_errors,
            )

    def _fps(self) -> float:
        if len(self._arrivals) < 2:
            return 0.0
        span_us = self._arrivals[-1] - self._arrivals[0]
        return (len(self._arrivals) - 1) * 1e6 / span_us if span_us > 0 else 0.0

    def _forget(self, t_us: int) -> None:
        while self._arrivals and self._arrivals[0] < t_us - _FPS_SPAN_US:
            self._arrivals.popleft()
