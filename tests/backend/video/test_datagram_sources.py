"""Video over UDP on real sockets: what is said while it does not come, silence, ports that cannot be had."""

from __future__ import annotations

import itertools
import random
import socket
from pathlib import Path

import pytest

from backend.clock import mono_us
from backend.video.datagram_sources import RtpSource, UdpTsSource
from backend.video.source import VideoSource
from backend.video.writer import TsWriter
from simulator.video_out import H264TsSender
from tests.backend.video.coded import encoded_frames, h264_units
from tests.backend.video.collector import free_udp_port
from tests.backend.video.gathered import Gathered
from tests.backend.video.pictures_with_numbers import picture_with_number
from tests.backend.video.rtp_sender import RtpSender, sdp

SIZE = (160, 120)
SILENCE_US = 2_000_000


class Clock:
    """Stands still until it is moved."""

    def __init__(self) -> None:
        self.now_us = 1_000_000

    def __call__(self) -> int:
        return self.now_us


def said(source: VideoSource, output: Gathered, words: str) -> None:
    output.wait_for(lambda: words in source.status)


def transport_stream(path: Path, count: int) -> bytes:
    writer = TsWriter(path)
    for frame in encoded_frames(count, SIZE):
        writer.write(frame)
    writer.close()
    return path.read_bytes()


def send(port: int, data: bytes, size: int = 7 * 188) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for at in range(0, len(data), size):
            out.sendto(data[at : at + size], ("127.0.0.1", port))


def test_pictures_come_with_their_time_on_both_clocks(tmp_path: Path) -> None:
    port, output, clock = free_udp_port(), Gathered(), Clock()
    source = UdpTsSource("127.0.0.1", port, output, clock)
    source.start()
    said(source, output, "nothing received yet")
    sender = H264TsSender("127.0.0.1", port, *SIZE)
    for n in range(10):
        sender.send(picture_with_number(n, SIZE), 5_000_000 + 40_000 * n)
    output.wait_for(lambda: len(output.units) == 10)
    said(source, output, f"receiving MPEG-TS on UDP port {port}")
    source.close()
    sender.close()

    times = [unit.pts_us for unit in output.units]
    assert all(isinstance(t, int) for t in times)
    # a tick of PTS is 11 us
    assert [b - a for a, b in itertools.pairwise(times)] == pytest.approx([40_000] * 9, abs=12)  # type: ignore[operator]
    assert {unit.t_wire_us for unit in output.units} == {clock.now_us}
    assert not any(unit.after_loss for unit in output.units)


def test_what_comes_instead_of_video_is_said() -> None:
    port, output = free_udp_port(), Gathered()
    source = UdpTsSource("127.0.0.1", port, output, mono_us)
    source.start()
    said(source, output, "nothing received yet")
    send(port, bytes(byte & 0xBF for byte in random.Random(2).randbytes(1000)))  # no synchronisation byte 0x47 among it
    said(source, output, "1000 bytes came, but they are no MPEG-TS")
    # transport packets of the null stream: a multiplex without a table
    send(port, (b"\x47\x1f\xff\x10" + bytes(184)) * 14)
    said(source, output, "waiting for the table of streams")
    source.close()

    assert output.units == []


def test_after_a_silence_another_sender_may_come(tmp_path: Path) -> None:
    """
    Fault: the stream stops in the middle of a picture; after two seconds another begins with its own numbers.
    Expected: an interruption is told, once, and no picture is made of the two.
    """
    port, output, clock = free_udp_port(), Gathered(), Clock()
    source = UdpTsSource("127.0.0.1", port, output, clock)
    stream = transport_stream(tmp_path / "v.ts", 30)
    source.start()
    said(source, output, "nothing received yet")
    send(port, stream[: 188 * (len(stream) // 188 // 2)])
    output.wait_for(lambda: bool(output.units))
    said(source, output, "receiving")

    def silent() -> bool:
        # a datagram that is read only now is heard now, and the silence begins after it
        clock.now_us += SILENCE_US
        return output.interruptions == 1

    output.wait_for(silent)
    said(source, output, "nothing received yet")
    send(port, stream)
    whole = len(h264_units(30, SIZE))
    output.wait_for(lambda: len(output.all) - output.all.index(None) - 1 >= whole - 1)
    source.close()

    after = output.all[output.all.index(None) + 1 :]
    assert output.interruptions == 1
    first = [unit.payload for unit in output.units[: output.all.index(None)]]
    again = [unit.payload for unit in after]  # type: ignore[union-attr]
    assert again[: len(first)] == first


@pytest.mark.parametrize(
    ("host", "words"),
    [("camera.local", "'camera.local' is no address of this machine"), ("127.0.0.1", "does another program use it?")],
)
def test_a_port_that_cannot_be_had_is_named_and_tried_again(host: str, words: str) -> None:
    port, output = free_udp_port(), Gathered()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        source = UdpTsSource(host, port, output, mono_us)
        source.start()
        output.wait_for(lambda: output.interruptions >= 2)
        assert f"waiting for UDP port {port}" in source.status
        assert words in source.status
    if host == "127.0.0.1":
        said(source, output, "nothing received yet")  # the other has gone
    source.close()


def test_rtp_waits_for_its_description_and_then_for_what_it_describes(tmp_path: Path) -> None:
    port, output = free_udp_port(), Gathered()
    path = tmp_path / "camera.sdp"
    source = RtpSource(path, output, mono_us)
    source.start()
    said(source, output, f"waiting for the SDP file {path}: no such file")
    path.write_text("m=audio 5004 RTP/AVP 0\r\n")
    said(source, output, f"the SDP file {path} cannot be used")
    path.write_text(sdp(port))
    said(source, output, f"waiting for RTP on UDP port {port}: nothing received yet")
    send(port, random.Random(1).randbytes(500).replace(b"\x80", b"\x00"), size=100)
    said(source, output, f"500 bytes came, but not the RTP that {path} describes")
    units = h264_units(8, SIZE)
    with RtpSender(port) as sender:
        for unit in units:
            sender.send(unit)
        output.wait_for(lambda: len(output.units) >= 7)
    said(source, output, f"receiving RTP on UDP port {port}")
    source.close()

    assert output.units[0].codec == "h264"


def test_an_sdp_of_bytes_that_are_no_text_is_told(tmp_path: Path) -> None:
    output, path = Gathered(), tmp_path / "camera.sdp"
    path.write_bytes(random.Random(5).randbytes(200_000))
    source = RtpSource(path, output, mono_us)
    source.start()
    output.wait_for(lambda: output.interruptions >= 1)
    source.close()

    assert "cannot be used" in source.status
