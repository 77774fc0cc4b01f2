from __future__ import annotations

import io
from fractions import Fraction
from itertools import pairwise

import av
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.video.annexb import has_picture
from backend.video.frames import VideoUnit
from backend.video.misp import insert_sei, read_sei
from backend.video.mpegts import TsDemuxer
from tests.backend.video.coded import h264_units


def transport_stream(units: list[bytes], *, lengths: bool, codec: str = "h264") -> list[bytes]:
    """What FFmpeg writes for each unit, with or without stated PES lengths."""
    written: list[bytes] = []
    out = io.BytesIO()
    options = {"flush_packets": "1", "omit_video_pes_length": "0" if lengths else "1"}
    with av.open(out, "w", format="mpegts", options=options) as container:
        stream = container.add_mux_stream(codec, rate=25)
        stream.time_base = Fraction(1, 90_000)
        for n, unit in enumerate(units):
            packet = av.Packet(unit)
            packet.pts = packet.dts = 3600 * n
            packet.time_base = Fraction(1, 90_000)
            packet.is_keyframe = n % 25 == 0
            packet.stream = stream
            container.mux(packet)
            written.append(out.getvalue()[sum(map(len, written)) :])
    return written


UNITS = [insert_sei(u, 1_000_000 + n) for n, u in enumerate(h264_units(30))]
STREAM = transport_stream(UNITS, lengths=True)
WITHOUT_LENGTHS = transport_stream(UNITS, lengths=False)


def stamps(units: list[VideoUnit]) -> list[int | None]:
    return [read_sei(u.payload) for u in units]


def exactly(count: int) -> list[int]:
    return [1_000_000 + n for n in range(count)]


def test_each_unit_is_out_with_its_own_last_byte() -> None:
    """With its length stated, no picture waits for the next."""
    demuxer = TsDemuxer()

    for n, (sent, part) in enumerate(zip(UNITS, STREAM, strict=True)):
        (unit,) = demuxer.receive(part, t_us=40_000 * n)
        # FFmpeg's writer puts an access unit delimiter in front.
        assert unit.payload.endswith(sent)
        assert unit.t_wire_us == 40_000 * n
        assert not unit.after_loss
    assert demuxer.video_codec == "h264"
    assert demuxer.counters.lost_packets == demuxer.counters.noise_bytes == 0


def test_without_lengths_padding_ends_a_unit() -> None:
    """Only a picture that fills its last packet exactly, one in 184 by chance, waits for the next."""
    demuxer = TsDemuxer()
    units = []
    for n, part in enumerate(WITHOUT_LENGTHS):
        units += demuxer.receive(part, t_us=40_000 * n)
        last_is_padded = bool(part[-188 + 3] & 0x20)
        assert len(units) == n + last_is_padded

    assert stamps(units) == exactly(30)
    assert [u.t_wire_us for u in units] == [40_000 * n for n in range(30)]


def test_presentation_times() -> None:
    demuxer = TsDemuxer()
    times = [u.pts_us for part in STREAM for u in demuxer.receive(part, 0) if u.pts_us is not None]

    assert len(times) == 30
    assert {later - earlier for earlier, later in pairwise(times)} == {40_000}


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(1, 700), min_size=1, max_size=40))
def test_cutting_the_stream_anywhere_gives_the_same_units(sizes: list[int]) -> None:
    whole = b"".join(STREAM)
    demuxer = TsDemuxer()
    units, at, n = [], 0, 0
    while at < len(whole):
        size = sizes[n % len(sizes)]
        units += demuxer.receive(whole[at : at + size], 0)
        at, n = at + size, n + 1

    assert stamps(units) == exactly(30)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 29), st.binary(max_size=1500)), max_size=12))
def test_noise_between_datagrams_costs_only_noise(noise: list[tuple[int, bytes]]) -> None:
    """Fault: random datagrams between good ones. Expected: at most the picture that noise imitates is lost."""
    demuxer = TsDemuxer()
    units = []
    for n, part in enumerate(STREAM):
        for where, data in noise:
            if where == n:
                units += demuxer.receive(data, 0)
        units += demuxer.receive(part, 0)

    found = stamps(units)
    assert found == sorted(found, key=lambda s: s or 0)
    assert len(set(exactly(30)) - set(found)) <= sum(b"\x47" in data for _, data in noise)
    assert all(u.payload.endswith(UNITS[(s or 0) - 1_000_000]) for u, s in zip(units, found, strict=True))


