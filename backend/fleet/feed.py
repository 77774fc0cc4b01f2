"""What a video source looks like to the API, live or replayed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from backend.errors import InvalidRequestError
from backend.fleet.viewers import Audience


@dataclass(frozen=True, slots=True)
class FrameIdentity:
    """When a frame was exposed by the video's clock, or by the vehicle's where it is ``stamped``, and its size."""

    frame_id: int
    t_us: int
    width_px: int
    height_px: int
    stamped: bool = False

    def check_shows(self, u_px: float, v_px: float) -> None:
        """Raise InvalidRequestError for a pixel outside the frame.

        Pixel centres are whole numbers, so the frame's edge lies at -0.5.
        """
        if not (-0.5 <= u_px <= self.width_px - 0.5 and -0.5 <= v_px <= self.height_px - 0.5):
            size = f"{self.width_px} x {self.height_px}"
            raise InvalidRequestError(f"pixel ({u_px}, {v_px}) lies outside the frame of {size}")


class VideoFeed(Protocol):
    """A video source."""

    audience: Audience
    jpeg_audience: Audience

    @property
    def source(self) -> str:
        """The id of the source."""

    @property
    def vehicle_id(self) -> str:
        """The vehicle that carries it."""

    def identify(self, frame_id: int) -> FrameIdentity:
        """A frame that is still held; FrameGoneError for others."""

    async def jpeg(self, frame_id: int) -> bytes:
        """A frame that is still held, as JPEG; FrameGoneError for others."""

    def video_message(self) -> dict[str, Any]:
        """Fields of the ``video`` message."""
