"""Video over UDP: MPEG-TS, and RTP described by an SDP file."""

from __future__ import annotations

import ipaddress
import socket
import struct
from pathlib import Path
from typing import Protocol

from backend.video.frames import VideoUnit
from backend.video.mpegts import TsDemuxer
from backend.video.rtp import RtpDepacketiser, parse_sdp
from backend.video.source import Clock, Gone, SourceOutput, VideoSource

_RECEIVE_BUFFER_BYTES = 4 << 20
_POLL_S = 0.2
_SILENCE_US = 2_000_000
_MAX_SDP_BYTES = 65_536


class _Parser(Protocol):
    def receive(self, data: bytes, t_us: int, /) -> list[VideoUnit]: ...

    def reset(self) -> None: ...


class _DatagramSource(VideoSource):
    """Receives datagrams and hands the units in them on."""

    def listen(self, host: str, port: int, parser: _Parser) -> None:
        """Receive until closed."""
        with _bound_socket(host, port) as sock:
            self.status = self.words(0, port)
            received, t_last_us = 0, 0
            while not self.stopping.is_set():
                try:
                    data = sock.recv(65_536)
                except TimeoutError:
                    if t_last_us and self.clock() - t_last_us > _SILENCE_US:
                        # Whoever sends next may be another sender.
                        parser.reset()
                        self.output.interrupted()
                        received, t_last_us = 0, 0
                        self.status = self.words(0, port)
                    continue
                t_last_us = self.clock()
                received += len(data)
                for unit in parser.receive(data, t_last_us):
                    self.deliver(unit)
                self.status = self.words(received, port)

    def words(self, received: int, port: int) -> str:
        """What is waited for after so many bytes."""
        raise NotImplementedError


class UdpTsSource(_DatagramSource):
    """MPEG-TS over UDP."""

    def __init__(self, host: str, port: int, output: SourceOutput, clock: Clock) -> None:
        super().__init__(output, clock)
        self._host, self._port = host, port
        self._demuxer = TsDemuxer()

    def session(self) -> None:
        """See `VideoSource`."""
        self.listen(self._host, self._port, self._demuxer)

    def words(self, received: int, port: int) -> str:
        """See `_DatagramSource`."""
        if received == 0:
            return f"waiting for MPEG-TS on UDP port {port}: nothing received yet"
        if self._demuxer.video_codec is not None:
            return f"receiving MPEG-TS on UDP port {port}"
        if self._demuxer.other_types:
            return f"MPEG-TS on UDP port {port} holds no H.264 or H.265 video (types {self._demuxer.other_types})"
        if self._demuxer.counters.packets == 0:
            return f"waiting for MPEG-TS on UDP port {port}: {received} bytes came, but they are no MPEG-TS"
        return f"waiting for the table of streams in the MPEG-TS on UDP port {port}"


class RtpSource(_DatagramSource):
    """H.264 or H.265 over RTP, described by an SDP file."""

    def __init__(self, sdp: Path, output: SourceOutput, clock: Clock) -> None:
        super().__init__(output, clock)
        self._sdp = sdp
        self._depacketiser: RtpDepacketiser | None = None

    def session(self) -> None:
        """See `VideoSource`."""
        if not self._sdp.is_file():
            raise Gone(f"waiting for the SDP file {self._sdp}: no such file")
        try:
            with self._sdp.open("rb") as file:
                session = parse_sdp(file.read(_MAX_SDP_BYTES).decode("utf-8", "replace"))
        except ValueError as error:
            raise Gone(f"the SDP file {self._sdp} cannot be used: {error}") from error
        self._depacketiser = RtpDepacketiser(session)
        self.listen(session.address, session.port, self._depacketiser)

    def words(self, received: int, port: int) -> str:
        """See `_DatagramSource`."""
        if received == 0:
            return f"waiting for RTP on UDP port {port}: nothing received yet"
        if self._depacketiser is not None and self._depacketiser.packets == 0:
            return (
                f"waiting for RTP on UDP port {port}: {received} bytes came, but not the RTP that {self._sdp} describes"
            )
        return f"receiving RTP on UDP port {port}"


def _bound_socket(host: str, port: int) -> socket.socket:
    try:
        address = ipaddress.ip_address(host)
    except ValueError as error:
        raise Gone(f"waiting for UDP port {port}: {host!r} is no address of this machine") from error
    sock = socket.socket(socket.AF_INET6 if address.version == 6 else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        sock.settimeout(_POLL_S)
        if address.is_multicast and address.version == 4:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            group = struct.pack("4sI", address.packed, socket.INADDR_ANY)
            sock.bind((host, port))
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        else:
            sock.bind((host if address.is_loopback or address.is_unspecified else _any(address.version), port))
    except OSError as error:
        sock.close()
        raise Gone(f"waiting for UDP port {port}: {error.strerror or error}; does another program use it?") from error
    return sock


def _any(version: int) -> str:
    # An SDP or an address bar may name the sender's idea of this machine; the port is what counts.
    return "::" if version == 6 else "0.0.0.0"  # noqa: S104
