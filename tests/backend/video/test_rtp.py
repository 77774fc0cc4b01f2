from __future__ import annotations

import base64
import socket
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.video.annexb import PPS, SPS, nal_type, nal_units
from backend.video.frames import VideoUnit
from backend.video.misp import insert_sei, read_sei
from backend.video.rtp import RtpDepacketiser, parse_sdp
from tests.backend.video.coded import h264_units
from tests.backend.video.rtp_sender import RtpSender, sdp

UNITS = [insert_sei(u, 1_000_000 + n) for n, u in enumerate(h264_units(30))]


def sent(units: list[bytes], codec: str = "h264") -> list[bytes]:
    """What FFmpeg puts on the wire for these units, without RTCP."""
    datagrams = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        sock.bind(("127.0.0.1", 0))
        sock.setblocking(False)
        with RtpSender(sock.getsockname()[1], codec) as sender:
            for unit in units:
                sender.send(unit)
        while True:
            try:
                datagrams.append(sock.recv(65536))
            except BlockingIOError:
                break
    return [d for d in datagrams if d[1] & 0x7F == 96]


DATAGRAMS = sent(UNITS)


def depacketiser(coding: str = "H264", extra: str = "") -> RtpDepacketiser:
    return RtpDepacketiser(parse_sdp(sdp(5600, coding, extra)))


def stamps(units: list[VideoUnit]) -> list[int | None]:
    return [read_sei(u.payload) for u in units]


def exactly(count: int) -> list[int]:
    return [1_000_000 + n for n in range(count)]


def test_every_unit_comes_whole_with_its_last_datagram() -> None:
    taking = depacketiser()
    units = []
    for n, datagram in enumerate(DATAGRAMS):
        before = len(units)
        units += taking.receive(datagram, n)
        assert (len(units) > before) == bool(datagram[1] & 0x80)

    assert stamps(units) == exactly(30)
    assert [list(nal_units(u.payload)) for u in units] == [list(nal_units(u)) for u in UNITS]
    assert {b - a for a, b in pairwise([u.pts_us or 0 for u in units])} == {40_000}
    assert not any(u.after_loss for u in units)


def test_swapped_datagrams_are_put_right() -> None:
    """Fault: every other pair of datagrams arrives in the wrong order. Expected: nothing is lost."""
    swapped = list(DATAGRAMS)
    for n in range(1, len(swapped) - 1, 2):
        swapped[n], swapped[n + 1] = swapped[n + 1], swapped[n]
    taking = depacketiser()

    assert stamps([u for d in swapped for u in taking.receive(d, 0)]) == exactly(30)
    assert taking.lost_packets == 0


@pytest.mark.parametrize("lost", [3, 8, 20, 30])
def test_a_lost_datagram_never_gives_a_mixed_picture(lost: int) -> None:
    """Fault: a datagram is dropped. Expected: its picture goes, at most one more, and the next one is marked."""
    taking = depacketiser()
    units = [u for n, d in enumerate(DATAGRAMS) if n != lost for u in taking.receive(d, 10_000 * n)]

    assert 1 <= len(set(exactly(30)) - set(stamps(units))) <= 2
    assert sum(u.after_loss for u in units) == 1
    assert taking.lost_packets == 1
    for unit in units:
        assert list(nal_units(unit.payload)) == list(nal_units(UNITS[(read_sei(unit.payload) or 0) - 1_000_000]))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, len(DATAGRAMS) - 1), st.integers(0, 300), st.binary(max_size=40)), max_size=20)
)
def test_damaged_datagrams_never_break_it(damage: list[tuple[int, int, bytes]]) -> None:
    datagrams = [bytearray(d) for d in DATAGRAMS]
    for n, at, data in damage:
        datagrams[n][at : at + len(data)] = data
    taking = depacketiser()
    for datagram in datagrams:
        taking.receive(bytes(datagram), 0)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=200), max_size=30))
def test_random_datagrams_between_cost_nothing_much(noise: list[bytes]) -> None:
    """Random bytes are told by version and payload type; what slips through cannot break the stream for good."""
    taking = depacketiser()
    for data in noise:
        taking.receive(data, 0)
    units = [u for d in DATAGRAMS for u in taking.receive(d, 0)]

    assert stamps(units)[-1] == exactly(30)[-1]


def test_parameter_sets_of_the_sdp_come_first() -> None:
    sets = [u for u in nal_units(UNITS[0]) if nal_type(u) in (SPS, PPS)]
    extra = ";sprop-parameter-sets=" + ",".join(base64.b64encode(u).decode() for u in sets)
    taking = depacketiser(extra=extra)

    units = [u for d in DATAGRAMS for u in taking.receive(d, 0)]

    assert list(nal_units(units[0].payload))[:2] == sets
    assert nal_type(next(iter(nal_units(units[1].payload)))) not in (SPS, PPS)


def test_h265() -> None:
    coded = h264_units(6, codec="libx265")
    taking = depacketiser("H265")
    units = [u for d in sent(coded, "hevc") for u in taking.receive(d, 0)]

    assert [u.codec for u in units] == ["hevc"] * 6
    assert [list(nal_units(u.payload)) for u in units] == [list(nal_units(u)) for u in coded]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no line 'm=video"),
        ("v=0\nm=audio 5004 RTP/AVP 0\n", "no line 'm=video"),
        (sdp(0), "port is 0"),
        (sdp(5600, "VP8"), "video codings are VP8"),
        ("m=video 5600 RTP/AVP 96\n", "video codings are none"),
    ],
)
def test_an_unusable_sdp_is_named(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_sdp(text)


@given(st.text(max_size=300))
def test_random_text_is_refused_in_one_way(text: str) -> None:
    with pytest.raises(ValueError, match=r"it has no|its video"):
        parse_sdp(text)


def test_the_sdp_is_read() -> None:
    session = parse_sdp(sdp(5602, "H265") + "m=audio 5604 RTP/AVP 97\na=rtpmap:97 OPUS/48000\n")

    assert (session.address, session.port, session.payload_type, session.codec) == ("127.0.0.1", 5602, 96, "hevc")
    assert session.clock_hz == 90_000
