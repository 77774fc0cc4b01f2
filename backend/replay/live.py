"""``pilotage replay --live``: plays a flight folder into a running station, as an aircraft would send it.

MAVLink goes over UDP packet by packet as recorded, video as MPEG-TS over UDP, each when it was received or taken in the
flight. The station estimates anew; recorded clicks and estimates are not sent. GPS is sent all the time, as a receiver
would: that it be kept from the estimator is asked of the station.
"""

from __future__ import annotations

import heapq
import socket
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from fractions import Fraction
from types import TracebackType
from typing import Self

import av
import cv2
import numpy as np

from backend.errors import StationError
from backend.link.tlog import running_forward
from backend.replay.denial import GROUND_STATION_IDS, denied_spans, sender_and_message
from backend.video.annexb import is_key
from backend.video.frames import EncodedFrame
from backend.video.recorded import RecordedVideo
from backend.video.writer import TsWriter
from geodata.flight import FlightFolder

TS_DATAGRAM_BYTES = 7 * 188  # seven packets fit into an Ethernet frame
KEY_EVERY = 25
_TICKS_PER_S = 90_000


@dataclass(frozen=True, slots=True)
class Moment:
    """Something to send: a MAVLink packet, or a frame; or from when GPS is denied or not. On the flight's clock."""

    t_us: int
    packet: bytes | None = None
    frame: EncodedFrame | None = None
    gps_denied: bool | None = None


def moments(folder: FlightFolder, start_s: float = 0.0) -> Iterator[Moment]:
    """Everything to send, in order of time, from ``start_s`` after the telemetry's beginning on.

    Video begins at a key frame. Pictures without a time go along with their predecessors, since those after them are
    decoded from them.
    """
    from_us = folder.telemetry_span()[0] + round(start_s * 1e6)
    merged = heapq.merge(_denials(folder, from_us), _packets(folder), _frames(folder), key=lambda moment: moment.t_us)
    begun = False
    for moment in merged:
        if moment.t_us < from_us:
            continue
        if moment.frame is not None and not begun:
            if not moment.frame.key:
                continue
            begun = True
        yield moment


def play(
    schedule: Iterable[Moment], send_packet: Callable[[bytes], None], send_frame: Callable[[EncodedFrame], None],
    wait_until: Callable[[int], None], told: Callable[[int], None] = lambda _: None,
    deny_gps: Callable[[bool], None] = lambda _: None,
) -> int:  # fmt: skip
    """Send everything in its time; ``wait_until(us)`` waits for a time after the first moment.

    Returns how many packets and frames were sent.
    """
    first_us: int | None = None
    count = 0
    for moment in schedule:
        first_us = moment.t_us if first_us is None else first_us
        # What a relay swapped is sent at once.
        wait_until(max(moment.t_us - first_us, 0))
        if moment.gps_denied is not None:
            deny_gps(moment.gps_denied)
            continue
        if moment.packet is not None:
            send_packet(moment.packet)
        if moment.frame is not None:
            send_frame(moment.frame)
        count += 1
        told(moment.t_us)
    return count


class Downlink:
    """The two UDP ports of a station, as an aircraft sees them. Nobody there is no error: no radio can tell."""

    def __init__(self, mavlink: tuple[str, int], video: tuple[str, int] | None) -> None:
        with ExitStack() as opening:
            self._mavlink = opening.enter_context(_connected(mavlink))
            self._ts = None
            if video is not None:
                self._ts = TsWriter(_Datagrams(opening.enter_context(_connected(video))))
            self._opened = opening.pop_all()

    def send_packet(self, packet: bytes) -> None:
        """Send a MAVLink packet, and drop what the station says to an aircraft that cannot listen."""
        with suppress(ConnectionRefusedError, BlockingIOError):
            self._mavlink.send(packet)
        with suppress(ConnectionRefusedError, BlockingIOError):
            while self._mavlink.recv(65_536):
                pass

    def send_frame(self, frame: EncodedFrame) -> None:
        """Send a frame."""
        if self._ts is not None:
            self._ts.write(frame)
            self._ts.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._ts is not None:
            self._ts.close()
        self._opened.close()


