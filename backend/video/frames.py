"""What flows through the video part: units off the wire, coded frames with their identity, decoded frames, health."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from estimator.types import Image


@dataclass(frozen=True, slots=True)
class VideoUnit:
    """One coded picture as a source delivers it.

    ``codec`` is "h264" or "hevc" (byte stream with start codes) or "jpeg". ``pts_us`` is its presentation time on the
    sender's clock, None when it has none. ``t_wire_us`` is when its first byte arrived. ``after_loss`` says that
    something before it, or of it, is missing.
    """

    codec: str
    payload: bytes
    pts_us: int | None
    t_wire_us: int
    after_loss: bool = False


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """One coded picture with its identity.

    ``frame_id`` counts up over the station's life and is never used twice. ``epoch`` rises on reconnect, change of size
    and seek. ``t_us`` is the exposure, ``t_wire_us`` the arrival of the first byte, both on the station's time base.
    ``payload`` is H.264 as a byte stream with parameter sets in front of every key frame, or JPEG, where every frame is
    a key frame. ``stamped`` says that the exposure was written into the picture by the vehicle's own clock.
    """

    frame_id: int
    epoch: int
    t_us: int
    t_wire_us: int
    codec: str
    codec_string: str
    key: bool
    width: int
    height: int
    payload: bytes
    stamped: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class DecodedFrame:
    """The picture of the encoded frame with the same ``frame_id``: (rows, columns) grey or (rows, columns, 3) BGR."""

    frame_id: int
    epoch: int
    t_us: int
    image: Image
    stamped: bool = False


class VideoStatus(StrEnum):
    """What a video does."""

    WAITING = "waiting"
    FLOWING = "flowing"
    FROZEN = "frozen"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class VideoHealth:
    """How a video does; ``text`` says it in words, with what is waited for.

    ``fps`` is of the last two seconds. ``latency_ms`` is the median from first byte on the wire to decoded
    picture of recent frames.
    ``decode_errors`` counts pictures lost on the way or undecodable.
    """

    status: VideoStatus
    text: str
    epoch: int
    fps: float
    width: int
    height: int
    codec: str
    last_frame_age_s: float | None
    latency_ms: float | None
    decode_errors: int