def datagrams() -> list[bytes]:
    whole = [d for part in STREAM for d in (part[at : at + 1316] for at in range(0, len(part), 1316))]
    assert len(whole) > 40
    return whole


@pytest.mark.parametrize("lost", [1, 5, 17, 33])
def test_a_lost_datagram_costs_one_picture_and_is_told(lost: int) -> None:
    """Fault: a datagram is dropped. Expected: its picture is not handed out, the next one is marked."""
    demuxer = TsDemuxer()
    units = [u for n, d in enumerate(datagrams()) if n != lost for u in demuxer.receive(d, 0)]

    missing = set(exactly(30)) - set(stamps(units))
    assert len(missing) == 1
    assert demuxer.counters.lost_packets > 0
    first_after = next((u for u in units if (read_sei(u.payload) or 0) > min(missing)), None)
    assert first_after is None or first_after.after_loss
    assert sum(u.after_loss for u in units) == 1


def test_reordered_datagrams_never_give_a_mixed_picture() -> None:
    """Fault: two neighbouring datagrams swapped, every tenth. Expected: whole pictures or none."""
    parts = datagrams()
    for n in range(5, len(parts) - 1, 10):
        parts[n], parts[n + 1] = parts[n + 1], parts[n]
    demuxer = TsDemuxer()
    units = [u for d in parts for u in demuxer.receive(d, 0)]

    assert 10 <= len(units) < 30
    assert all(u.payload.endswith(UNITS[(read_sei(u.payload) or 0) - 1_000_000]) for u in units)


@pytest.mark.parametrize("keep", [1, 100, 188, 187 * 3, 1000])
def test_a_truncated_datagram_costs_one_picture(keep: int) -> None:
    parts = datagrams()
    whole = next(n for n, d in enumerate(parts) if n > 7 and len(d) == 1316)
    parts[whole] = parts[whole][:keep]
    demuxer = TsDemuxer()
    units = [u for d in parts for u in demuxer.receive(d, 0)]

    assert len(set(exactly(30)) - set(stamps(units))) == 1


@settings(max_examples=100, deadline=None)
@given(st.lists(st.binary(max_size=600), max_size=20))
def test_random_bytes_give_no_picture(chunks: list[bytes]) -> None:
    demuxer = TsDemuxer()

    assert [u for c in chunks for u in demuxer.receive(c, 0)] == []
    assert demuxer.video_codec is None


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(b"".join(STREAM)) - 1), st.integers(1, 255)), max_size=30))
def test_flipped_bytes_never_break_the_demuxer(flips: list[tuple[int, int]]) -> None:
    """Fault: bytes changed anywhere, also in tables and headers. Expected: units, if any, and no exception."""
    data = bytearray(b"".join(STREAM))
    for at, value in flips:
        data[at] ^= value
    demuxer = TsDemuxer()

    units = demuxer.receive(bytes(data), 0)

    assert len(units) <= 31


def test_joining_in_the_middle() -> None:
    """A receiver that starts late begins at the next table and picture."""
    demuxer = TsDemuxer()
    units = [u for part in STREAM[10:] for u in demuxer.receive(part, 0)]

    assert len(units) >= 15
    assert all(has_picture(u.payload) for u in units)


def test_streams_without_video_are_named() -> None:
    out = io.BytesIO()
    with av.open(out, "w", format="mpegts") as container:
        stream = container.add_stream("mp2", rate=48_000)
        frame = av.AudioFrame(format="s16", layout="mono", samples=1152)
        frame.sample_rate = 48_000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    demuxer = TsDemuxer()

    assert demuxer.receive(out.getvalue(), 0) == []
    assert demuxer.video_codec is None
    assert demuxer.other_types == (3,)


def test_h265_is_recognised() -> None:
    demuxer = TsDemuxer()
    parts = transport_stream(h264_units(5, codec="libx265"), lengths=True, codec="hevc")
    units = [u for part in parts for u in demuxer.receive(part, 0)]

    assert [u.codec for u in units] == ["hevc"] * 5