class _Datagrams:
    """Cuts a stream into datagrams of whole transport packets."""

    def __init__(self, out: socket.socket) -> None:
        self._out = out
        self._waiting = bytearray()

    def write(self, data: bytes, /) -> int:
        self._waiting += data
        while len(self._waiting) >= TS_DATAGRAM_BYTES:
            self._send(TS_DATAGRAM_BYTES)
        return len(data)

    def flush(self) -> None:
        if self._waiting:
            self._send(len(self._waiting))

    def close(self) -> None:
        self.flush()

    def _send(self, size: int) -> None:
        with suppress(ConnectionRefusedError, BlockingIOError):
            self._out.send(bytes(self._waiting[:size]))
        del self._waiting[:size]


def _connected(address: tuple[str, int]) -> socket.socket:
    try:
        (family, _, _, _, target), *_ = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)
        out = socket.socket(family, socket.SOCK_DGRAM)
        out.connect(target)
        out.setblocking(False)
    except OSError as error:
        raise StationError(f"cannot send to {address[0]} port {address[1]}: {error.strerror or error}") from None
    return out


def _denials(folder: FlightFolder, from_us: int) -> Iterator[Moment]:
    for start_us, end_us in denied_spans(folder):
        if end_us > from_us:
            yield Moment(max(start_us, from_us), gps_denied=True)
            yield Moment(end_us, gps_denied=False)


def _packets(folder: FlightFolder) -> Iterator[Moment]:
    wanted = folder.meta.vehicle.system_id
    entries = running_forward(folder.telemetry(), lambda what: folder.warn(f"{folder.telemetry_path}: {what}"))
    for t_us, packet in entries:
        sender, _ = sender_and_message(packet)
        if sender == wanted or (wanted is None and sender not in GROUND_STATION_IDS):
            yield Moment(t_us, packet=packet)


def _frames(folder: FlightFolder) -> Iterator[Moment]:
    if folder.video_path is None:
        return
    video = RecordedVideo.open(folder.video_path)
    # Bidirectional frames come before those they are shown after: a live encoder does not send such.
    is_live = video.codec == "h264" and _rises(packet.index for packet in video.packets())
    last_us: int | None = None
    for frame in _passed_on(video) if is_live else _encoded(video):
        pts_s = None if np.isnan(frame.pts_s) else frame.pts_s
        known_us = folder.frame_time_us(frame.index, pts_s)
        t_us = last_us if known_us is None else known_us + (folder.time_offset_us or 0)
        if t_us is None:
            continue
        last_us = t_us if last_us is None else max(t_us, last_us)
        size = frame.size_px
        yield Moment(
            last_us,
            frame=EncodedFrame(
                frame.index, 1, last_us, last_us, "h264", "", frame.key, size[0], size[1], frame.payload
            ),
        )


@dataclass(frozen=True, slots=True)
class _Coded:
    index: int
    pts_s: float
    key: bool
    size_px: tuple[int, int]
    payload: bytes


def _passed_on(video: RecordedVideo) -> Iterator[_Coded]:
    for packet in video.packets():
        yield _Coded(packet.index, packet.pts_s, packet.key, (packet.width_px, packet.height_px), packet.payload)


def _encoded(video: RecordedVideo) -> Iterator[_Coded]:
    """Pictures coded anew, each at once, with a key frame a second; of other sizes than the first's are left out."""
    width, height = video.width_px // 2 * 2, video.height_px // 2 * 2
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = width, height, "yuv420p"
    encoder.time_base = Fraction(1, _TICKS_PER_S)
    encoder.thread_count = 1
    x264 = f"keyint={KEY_EVERY}:min-keyint={KEY_EVERY}:scenecut=0:bframes=0:repeat-headers=1:threads=1"
    encoder.options = {"preset": "veryfast", "tune": "zerolatency", "crf": "20", "x264-params": x264}
    for count, frame in enumerate(video.frames(colour=True)):
        if frame.image.shape[:2] != (video.height_px, video.width_px):
            continue
        planar = cv2.cvtColor(np.ascontiguousarray(frame.image[:height, :width]), cv2.COLOR_BGR2YUV_I420)
        picture = av.VideoFrame.from_ndarray(np.asarray(planar, dtype=np.uint8), format="yuv420p")
        picture.pts = count
        payload = b"".join(bytes(packet) for packet in encoder.encode(picture))
        if payload:
            yield _Coded(frame.index, frame.pts_s, is_key(payload), (width, height), payload)


def _rises(numbers: Iterable[int]) -> bool:
    last = -1
    for number in numbers:
        if number <= last:
            return False
        last = number
    return True
