import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.link.framing import NOISE_BLOCK_BYTES, FramerEvent, MavlinkFramer, Noise, RawPacket
from tests.backend.link.wire import Sender

V2_ATTITUDE_HEADER = bytes([0xFD, 28, 0, 0, 0, 1, 1, 30, 0, 0])


def _packets(seed: int, count: int) -> list[bytes]:
    rng = random.Random(seed)
    senders = [Sender(), Sender(version=1), Sender(key=b"k" * 32)]
    makers = [
        lambda s: s.heartbeat(custom_mode=rng.choice([4, 0xFD, 0xFEFDFE])),
        lambda s: s.attitude(rng.choice([rng.randrange(2**32), 0xFDFDFDFD, 0xFEFE]), rng.uniform(-3, 3)),
        lambda s: s.status_text("x" * rng.randrange(51)),
        lambda s: s.pack(dialect.MAVLink_raw_imu_message(rng.randrange(2**40), *rng.choices(range(-9, 9), k=9))),
    ]
    return [rng.choice(makers)(rng.choice(senders)) for _ in range(count)]


def _cut(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]


def _feed(chunks: list[bytes]) -> list[FramerEvent]:
    framer = MavlinkFramer()
    return [event for chunk in chunks for event in framer.feed(chunk)] + framer.finish()


def _data(events: list[FramerEvent]) -> list[bytes]:
    return [event.data for event in events if isinstance(event, RawPacket) and event.known]


def _bytewise(data: bytes) -> list[bytes]:
    return [data[i : i + 1] for i in range(len(data))]


# Noise that looks like MAVLink: start bytes, headers of known messages that claim a length, whole and cut packets.
false_headers = st.one_of(
    st.sampled_from([b"\xfd", b"\xfe", b"\xfd\xfd", b"\xfe\xfd", b"\xfd\xff\x00\x00\x00\x01\x01\x1e\x00\x00"]),
    st.builds(lambda n: V2_ATTITUDE_HEADER[:1] + bytes([n]) + V2_ATTITUDE_HEADER[2:], st.integers(0, 255)),
    st.builds(lambda n: bytes([0xFE, n, 0, 1, 1, 30]), st.integers(0, 255)),
    st.builds(lambda n, i: bytes([0xFD, n, 1, 0, 0, 1, 1, i, i, 0]), st.integers(0, 255), st.integers(0, 255)),
    st.builds(lambda n: V2_ATTITUDE_HEADER[:n], st.integers(1, 10)),
)
noise = st.lists(st.one_of(st.binary(max_size=40), false_headers), max_size=4).map(b"".join)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32), st.lists(noise, min_size=6, max_size=6), st.lists(st.integers(0, 2000), max_size=12))
def test_any_chunking_gives_the_same_events(seed: int, gaps: list[bytes], cuts: list[int]) -> None:
    stream = b"".join(gap + packet for gap, packet in zip(gaps, _packets(seed, 6), strict=True))
    whole = _feed([stream])

    assert _feed(_cut(stream, cuts)) == whole
    assert _feed(_bytewise(stream)) == whole


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32), st.lists(noise, min_size=8, max_size=8))
def test_noise_between_packets_costs_at_most_the_noise(seed: int, gaps: list[bytes]) -> None:
    packets = _packets(seed, 8)
    stream = b"".join(gap + packet for gap, packet in zip(gaps, packets, strict=True))
    events = _feed([stream])

    assert [data for data in _data(events) if data in packets] == packets
    lengths = sum(event.length if isinstance(event, Noise) else len(event.data) for event in events)
    assert lengths == len(stream)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32), st.lists(st.integers(1, 300), min_size=5, max_size=5))
def test_truncated_packets_cost_only_themselves(seed: int, kept: list[int]) -> None:
    packets = _packets(seed, 10)
    cut_ones = [packet[: n % len(packet)] for packet, n in zip(packets[::2], kept, strict=True)]
    stream = b"".join(a + b for a, b in zip(cut_ones, packets[1::2], strict=True))

    assert _data(_feed([stream])) == packets[1::2]


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32), st.integers(0, 5), st.integers(0, 400), st.integers(1, 255))
def test_a_damaged_byte_costs_one_packet(seed: int, which: int, where: int, flip: int) -> None:
    packets = _packets(seed, 6)
    damaged = bytearray(packets[which])
    damaged[where % len(damaged)] ^= flip
    stream = b"".join([*packets[:which], bytes(damaged), *packets[which + 1 :]])
    found = _data(_feed([stream]))

    # A signature is not covered by the checksum: damage there passes the framing, as the law of MAVLink 2 has it.
    others = packets[:which] + packets[which + 1 :]
    assert [data for data in found if data != bytes(damaged)] == others


