"""RTP as FFmpeg sends it, for tests."""

from __future__ import annotations

from fractions import Fraction
from types import TracebackType
from typing import Self

import av


class RtpSender:
    """Sends access units, each 40 ms after the one before it on the stream's clock, to a port of this machine."""

    def __init__(self, port: int, codec: str = "h264") -> None:
        self._container = av.open(f"rtp://127.0.0.1:{port}?pkt_size=1200", "w", format="rtp")
        self._stream = self._container.add_mux_stream(codec, rate=25)
        self._stream.time_base = Fraction(1, 90_000)
        self._count = 0

    def send(self, unit: bytes) -> None:
        packet = av.Packet(unit)
        packet.pts = packet.dts = 3600 * self._count
        packet.time_base = Fraction(1, 90_000)
        packet.stream = self._stream
        self._container.mux(packet)
        self._count += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._container.close()


def sdp(port: int, coding: str = "H264", extra: str = "") -> str:
    """An SDP for what `RtpSender` sends."""
    lines = [
        "v=0",
        "o=- 0 0 IN IP4 127.0.0.1",
        "s=camera",
        "c=IN IP4 127.0.0.1",
        "t=0 0",
        f"m=video {port} RTP/AVP 96",
        f"a=rtpmap:96 {coding}/90000",
        f"a=fmtp:96 packetization-mode=1{extra}",
    ]
    return "\r\n".join(lines) + "\r\n"
