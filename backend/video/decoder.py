"""One decoder of one coded stream: payloads with a number in, pictures with the same number out."""

from __future__ import annotations

from typing import Any

import av
import cv2
import numpy as np
from av.codec.context import ThreadType

from backend.video.errors import UndecodableFrameError
from backend.video.frames import EncodedFrame
from estimator.types import Image

# AV_CODEC_FLAG_LOW_DELAY: hand out each picture at once instead of keeping it for reordering.
_LOW_DELAY = 1 << 19


class PictureDecoder:
    """Decodes "h264" or "hevc"; ``errors`` counts what could not be decoded. One thread."""

    def __init__(self, codec: str) -> None:
        context = av.CodecContext.create(codec, "r")
        if not isinstance(context, av.VideoCodecContext):
            raise ValueError(f"{codec} is no video codec")
        # Threads by frame would each hold a picture back.
        context.thread_type = ThreadType.SLICE
        context.thread_count = 1
        context.flags |= _LOW_DELAY
        self._context = context
        self.errors = 0

    def decode(self, payload: bytes, number: int) -> list[tuple[int, av.VideoFrame]]:
        """Pictures that are complete with this payload, each with its own payload's number."""
        if not payload:
            self.errors += 1  # to FFmpeg an empty packet means the end of the stream
            return []
        packet = av.Packet(payload)
        packet.pts = packet.dts = number
        return self._decode(packet)

    def flush(self) -> list[tuple[int, av.VideoFrame]]:
        """Pictures held back for reordering; the decoder is spent afterwards."""
        return self._decode(None)

    def _decode(self, packet: av.Packet[Any] | None) -> list[tuple[int, av.VideoFrame]]:
        try:
            frames = self._context.decode(packet)
        except av.FFmpegError:
            self.errors += 1
            return []
        whole = [(f.pts, f) for f in frames if f.pts is not None and not f.is_corrupt]
        self.errors += len(frames) - len(whole)
        return whole


def decode_last(group: list[EncodedFrame]) -> av.VideoFrame:
    """Picture of the last frame of a run that begins with a key frame.

    Raises
    ------
    UndecodableFrameError
        The last frame gives no picture.
    """
    wanted = group[-1].frame_id
    decoder = PictureDecoder(group[-1].codec)
    pictures = [p for frame in group for p in decoder.decode(frame.payload, frame.frame_id)]
    found = dict([*pictures, *decoder.flush()])
    if wanted not in found:
        raise UndecodableFrameError(wanted)
    return found[wanted]


def image_from_jpeg(payload: bytes, *, colour: bool) -> Image | None:
    """Picture of a JPEG, grey or BGR; None where it is none."""
    data = np.frombuffer(payload, np.uint8)
    if data.size == 0:
        return None
    image = cv2.imdecode(data, cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE)
    return None if image is None else image.astype(np.uint8, copy=False)
