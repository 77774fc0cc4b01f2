"""The kinds of video address, and the source that each opens."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from backend.video.datagram_sources import RtpSource, UdpTsSource
from backend.video.errors import VideoSourceError
from backend.video.ffmpeg_source import DeviceSource, rtsp_source
from backend.video.file_source import FileSource
from backend.video.source import Clock, SourceOutput, VideoSource

DEFAULT_URL = "udp://0.0.0.0:5600"


def _udp(url: str, output: SourceOutput, clock: Clock) -> VideoSource:
    parts = urlsplit(url)
    try:
        port = parts.port
    except ValueError as error:
        raise VideoSourceError(url, "the port has to be a number from 1 to 65535") from error
    if not port:
        raise VideoSourceError(url, "the port is missing; write udp://0.0.0.0:5600")
    return UdpTsSource(parts.hostname or "0.0.0.0", port, output, clock)  # noqa: S104  video comes from outside


def _rtp(url: str, output: SourceOutput, clock: Clock) -> VideoSource:
    return RtpSource(_path_of(url, "rtp:camera.sdp"), output, clock)


def _rtsp(url: str, output: SourceOutput, clock: Clock) -> VideoSource:
    if not urlsplit(url).hostname:
        raise VideoSourceError(url, "the host is missing; write rtsp://192.168.1.10:554/stream")
    return rtsp_source(url, output, clock)


def _device(url: str, output: SourceOutput, clock: Clock) -> VideoSource:
    return DeviceSource(_path_of(url, "device:/dev/video0"), output, clock)


def _file(url: str, output: SourceOutput, clock: Clock) -> VideoSource:
    loop = url.endswith("?loop")
    return FileSource(_path_of(url.removesuffix("?loop"), "file:flight.mp4"), output, clock, loop=loop)


VIDEO_SOURCES: dict[str, Callable[[str, SourceOutput, Clock], VideoSource]] = {
    "udp": _udp,
    "rtp": _rtp,
    "rtsp": _rtsp,
    "device": _device,
    "file": _file,
}


def open_source(url: str, output: SourceOutput, clock: Clock) -> VideoSource:
    """The source of an address, not yet started.

    Raises
    ------
    VideoSourceError
        The address is of no known kind, or incomplete.
    """
    kind, colon, _ = url.partition(":")
    if not colon or kind not in VIDEO_SOURCES:
        raise VideoSourceError(url, f"it has to begin with one of {', '.join(k + ':' for k in VIDEO_SOURCES)}")
    return VIDEO_SOURCES[kind](url, output, clock)


def _path_of(url: str, example: str) -> Path:
    text = url.partition(":")[2]
    if text.startswith("//"):
        text = text[2:]
    if not text:
        raise VideoSourceError(url, f"the path is missing; write {example}")
    return Path(text)
