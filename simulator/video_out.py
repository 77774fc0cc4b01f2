"""Video out of the simulated aircraft: H.264 in MPEG-TS over UDP, and an mp4 for recorded flights."""

from __future__ import annotations

import socket
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import cv2
import numpy as np

from estimator.types import Image
from simulator.misp_stamp import stamped

TS_PACKET_BYTES = 188
# Seven TS packets fit an Ethernet frame; every receiver expects this size.
DATAGRAM_BYTES = 7 * TS_PACKET_BYTES
_TICKS_PER_S = 90_000
_SEND_BUFFER_BYTES = 1 << 20


class H264TsSender:
    """Encode pictures and send each at once: nothing in the stream waits for the next picture.

    One key frame a second with parameter sets in front. Every picture carries its exposure time as a MISP time stamp,
    and its PTS is the same time in 90 kHz ticks after the first picture's. ``send_errors`` counts datagrams that the
    network refused.
    """

    def __init__(
        self, host: str, port: int, width: int, height: int, fps: float = 25.0, bitrate: int = 2_000_000
    ) -> None:
        self._address = (host, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        context = av.CodecContext.create("libx264", "w")
        self._encoder = _Encoder(context, width, height, fps, bitrate, {"preset": "ultrafast", "tune": "zerolatency"})
        self._mux = _TransportStream(fps)
        self._clock = _PictureClock()
        self.send_errors = 0

    def send(self, image: Image, t_unix_us: int) -> int:
        """Encode a picture, grey (height, width) or BGR (height, width, 3), taken at ``t_unix_us``, and send it.

        Returns the number of datagrams. Both the picture's size and rising times are required: `ValueError`.
        """
        ticks = self._clock.ticks(t_unix_us)
        stream = b"".join(
            self._mux.packetise(stamped(bytes(packet), t_unix_us), ticks, key=packet.is_keyframe)
            for packet in self._encoder.encode(image, ticks)
        )
        datagrams = [stream[at : at + DATAGRAM_BYTES] for at in range(0, len(stream), DATAGRAM_BYTES)]
        for datagram in datagrams:
            try:
                self._socket.sendto(datagram, self._address)
            except OSError:
                # A receiver or a network that is not there yet must not stop the flight.
                self.send_errors += 1
        return len(datagrams)

    def close(self) -> None:
        """Release the encoder and the socket."""
        self._mux.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class H264FileWriter:
    """Write pictures into an mp4, each at its exposure time after the first picture's.

    The same pictures give the same file. No reordering: the n-th picture written is the n-th shown.
    """

    def __init__(self, path: Path, width: int, height: int, fps: float = 25.0, bitrate: int = 4_000_000) -> None:
        self._clock = _PictureClock()
        self._container = av.open(str(path), "w", format="mp4", options={"video_track_timescale": str(_TICKS_PER_S)})
        self._stream = self._container.add_stream("libx264", rate=_rate(fps))
        self._encoder = _Encoder(
            self._stream.codec_context, width, height, fps, bitrate, {"preset": "veryfast"}, repeat_headers=False
        )

    def write(self, image: Image, t_unix_us: int) -> None:
        """Append a picture, as for `H264TsSender.send`."""
        self._mux(self._encoder.encode(image, self._clock.ticks(t_unix_us)))

    def close(self) -> None:
        """Write what the encoder still holds and the file's index; the file cannot be played before."""
        self._mux(self._encoder.flush())
        self._container.close()

    def _mux(self, packets: list[av.Packet[av.VideoStream]]) -> None:
        for packet in packets:
            packet.stream = self._stream
            self._container.mux(packet)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _rate(fps: float) -> Fraction:
    return Fraction(fps).limit_denominator(1001)


class _PictureClock:
    """Ticks of 90 kHz after the first picture; refuses times that do not rise by at least one tick."""

    def __init__(self) -> None:
        self._first_us: int | None = None
        self._last_ticks = -1

    def ticks(self, t_unix_us: int) -> int:
        if self._first_us is None:
            self._first_us = t_unix_us
        ticks = (t_unix_us - self._first_us) * 9 // 100
        if ticks <= self._last_ticks:
            raise ValueError(f"picture at {t_unix_us} us is not later than the one before it")
        self._last_ticks = ticks
        return ticks


class _Encoder:
    """libx264 without reordering; one thread, so the same pictures give the same bytes."""

    def __init__(
        self,
        context: av.VideoCodecContext,
        width: int,
        height: int,
        fps: float,
        bitrate: int,
        options: dict[str, str],
        *,
        repeat_headers: bool = True,
    ) -> None:
        if width % 2 or height % 2:
            raise ValueError(f"picture of {width} x {height}: H.264 with 4:2:0 colour needs even sides")
        self._shape = (height, width)
        context.width, context.height = width, height
        context.pix_fmt = "yuv420p"
        context.framerate = _rate(fps)
        context.time_base = Fraction(1, _TICKS_PER_S)
        context.bit_rate = bitrate
        context.thread_count = 1
        interval = max(1, round(fps))
        x264 = f"keyint={interval}:min-keyint={interval}:scenecut=0:bframes=0:threads=1"
        x264 += f":repeat-headers={int(repeat_headers)}"
        # Half a second of buffer keeps a key frame from taking the link for itself.
        x264 += f":vbv-maxrate={bitrate // 1000}:vbv-bufsize={max(1, bitrate // 2000)}"
        context.options = {**options, "x264-params": x264}
        context.open()
        self._context = context

    def encode(self, image: Image, ticks: int) -> list[av.Packet[av.VideoStream]]:
        if image.dtype != np.uint8 or image.shape not in (self._shape, (*self._shape, 3)):
            raise ValueError(f"picture is {image.dtype} {image.shape}, expected uint8 {self._shape}, or the same by 3")
        colour = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        planar = np.asarray(cv2.cvtColor(colour, cv2.COLOR_BGR2YUV_I420), dtype=np.uint8)
        frame = av.VideoFrame.from_ndarray(planar, format="yuv420p")
        frame.pts = ticks
        frame.time_base = Fraction(1, _TICKS_PER_S)
        return self._context.encode(frame)

    def flush(self) -> list[av.Packet[av.VideoStream]]:
        return self._context.encode(None)


class _TransportStream:
    """FFmpeg's MPEG-TS writer, one access unit in, its packets out at once."""

    def __init__(self, fps: float) -> None:
        self._out = _Collector()
        # With its length stated, a PES packet ends when its last byte arrives; FFmpeg omits video's by default.
        options = {"omit_video_pes_length": "0", "flush_packets": "1"}
        self._container = av.open(self._out, "w", format="mpegts", options=options)
        self._stream = self._container.add_mux_stream("h264", rate=_rate(fps))
        self._stream.time_base = Fraction(1, _TICKS_PER_S)

    def packetise(self, access_unit: bytes, ticks: int, *, key: bool) -> bytes:
        packet = av.Packet(access_unit)
        packet.pts = packet.dts = ticks
        packet.time_base = Fraction(1, _TICKS_PER_S)
        packet.is_keyframe = key
        packet.stream = self._stream
        self._container.mux(packet)
        return self._out.take()

    def close(self) -> None:
        self._container.close()


class _Collector:
    """The file that FFmpeg writes to."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def take(self) -> bytes:
        taken = b"".join(self._parts)
        self._parts.clear()
        return taken
