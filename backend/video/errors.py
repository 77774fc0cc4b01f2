"""What can be wrong with a video.

``VideoError``              the base of all
``VideoSourceError``        an address that names no source this station can open
``RecordedVideoError``      a recorded video that is absent, empty or unreadable
``FrameNotFoundError``      a frame that the video or the ring does not hold
``UndecodableFrameError``   a frame that is there but cannot be turned into a picture
"""

from __future__ import annotations

from pathlib import Path


class VideoError(Exception):
    """Base of everything that video code raises on purpose."""


class VideoSourceError(VideoError):
    """A video address that cannot be used: ``url`` as given, ``reason`` what is wrong with it and what would do."""

    def __init__(self, url: str, reason: str) -> None:
        super().__init__(f"video address {url!r}: {reason}")
        self.url = url
        self.reason = reason


class RecordedVideoError(VideoError):
    """A recorded video that cannot be read: ``path`` and ``reason``."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"video {path}: {reason}")
        self.path = path
        self.reason = reason


class FrameNotFoundError(VideoError):
    """Frame ``frame_id`` is not held; ``first`` and ``last`` bound what is, None when nothing is."""

    def __init__(self, frame_id: int, first: int | None, last: int | None) -> None:
        held = "no frame is held" if first is None or last is None else f"frames {first} to {last} are held"
        super().__init__(f"frame {frame_id} is not available: {held}")
        self.frame_id = frame_id
        self.first = first
        self.last = last


class UndecodableFrameError(VideoError):
    """Frame ``frame_id`` is held but gives no picture: it or a frame it leans on arrived damaged."""

    def __init__(self, frame_id: int) -> None:
        super().__init__(f"frame {frame_id} cannot be decoded: it, or a frame it depends on, is damaged or missing")
        self.frame_id = frame_id
