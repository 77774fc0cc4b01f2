"""H.264 made for tests: numbered pictures as encoded frames."""

from __future__ import annotations

import av

from backend.video.annexb import ParameterSets, is_key
from backend.video.frames import EncodedFrame
from tests.backend.video.pictures_with_numbers import picture_with_number


def h264_units(
    count: int, size: tuple[int, int] = (320, 240), gop: int = 25, codec: str = "libx264", more: str = ""
) -> list[bytes]:
    """Access units, byte stream; the n-th shows the number n."""
    encoder = av.CodecContext.create(codec, "w")
    encoder.width, encoder.height = size
    encoder.pix_fmt = "yuv420p"
    encoder.framerate = 25
    if codec == "libx264":
        encoder.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "x264-params": f"keyint={gop}:scenecut=0{more}",
        }
    else:
        parameters = f"log-level=error:keyint={gop}:pools=1:frame-threads=1:repeat-headers=1"
        encoder.options = {"preset": "ultrafast", "tune": "zerolatency", "x265-params": parameters}
    packets = []
    for n in range(count):
        picture = av.VideoFrame.from_ndarray(picture_with_number(n, size), format="gray").reformat(format="yuv420p")
        packets += encoder.encode(picture)
    return [bytes(p) for p in [*packets, *encoder.encode(None)]]


def encoded_frames(
    count: int, size: tuple[int, int] = (320, 240), gop: int = 25, first_id: int = 0, t0_us: int = 1_000_000
) -> list[EncodedFrame]:
    """Frames 40 ms apart whose n-th shows ``n``, with ids from ``first_id``."""
    sets = ParameterSets()
    frames = []
    for n, unit in enumerate(h264_units(count, size, gop)):
        payload = sets.complete(unit)
        assert sets.sequence is not None
        t_us = t0_us + 40_000 * n
        name = sets.sequence.codec_string
        frames.append(EncodedFrame(first_id + n, 1, t_us, t_us + 5_000, "h264", name, is_key(payload), *size, payload))
    return frames
