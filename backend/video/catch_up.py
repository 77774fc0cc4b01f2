"""Pictures of the ring from a frame on: what one who begins late has to look at first."""

from __future__ import annotations

from collections.abc import Iterator

from backend.video.decoder import PictureDecoder, image_from_jpeg
from backend.video.errors import FrameNotFoundError
from backend.video.frames import EncodedFrame
from backend.video.pictures import bgr_from_frame
from backend.video.ring import FrameRing
from estimator.types import Image


def pictures_after(ring: FrameRing, frame_id: int, step_us: int) -> Iterator[tuple[EncodedFrame, Image]]:
    """Pictures (rows, columns, 3) BGR after a held frame, at least ``step_us`` apart, until there is none yet.

    Each frame is decoded once, in turn. Ends early where the ring lets go of the frame that was looked at last.
    """
    try:
        waiting = ring.from_key(frame_id)
    except FrameNotFoundError:
        return
    decoder: PictureDecoder | None = None
    made_for: tuple[str, int] | None = None
    coded: dict[int, EncodedFrame] = {}
    last_us = waiting[-1].t_us
    while waiting:
        for frame in waiting:
            if frame.codec == "jpeg":
                if frame.frame_id > frame_id and frame.t_us - last_us >= step_us:
                    picture = image_from_jpeg(frame.payload, colour=True)
                    if picture is not None:
                        last_us = frame.t_us
                        yield frame, picture
                continue
            if decoder is None or made_for != (frame.codec, frame.epoch):
                decoder, made_for = PictureDecoder(frame.codec), (frame.codec, frame.epoch)
                coded.clear()
            coded[frame.frame_id] = frame
            for number, decoded in decoder.decode(frame.payload, frame.frame_id):
                shown = coded.pop(number, None)
                if shown is None or number <= frame_id or shown.t_us - last_us < step_us:
                    continue
                last_us = shown.t_us
                yield shown, bgr_from_frame(decoded)
        try:
            waiting = ring.after(waiting[-1].frame_id)
        except FrameNotFoundError:
            return
