from __future__ import annotations

from pathlib import Path

import pytest

from backend.video.errors import VideoSourceError
from backend.video.frames import VideoUnit
from backend.video.sources import VIDEO_SOURCES, open_source
from estimator.types import Image


class Nobody:
    def unit(self, unit: VideoUnit) -> None: ...

    def picture(self, image: Image, pts_us: int | None, t_wire_us: int) -> None: ...

    def interrupted(self) -> None: ...


@pytest.mark.parametrize(
    ("url", "kind"),
    [
        ("udp://0.0.0.0:5600", "UdpTsSource"),
        ("udp://:5600", "UdpTsSource"),
        ("udp://@:5600", "UdpTsSource"),
        ("udp://239.1.2.3:5600?pkt_size=1316", "UdpTsSource"),
        ("rtp:camera.sdp", "RtpSource"),
        ("rtp:///etc/camera.sdp", "RtpSource"),
        ("rtsp://user:secret@10.0.0.2:554/stream", "FfmpegSource"),
        ("device:/dev/video0", "DeviceSource"),
        ("file:flight.mp4?loop", "FileSource"),
    ],
)
def test_addresses(url: str, kind: str) -> None:
    source = open_source(url, Nobody(), lambda: 0)

    assert type(source).__name__ == kind
    assert "secret" not in source.status


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("", "begin with one of udp:, rtp:, rtsp:, device:, file:"),
        ("5600", "begin with one of"),
        ("http://camera", "begin with one of"),
        ("udp://0.0.0.0", "port is missing"),
        ("udp://0.0.0.0:99999", "from 1 to 65535"),
        ("udp://0.0.0.0:video", "from 1 to 65535"),
        ("rtp:", "write rtp:camera.sdp"),
        ("rtsp:///stream", "host is missing"),
        ("device:", "write device:/dev/video0"),
        ("file:", "write file:flight.mp4"),
    ],
)
def test_unusable_addresses_say_what_would_do(url: str, message: str) -> None:
    with pytest.raises(VideoSourceError, match=message) as caught:
        open_source(url, Nobody(), lambda: 0)
    assert repr(url) in str(caught.value)


def test_every_kind_is_listed() -> None:
    assert set(VIDEO_SOURCES) == {"udp", "rtp", "rtsp", "device", "file"}


def test_opening_touches_nothing(tmp_path: Path) -> None:
    """A source reads its file when it runs, not when it is made."""
    assert "waiting for the file" in open_source(f"file:{tmp_path / 'absent.mp4'}", Nobody(), lambda: 0).status
