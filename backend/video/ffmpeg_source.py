"""Video through FFmpeg: RTSP and cameras of this machine."""

from __future__ import annotations

from pathlib import Path

import av
from av.video.stream import VideoStream

from backend.video.frames import VideoUnit
from backend.video.pictures import bgr_from_frame
from backend.video.source import Clock, Gone, SourceOutput, VideoSource

_PASSED_ON = {"h264": "h264", "hevc": "hevc", "mjpeg": "jpeg"}


class FfmpegSource(VideoSource):
    """One input that FFmpeg opens; opened again whenever it ends.

    FFmpeg cannot be interrupted from outside, so a close may leave its thread behind for at most ``timeout_s``; it
    delivers nothing by then.
    """

    def __init__(
        self,
        address: str,
        words: str,
        output: SourceOutput,
        clock: Clock,
        *,
        container_format: str | None = None,
        options: dict[str, str] | None = None,
        timeout_s: float = 4.0,
    ) -> None:
        super().__init__(output, clock)
        self._address = address
        self._words = words
        self._format = container_format
        self._options = options or {}
        self._timeout_s = timeout_s
        self.status = f"waiting for {words}: opening"

    def session(self) -> None:
        """See `VideoSource`."""
        try:
            container = av.open(
                self._address, "r", format=self._format, options=dict(self._options), timeout=self._timeout_s
            )
        except (av.FFmpegError, ValueError) as error:
            raise Gone(f"waiting for {self._words}: cannot connect ({_reason(error)}); trying again") from error
        with container:
            if not container.streams.video:
                raise Gone(f"{self._words} holds no video; trying again")
            try:
                self._read(container, container.streams.video[0])
            except (av.FFmpegError, ValueError) as error:
                raise Gone(f"waiting for {self._words}: it stopped ({_reason(error)}); trying again") from error
        raise Gone(f"waiting for {self._words}: it ended; trying again")

    def _read(self, container: av.container.InputContainer, stream: VideoStream) -> None:
        codec = _PASSED_ON.get(stream.codec_context.name)
        stream.codec_context.thread_count = 1
        to_bytes = _byte_stream_filter(stream)
        self.status = f"receiving {self._words}"
        for packet in container.demux(stream):
            if self.stopping.is_set():
                return
            if packet.size == 0:
                continue
            t_wire_us = self.clock()
            pts_us = None if packet.pts is None else int(packet.pts * packet.time_base * 1_000_000)
            if codec is None:
                for frame in packet.decode():
                    self.output.picture(bgr_from_frame(frame), pts_us, t_wire_us)
                continue
            for part in [packet] if to_bytes is None else to_bytes.filter(packet):
                self.deliver(VideoUnit(codec, bytes(part), pts_us, t_wire_us, packet.is_corrupt))


def rtsp_source(url: str, output: SourceOutput, clock: Clock) -> FfmpegSource:
    """An RTSP server, over TCP so that no packet is lost on the way."""
    options = {"rtsp_transport": "tcp", "fflags": "nobuffer", "probesize": "500000", "analyzeduration": "1000000"}
    shown = url if "@" not in url else "rtsp://" + url.rpartition("@")[2]  # no password in a status
    return FfmpegSource(url, shown, output, clock, options=options)


class DeviceSource(FfmpegSource):
    """A camera of this machine, through Video4Linux."""

    def __init__(self, device: Path, output: SourceOutput, clock: Clock) -> None:
        super().__init__(str(device), f"the camera {device}", output, clock, container_format="v4l2")
        self._device = device

    def session(self) -> None:
        """See `VideoSource`."""
        if not self._device.exists():
            raise Gone(f"waiting for the camera {self._device}: no such device")
        super().session()


def _byte_stream_filter(stream: VideoStream) -> av.BitStreamFilterContext | None:
    name = {"h264": "h264_mp4toannexb", "hevc": "hevc_mp4toannexb"}.get(stream.codec_context.name)
    return None if name is None else av.BitStreamFilterContext(name, stream)


def _reason(error: Exception) -> str:
    if isinstance(error, av.error.ExitError):
        return "no answer in time"
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
