"""The last minute of coded frames, so that a click on a paused or scrubbed picture finds its frame."""

from __future__ import annotations

import threading
from collections import deque

from backend.video.decoder import decode_last, image_from_jpeg
from backend.video.errors import FrameNotFoundError, UndecodableFrameError
from backend.video.frames import EncodedFrame
from backend.video.jpeg import encode_jpeg
from backend.video.pictures import bgr_from_frame
from estimator.types import Image

DEFAULT_SECONDS = 60.0
DEFAULT_MAX_BYTES = 96_000_000


class FrameRing:
    """Frames by number, in whole groups from key frame to key frame. Any thread.

    Holds at least the last ``seconds`` by arrival where ``max_bytes`` allows.
    """

    def __init__(self, seconds: float = DEFAULT_SECONDS, max_bytes: int = DEFAULT_MAX_BYTES) -> None:
        self._span_us = int(seconds * 1e6)
        self._max_bytes = max_bytes
        self._groups: deque[list[EncodedFrame]] = deque()
        self._bytes = 0
        self._lock = threading.Lock()

    @property
    def byte_count(self) -> int:
        """Bytes of payload held."""
        return self._bytes

    def append(self, frame: EncodedFrame) -> None:
        """Take a frame; numbers rise. A frame whose key frame is not held is passed over."""
        with self._lock:
            if frame.key:
                self._groups.append([])
            if not self._groups:
                return
            self._groups[-1].append(frame)
            self._bytes += len(frame.payload)
            oldest_us = frame.t_wire_us - self._span_us
            while len(self._groups) > 1 and (
                self._groups[1][0].t_wire_us <= oldest_us or self._bytes > self._max_bytes
            ):
                self._bytes -= sum(len(f.payload) for f in self._groups.popleft())
            if self._bytes > self._max_bytes:
                # One group alone is too long: a stream whose key frames are minutes apart. Begin again at the next.
                self._groups.clear()
                self._bytes = 0

    def get(self, frame_id: int) -> EncodedFrame:
        """A frame that is held; `FrameNotFoundError` for others."""
        return self.from_key(frame_id)[-1]

    def from_key(self, frame_id: int) -> list[EncodedFrame]:
        """The frames from the key frame that a frame leans on to that frame; `FrameNotFoundError` if not held."""
        with self._lock:
            for group in reversed(self._groups):
                if group[0].frame_id <= frame_id:
                    upto = [f for f in group if f.frame_id <= frame_id]
                    if upto[-1].frame_id == frame_id:
                        return upto
                    break
            first = self._groups[0][0].frame_id if self._groups else None
            last = self._groups[-1][-1].frame_id if self._groups else None
        raise FrameNotFoundError(frame_id, first, last)

    def after(self, frame_id: int) -> list[EncodedFrame]:
        """The frames after one that is held, in turn; `FrameNotFoundError` where it is not held any more."""
        self.get(frame_id)
        with self._lock:
            return [frame for group in self._groups for frame in group if frame.frame_id > frame_id]

    def newest_group(self) -> list[EncodedFrame]:
        """From the last key frame to the newest frame; empty before the first."""
        with self._lock:
            return list(self._groups[-1]) if self._groups else []

    def image(self, frame_id: int) -> Image:
        """Picture of a frame, BGR; `FrameNotFoundError`, or `UndecodableFrameError` where it is damaged."""
        group = self.from_key(frame_id)
        if group[-1].codec == "jpeg":
            image = image_from_jpeg(group[-1].payload, colour=True)
            if image is None:
                raise UndecodableFrameError(frame_id)
            return image
        return bgr_from_frame(decode_last(group))

    def jpeg(self, frame_id: int) -> bytes:
        """Picture of a frame as JPEG; errors as for `image`."""
        frame = self.get(frame_id)
        return frame.payload if frame.codec == "jpeg" else encode_jpeg(self.image(frame_id))
