"""A flight's recorded video: a file, or a folder of numbered pictures, frame by frame with exact numbers."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np

from backend.video.annexb import ParameterSets, is_key
from backend.video.errors import FrameNotFoundError, RecordedVideoError, UndecodableFrameError
from backend.video.jpeg import encode_jpeg, jpeg_size_px
from backend.video.pictures import bgr_from_frame, grey_from_frame
from estimator.types import Image

PICTURE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"})
_SEEK_ATTEMPTS = 4
_TRAILING_NUMBER = re.compile(r"(\d+)$")


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrame:
    """One decoded picture.

    ``index`` counts pictures in the order they are shown, from 0 (for a folder: the number in the file's name), and
    stays right where damaged pictures are missing. ``pts_s`` is seconds after the file's first picture, NaN for a
    folder, which has no clock. ``image`` is (rows, columns) grey or (rows, columns, 3) BGR.
    """

    index: int
    pts_s: float
    image: Image


@dataclass(frozen=True, slots=True)
class RecordedPacket:
    """One coded picture, ready for a browser: H.264 with start codes and parameter sets before key frames, or JPEG.

    ``index`` and ``pts_s`` as in `RecordedFrame`. Packets come in decoding order.
    """

    index: int
    pts_s: float
    codec: str
    codec_string: str
    key: bool
    width_px: int
    height_px: int
    payload: bytes


class RecordedVideo(ABC):
    """A recorded video, whatever it is stored in; `RecordedVideo.open` makes one.

    Every iteration opens the file afresh, so several may run at once. ``codec`` is FFmpeg's name, or "images".
    ``first_index`` and ``last_index`` bound the ``frame_count`` pictures. ``decode_errors`` counts what could not be
    decoded so far; the rest goes on.
    """

    path: Path
    width_px: int
    height_px: int
    codec: str
    first_index: int
    last_index: int
    frame_count: int
    decode_errors: int

    @staticmethod
    def open(path: Path) -> RecordedVideo:
        """Open a video file or a folder of numbered pictures.

        Raises
        ------
        RecordedVideoError
            Nothing is there, or nothing in it can be read as video.
        """
        if path.is_dir():
            return PictureFolder(path)
        if not path.exists():
            raise RecordedVideoError(path, "no such file or folder")
        return VideoFile(path)

    @abstractmethod
    def frames(self, start_index: int = 0, *, colour: bool = False) -> Iterator[RecordedFrame]:
        """Pictures from ``start_index`` on, in order."""

    @abstractmethod
    def packets(self, start_index: int = 0) -> Iterator[RecordedPacket]:
        """Coded pictures from the key frame at or before ``start_index`` on; anything but H.264 becomes JPEG."""

    @abstractmethod
    def frame(self, index: int, *, colour: bool = True) -> RecordedFrame:
        """One picture; `FrameNotFoundError` or `UndecodableFrameError` where there is none."""

    @abstractmethod
    def jpeg(self, index: int) -> bytes:
        """One picture as JPEG; errors as for `frame`."""


class VideoFile(RecordedVideo):
    """A recorded video in a container that FFmpeg reads (mp4, ts, mkv, avi, ...)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.decode_errors = 0
        if path.stat().st_size == 0:
            raise RecordedVideoError(path, "the file is empty")
        with self._opened() as (container, stream):
            self.width_px = stream.codec_context.width
            self.height_px = stream.codec_context.height
            self.codec = stream.codec_context.name
            order = _scan(container, stream)
        if not order.count:
            raise RecordedVideoError(path, "it holds no pictures; the recording may have been cut off at once")
        self._order = order
        self.first_index = 0
        self.frame_count = order.count
        self.last_index = self.frame_count - 1

    def frames(self, start_index: int = 0, *, colour: bool = False) -> Iterator[RecordedFrame]:
        """Pictures from ``start_index`` on, in order; see `RecordedVideo`."""
        convert = bgr_from_frame if colour else grey_from_frame
        for index, pts_s, frame in self._decoded(start_index):
            yield RecordedFrame(index, pts_s, convert(frame))

    def packets(self, start_index: int = 0) -> Iterator[RecordedPacket]:
        """Coded pictures from the key frame at or before ``start_index`` on; see `RecordedVideo`."""
        if self.codec == "h264":
            return self._h264_packets(start_index)
        return self._jpeg_packets(start_index)

    def frame(self, index: int, *, colour: bool = True) -> RecordedFrame:
        """One picture; see `RecordedVideo`."""
        if not 0 <= index < self.frame_count:
            raise FrameNotFoundError(index, 0, self.last_index)
        found = next(self.frames(index, colour=colour), None)
        if found is None or found.index != index:
            raise UndecodableFrameError(index)
        return found

    def jpeg(self, index: int) -> bytes:
        """One picture as JPEG; see `RecordedVideo`."""
        return encode_jpeg(self.frame(index).image)

    def _decoded(self, start_index: int) -> Iterator[tuple[int, float, av.VideoFrame]]:
        counter = -1
        for packet in self._from_key(start_index):
            try:
                decoded = packet.decode()
            except av.FFmpegError:
                self.decode_errors += 1
                continue
            for frame in decoded:
                counter += 1
                index = self._order.index(frame.pts, counter)
                if index is not None and index >= start_index:
                    yield index, self._order.pts_s(frame.pts), frame

    def _h264_packets(self, start_index: int) -> Iterator[RecordedPacket]:
        sets = ParameterSets()
        to_annexb: av.BitStreamFilterContext | None = None
        counter = -1
        for packet in self._from_key(start_index):
            if packet.size == 0:
                continue
            try:
                to_annexb = to_annexb or av.BitStreamFilterContext("h264_mp4toannexb", packet.stream)
                filtered = to_annexb.filter(packet)
            except av.FFmpegError:
                self.decode_errors += 1
                continue
            for part in filtered:
                counter += 1
                index = self._order.index(part.pts, counter)
                payload = sets.complete(bytes(part))
                if index is None or sets.sequence is None:
                    continue
                yield RecordedPacket(
                    index,
                    self._order.pts_s(part.pts),
                    "h264",
                    sets.sequence.codec_string,
                    is_key(payload),
                    sets.sequence.width_px,
                    sets.sequence.height_px,
                    payload,
                )

    def _jpeg_packets(self, start_index: int) -> Iterator[RecordedPacket]:
        for frame in self.frames(start_index, colour=True):
            rows, columns = frame.image.shape[:2]
            yield RecordedPacket(
                frame.index, frame.pts_s, "jpeg", "jpeg", True, columns, rows, encode_jpeg(frame.image)
            )

    def _from_key(self, start_index: int) -> Iterator[av.Packet[av.VideoStream]]:
        """Packets from the key frame that ``start_index`` leans on, or all where pictures can only be counted."""
        order = self._order
        if order.index_of_pts is None or start_index <= 0:
            with self._opened() as (container, stream):
                yield from _demuxed(container, stream)
            return
        keys = order.key_pts_up_to(start_index)
        with self._opened() as (container, stream):
            found = self._sought(container, stream, keys)
            if found:
                yield from _from(keys[-1], container, stream)
        if not found:
            with self._opened() as (container, stream):
                yield from _from(keys[-1], container, stream)

    def _sought(self, container: av.container.InputContainer, stream: av.VideoStream, keys: list[int]) -> bool:
        """Seek to before the last of ``keys``; False where the container cannot, and then it has to be read through."""
        # Containers seek by decoding time, some only roughly: step back until the wanted key frame lies ahead.
        for pts in reversed(keys[-_SEEK_ATTEMPTS:]):
            try:
                container.seek(pts, stream=stream, backward=True)
                ahead = next((p.pts for p in _demuxed(container, stream) if p.pts is not None), None)
                if ahead is not None and self._order.decoded_before(ahead, keys[-1]):
                    container.seek(pts, stream=stream, backward=True)
                    return True
            except av.FFmpegError:
                return False
        return False

    def _opened(self) -> _Opened:
        return _Opened(self.path)


class PictureFolder(RecordedVideo):
    """Pictures named by their frame number, such as ``frames/000123.jpg``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.decode_errors = 0
        self.codec = "images"
        self._files = _numbered_pictures(path)
        if not self._files:
            raise RecordedVideoError(path, "the folder holds no pictures named by frame number (such as 000123.jpg)")
        self.first_index, self.last_index = min(self._files), max(self._files)
        self.frame_count = len(self._files)
        first = next(self.frames(), None)
        if first is None:
            raise RecordedVideoError(path, f"none of its {self.frame_count} pictures can be read")
        self.decode_errors = 0
        self.height_px, self.width_px = first.image.shape[:2]

    def frames(self, start_index: int = 0, *, colour: bool = False) -> Iterator[RecordedFrame]:
        """Pictures from number ``start_index`` on, in order of their numbers; see `RecordedVideo`."""
        for index in self._indices(start_index):
            image = _read_picture(self._files[index], colour=colour)
            if image is None:
                self.decode_errors += 1
            else:
                yield RecordedFrame(index, float("nan"), image)

    def packets(self, start_index: int = 0) -> Iterator[RecordedPacket]:
        """Pictures as JPEG: those stored as JPEG unchanged, others coded anew."""
        for index in self._indices(start_index):
            try:
                payload = self.jpeg(index)
                width, height = jpeg_size_px(payload)
            except (UndecodableFrameError, ValueError):
                self.decode_errors += 1
                continue
            yield RecordedPacket(index, float("nan"), "jpeg", "jpeg", True, width, height, payload)

    def frame(self, index: int, *, colour: bool = True) -> RecordedFrame:
        """One picture; see `RecordedVideo`."""
        if index not in self._files:
            raise FrameNotFoundError(index, self.first_index, self.last_index)
        image = _read_picture(self._files[index], colour=colour)
        if image is None:
            raise UndecodableFrameError(index)
        return RecordedFrame(index, float("nan"), image)

    def jpeg(self, index: int) -> bytes:
        """One picture as JPEG; see `RecordedVideo`."""
        file = self._files.get(index)
        if file is not None and file.suffix.lower() in (".jpg", ".jpeg"):
            return file.read_bytes()
        return encode_jpeg(self.frame(index).image)

    def _indices(self, start_index: int) -> list[int]:
        return sorted(i for i in self._files if i >= start_index)


@dataclass(frozen=True, slots=True)
class _Order:
    """Which picture has which number.

    ``index_of_pts`` ranks pictures by presentation time; None where the file's times are missing or repeat, and then
    pictures are numbered by counting. ``pts`` are the times in order, ``key_pts`` those of key frames, and ``decoded``
    says when in the file each comes.
    """

    index_of_pts: dict[int, int] | None
    pts: list[int]
    key_pts: list[int]
    decoded: dict[int, int]
    count: int
    seconds_per_tick: float

    def index(self, pts: int | None, counter: int) -> int | None:
        if self.index_of_pts is None:
            return counter
        return None if pts is None else self.index_of_pts.get(pts)

    def pts_s(self, pts: int | None) -> float:
        if pts is None or not self.pts:
            return float("nan")
        return (pts - self.pts[0]) * self.seconds_per_tick

    def key_pts_up_to(self, index: int) -> list[int]:
        """Times of key frames at or before a picture, the nearest last; the first of the file when there is none."""
        wanted = self.pts[min(index, len(self.pts) - 1)]
        return self.key_pts[: bisect_right(self.key_pts, wanted)] or [min(self.decoded, key=lambda p: self.decoded[p])]

    def decoded_before(self, pts: int, other_pts: int) -> bool:
        """Whether the picture at ``pts`` is at or before the other in the file."""
        return self.decoded.get(pts, self.count) <= self.decoded[other_pts]


class _Opened:
    """A container and its first video stream, closed at the end of the ``with``."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> tuple[av.container.InputContainer, av.VideoStream]:
        try:
            self._container = av.open(str(self._path), mode="r", metadata_errors="ignore")
        except (av.FFmpegError, OSError) as error:
            raise RecordedVideoError(self._path, f"it cannot be read as video ({_reason(error)})") from error
        if not self._container.streams.video:
            self._container.close()
            raise RecordedVideoError(self._path, "it holds no video stream")
        stream = self._container.streams.video[0]
        # One thread keeps runs repeatable and leaves the other core to the estimator; H.264 at 640x480 still decodes
        # at well over 400 pictures a second.
        stream.codec_context.thread_count = 1
        return self._container, stream

    def __exit__(self, *_: object) -> None:
        self._container.close()


def _demuxed(container: av.container.InputContainer, stream: av.VideoStream) -> Iterator[av.Packet[av.VideoStream]]:
    """Packets up to the end, or up to where a damaged file cannot be read further; ends with the flushing packet."""
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except av.FFmpegError:
            return
        if packet is None:
            return
        yield packet


def _from(
    pts: int, container: av.container.InputContainer, stream: av.VideoStream
) -> Iterator[av.Packet[av.VideoStream]]:
    """Packets from the one shown at ``pts`` on."""
    started = False
    for packet in _demuxed(container, stream):
        started = started or packet.pts == pts
        if started:
            yield packet


def _scan(container: av.container.InputContainer, stream: av.VideoStream) -> _Order:
    """Number the pictures of a file by reading its packets, without decoding."""
    found = [(p.pts, p.is_keyframe) for p in _demuxed(container, stream) if p.size and not p.is_discard]
    seconds_per_tick = float(stream.time_base or 0)
    decoded = {pts: n for n, (pts, _) in enumerate(found) if pts is not None}
    pts = sorted(decoded)
    return _Order(
        {p: index for index, p in enumerate(pts)} if len(pts) == len(found) else None,
        pts,
        sorted(p for p, key in found if key and p is not None),
        decoded,
        len(found),
        seconds_per_tick,
    )


def _numbered_pictures(folder: Path) -> dict[int, Path]:
    files: dict[int, Path] = {}
    for file in sorted(folder.iterdir()):
        number = _TRAILING_NUMBER.search(file.stem)
        if file.suffix.lower() not in PICTURE_SUFFIXES or number is None:
            continue
        index = int(number.group(1))
        if index in files:
            raise RecordedVideoError(folder, f"{files[index].name} and {file.name} both are frame {index}")
        files[index] = file
    return files


def _read_picture(file: Path, *, colour: bool) -> Image | None:
    data = np.frombuffer(file.read_bytes(), np.uint8)
    if data.size == 0:
        return None
    image = cv2.imdecode(data, cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE)
    return None if image is None else image.astype(np.uint8, copy=False)


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
