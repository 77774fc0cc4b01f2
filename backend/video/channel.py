"""One live video from its source to whoever wants it: numbered frames, pictures, the last minute, health."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import av
import cv2
import numpy as np

from backend.clock import unix_us
from backend.video.decoder import PictureDecoder, image_from_jpeg
from backend.video.frames import DecodedFrame, EncodedFrame, VideoHealth, VideoUnit
from backend.video.identity import FrameMaker
from backend.video.jpeg import encode_jpeg
from backend.video.monitor import VideoMonitor
from backend.video.pictures import bgr_from_frame, grey_from_frame
from backend.video.ring import DEFAULT_SECONDS, FrameRing
from backend.video.source import Clock
from backend.video.sources import open_source
from backend.video.timing import ExposureClock, VehicleClockMap
from estimator.types import Image

_JOIN_S = 0.9
# Decoding is many times faster than the camera: who is behind by this much has been held up, and wants the newest.
_MOST_WAITING = 5
_MOST_WAITING_CODED = 50
_MOST_INSIDE = 32


@dataclass(frozen=True, slots=True)
class _Coded:
    """Work for the decoder: a frame, or a unit that has to be decoded before it can become one."""

    codec: str
    payload: bytes
    key: bool
    frame: EncodedFrame | None
    unit: VideoUnit
    generation: int


@dataclass(frozen=True, slots=True, eq=False)
class _Picture:
    """Work for the decoder: a picture that the source has decoded itself."""

    image: Image
    unit: VideoUnit


def _ignore(_: object) -> None:
    """Nobody wants it."""


def _never(_: EncodedFrame) -> bool:
    return False


class VideoChannel:
    """A video source with its threads: one receives, one decodes, and the second never holds up the first.

    ``on_encoded`` gets every usable frame at once, from the receiving thread, and must not block; for a video that no
    browser decodes (H.265, raw pictures, H.264 without key frames) it gets JPEG from the decoding thread.
    ``on_decoded`` gets grey pictures from the decoding thread; while it is slow, older pictures are dropped and it is
    given the newest. ``on_jpeg`` gets every decoded frame as JPEG too, while ``jpeg_wanted`` is true; ``on_colour``
    gets BGR pictures of the frames that ``wants_colour`` asks for, in the same thread.
    ``VideoSourceError`` for an address that cannot be used; everything else shows in `health`.
    """

    def __init__(
        self,
        url: str,
        *,
        on_encoded: Callable[[EncodedFrame], None] = _ignore,
        on_decoded: Callable[[DecodedFrame], None] = _ignore,
        on_jpeg: Callable[[EncodedFrame], None] = _ignore,
        on_colour: Callable[[DecodedFrame], None] = _ignore,
        wants_colour: Callable[[EncodedFrame], bool] = _never,
        map_vehicle_unix: VehicleClockMap | None = None,
        time_offset_s: float = 0.0,
        ring_seconds: float = DEFAULT_SECONDS,
        clock: Clock = unix_us,
    ) -> None:
        self.url = url
        self.ring = FrameRing(ring_seconds)
        self.jpeg_wanted = False
        self._on_encoded, self._on_decoded, self._on_jpeg = on_encoded, on_decoded, on_jpeg
        self._on_colour, self._wants_colour = on_colour, wants_colour
        self._clock = clock
        self._maker = FrameMaker(ExposureClock(map_vehicle_unix, round(time_offset_s * 1e6)))
        self._maker_lock = threading.Lock()
        self._monitor = VideoMonitor()
        self._decode_errors = 0
        self._dropped_pictures = 0
        self._generation = 0
        self._waiting: deque[_Coded | _Picture] = deque()
        self._work = threading.Condition()
        self._closing = False
        self._decoding = threading.Thread(target=self._decode_until_closed, name="VideoDecoder", daemon=True)
        self._source = open_source(url, self, clock)

    def start(self) -> None:
        """Begin; returns at once."""
        self._decoding.start()
        self._source.start()

    def close(self) -> None:
        """End both threads, normally within 0.2 s; waits no longer than 0.9 s for each, whatever a callback does."""
        with self._work:
            self._closing = True
            self._work.notify_all()
        self._source.close()
        if self._decoding.is_alive() and self._decoding is not threading.current_thread():
            self._decoding.join(_JOIN_S)

    @property
    def epoch(self) -> int:
        """Epoch of the newest frame."""
        return self._maker.epoch

    @property
    def dropped_pictures(self) -> int:
        """Pictures not handed to ``on_decoded`` because it was behind."""
        return self._dropped_pictures

    def health(self) -> VideoHealth:
        """How the video does now."""
        text = self._source.status
        if self._maker.waits_for_key and self._maker.left_out:
            text += "; waiting for a key frame"
        errors = self._decode_errors + self._maker.left_out
        return self._monitor.health(self._clock(), text, self._maker.epoch, errors)

    # What the source calls (`SourceOutput`).

    def unit(self, unit: VideoUnit) -> None:
        """Take a coded picture; from the source's thread."""
        if unit.codec == "hevc" or (unit.codec == "h264" and self._maker.never_keyed):
            self._queue(_Coded(unit.codec, unit.payload, False, None, unit, self._generation))
            return
        with self._maker_lock:
            frame = self._maker.frame(unit)
        if frame is not None:
            self._hand_on(frame)
            self._queue(_Coded(frame.codec, frame.payload, frame.key, frame, unit, self._generation))

    def picture(self, image: Image, pts_us: int | None, t_wire_us: int) -> None:
        """Take a picture that the source has decoded; from the source's thread."""
        self._queue(_Picture(image, VideoUnit("raw", b"", pts_us, t_wire_us)))

    def interrupted(self) -> None:
        """Begin a new epoch; from the source's thread."""
        with self._maker_lock:
            self._maker.restart()
        self._generation += 1

    def _hand_on(self, frame: EncodedFrame) -> None:
        self.ring.append(frame)
        self._monitor.arrived(frame, self._clock())
        if not self._closing:
            self._on_encoded(frame)

    def _queue(self, work: _Coded | _Picture) -> None:
        with self._work:
            self._waiting.append(work)
            if len(self._waiting) > _MOST_WAITING_CODED:
                self._drop_groups()
            self._work.notify()

    def _drop_groups(self) -> None:
        """Drop what waits before the last key frame; what has none is dropped from the front as it comes."""
        keys = [n for n, w in enumerate(self._waiting) if isinstance(w, _Picture) or w.key]
        count = keys[-1] if keys else 0
        for _ in range(count):
            self._waiting.popleft()
        self._dropped_pictures += count
        while len(self._waiting) > 4 * _MOST_WAITING_CODED:
            self._waiting.popleft()
            self._dropped_pictures += 1

    def _decode_until_closed(self) -> None:
        streams = _Streams()
        while True:
            with self._work:
                while not self._waiting and not self._closing:
                    self._work.wait()
                if self._closing:
                    return
                work = self._waiting.popleft()
                behind = len(self._waiting) >= _MOST_WAITING
            if isinstance(work, _Picture):
                self._transcode(work.image, work.unit)
            elif work.codec == "jpeg":
                self._show_jpeg(work, behind=behind)
            else:
                for shown, picture in streams.decode(work):
                    self._show_decoded(shown, picture, behind=behind)
                self._decode_errors += streams.take_errors()

    def _show_decoded(self, shown: _Coded, picture: av.VideoFrame, *, behind: bool) -> None:
        if shown.frame is None:
            self._transcode(bgr_from_frame(picture), shown.unit)
        elif behind:
            self._dropped_pictures += 1
        else:
            self._show(shown.frame, grey_from_frame(picture))
            wanted = self._wants_colour(shown.frame)
            if self.jpeg_wanted or wanted:
                colour = bgr_from_frame(picture)
                if self.jpeg_wanted:
                    self._show_as_jpeg(shown.frame, colour)
                if wanted:
                    self._show_colour(shown.frame, colour)

    def _show(self, frame: EncodedFrame, grey: Image) -> None:
        self._monitor.decoded(grey, frame.t_wire_us, self._clock())
        if not self._closing:
            self._on_decoded(DecodedFrame(frame.frame_id, frame.epoch, frame.t_us, grey, frame.stamped))

    def _show_jpeg(self, work: _Coded, *, behind: bool) -> None:
        if work.frame is None or behind:
            self._dropped_pictures += 1
            return
        grey = image_from_jpeg(work.payload, colour=False)
        if grey is None:
            self._decode_errors += 1
            return
        self._show(work.frame, grey)
        if self.jpeg_wanted:
            self._on_jpeg(work.frame)
        if self._wants_colour(work.frame):
            colour = image_from_jpeg(work.payload, colour=True)
            if colour is not None:
                self._show_colour(work.frame, colour)

    def _show_colour(self, frame: EncodedFrame, colour: Image) -> None:
        if not self._closing:
            self._on_colour(DecodedFrame(frame.frame_id, frame.epoch, frame.t_us, colour, frame.stamped))

    def _show_as_jpeg(self, frame: EncodedFrame, colour: Image) -> None:
        jpeg = EncodedFrame(
            frame.frame_id, frame.epoch, frame.t_us, frame.t_wire_us, "jpeg", "jpeg", True, frame.width, frame.height,
            encode_jpeg(colour), frame.stamped,
        )  # fmt: skip
        if not self._closing:
            self._on_jpeg(jpeg)

    def _transcode(self, colour: Image, unit: VideoUnit) -> None:
        rows, columns = colour.shape[:2]
        jpeg = encode_jpeg(colour)
        with self._maker_lock:
            frame = self._maker.transcoded(jpeg, (columns, rows), self._maker.exposure_us(unit), unit)
        self._hand_on(frame)
        if self.jpeg_wanted:
            self._on_jpeg(frame)
        self._show(frame, cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False))
        if self._wants_colour(frame):
            self._show_colour(frame, colour)


class _Streams:
    """The decoder of the present stream, and which work each of its pictures belongs to."""

    def __init__(self) -> None:
        self._decoder: PictureDecoder | None = None
        self._made_for: tuple[str, int, int] | None = None
        self._inside: dict[int, _Coded] = {}
        self._count = 0
        self._errors = 0

    def decode(self, work: _Coded) -> list[tuple[_Coded, av.VideoFrame]]:
        """Pictures that come out with this work, each with its own; another stream gets another decoder."""
        made_for = (work.codec, work.generation, work.frame.epoch if work.frame is not None else 0)
        if self._decoder is None or made_for != self._made_for:
            self._decoder, self._made_for = PictureDecoder(work.codec), made_for
            self._inside.clear()
        self._count += 1
        self._inside[self._count] = work
        self._inside.pop(self._count - _MOST_INSIDE, None)  # it never came out
        before = self._decoder.errors
        pictures = self._decoder.decode(work.payload, self._count)
        self._errors += self._decoder.errors - before
        return [(self._inside.pop(number), picture) for number, picture in pictures if number in self._inside]

    def take_errors(self) -> int:
        """Errors since the last call."""
        errors, self._errors = self._errors, 0
        return errors