def test_a_false_header_does_not_delay_the_packets_behind_it() -> None:
    """A header that claims 255 bytes: packets behind it come as soon as their own last byte."""
    framer = MavlinkFramer()
    first, second = Sender().attitude(1000), Sender().heartbeat()
    assert framer.feed(bytes([0xFD, 255, 0, 0, 0, 1, 1, 30, 0, 0]) + b"\x01\x02") == []

    assert _data(framer.feed(first)) == [first]
    assert _data(framer.feed(second)) == [second]


@pytest.mark.parametrize("stray", [b"\xfd", b"\xfe", b"\xfd\x20", b"\xfe\x09\x00"])
def test_a_stray_start_byte_delays_nothing(stray: bytes) -> None:
    framer = MavlinkFramer()
    packet = Sender().attitude(1000)

    assert framer.feed(stray + packet)[-1] == MavlinkFramer().feed(packet)[0]


def test_a_packet_cut_in_its_signature_does_not_swallow_the_next() -> None:
    first, second = Sender(key=b"k" * 32).heartbeat(), Sender().attitude(5)
    for kept in range(len(first) - 13, len(first)):
        assert _data(_feed([first[:kept] + second])) == [second]


def test_a_packet_that_lacks_the_next_one_s_start_byte() -> None:
    """The last checksum byte is lost and the next packet's start byte has its value: both packets are there."""
    sender = Sender()
    first = next(packet for packet in (sender.attitude(t) for t in range(100_000)) if packet[-1] == 0xFD)
    second = sender.heartbeat()

    assert _feed([first[:-1] + second + first]) == _feed([first, second, first])


def test_a_packet_carried_by_another_is_payload() -> None:
    inner = Sender().heartbeat()
    carrier = Sender().pack(dialect.MAVLink_encapsulated_data_message(7, list(inner.ljust(253, b"\x01"))))

    assert _data(_feed([carrier])) == [carrier]
    assert _data(_feed(_bytewise(carrier))) == [carrier]


def test_packets_behind_a_false_carrier_wait_and_are_all_found() -> None:
    false_carrier = bytes([0xFD, 255, 0, 0, 0, 1, 1, 131, 0, 0])
    packets = [Sender().attitude(t) for t in range(8)]

    assert _data(_feed([false_carrier, *packets])) == packets


def test_fields_of_each_version() -> None:
    key = b"0" * 32
    v1, v2, signed = Sender(7, 9, version=1), Sender(7, 9), Sender(7, 9, key=key)
    events = _feed([v1.heartbeat(), v2.heartbeat(), signed.heartbeat()])

    assert [(e.version, e.signed) for e in events if isinstance(e, RawPacket)] == [(1, False), (2, False), (2, True)]
    for event in events:
        assert isinstance(event, RawPacket)
        assert (event.system_id, event.component_id, event.msg_id, event.seq) == (7, 9, 0, 0)
        assert event.decode().type == 4


def test_a_type_outside_the_dialect_is_told_from_noise() -> None:
    """PX4's message 8 and others: the type's checksum byte is not known, the packet still is one."""
    body = bytes([5, 0, 0, 0, 1, 1, 0x39, 0x30, 0x00]) + b"hello"
    crc = dialect.x25crc(bytearray(body) + bytearray([77])).crc
    unknown = b"\xfd" + body + crc.to_bytes(2, "little")
    known = Sender().heartbeat()
    events = _feed([b"zz" + unknown + known])

    assert events[0] == Noise(2)
    assert isinstance(events[1], RawPacket)
    assert (events[1].known, events[1].msg_id, events[1].data) == (False, 0x3039, unknown)
    assert _data(events) == [known]


def test_endless_noise_is_reported_in_blocks() -> None:
    framer = MavlinkFramer()
    events = [event for _ in range(100) for event in framer.feed(bytes(1000))]

    assert sum(event.length for event in events if isinstance(event, Noise)) == 100_000 // NOISE_BLOCK_BYTES * 4096
