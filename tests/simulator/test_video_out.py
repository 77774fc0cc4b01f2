from __future__ import annotations

import io
import socket
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest

from simulator.misp_stamp import MISP_UUID
from simulator.video_out import DATAGRAM_BYTES, TS_PACKET_BYTES, H264FileWriter, H264TsSender
from tests.backend.video.pictures_with_numbers import number_in, picture_with_number

SIZE = (320, 240)
START_US = 1_760_000_000_123_457


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(10)
        yield sock


def stamp_in(packet: bytes) -> int:
    at = packet.index(MISP_UUID) + len(MISP_UUID) + 1
    return int.from_bytes(bytes(b for n, b in enumerate(packet[at : at + 11]) if n % 3 != 2), "big")


def test_a_player_sees_every_picture_with_its_time(receiver: socket.socket) -> None:
    """FFmpeg, fed with what went over the wire, gives every picture in order with its exposure time and PTS."""
    times_us = [START_US + 40_000 * n + 13 * (n % 5) for n in range(60)]
    received = []
    with H264TsSender("127.0.0.1", receiver.getsockname()[1], *SIZE, fps=25) as sender:
        for n, t_us in enumerate(times_us):
            received += [receiver.recv(65536) for _ in range(sender.send(picture_with_number(n, SIZE), t_us))]

    assert all(len(d) % TS_PACKET_BYTES == 0 and len(d) <= DATAGRAM_BYTES for d in received)
    with av.open(io.BytesIO(b"".join(received)), format="mpegts") as container:
        packets = [p for p in container.demux(video=0) if p.size]
        base = packets[0].pts or 0
        assert [stamp_in(bytes(p)) for p in packets] == times_us
        assert [(p.pts or 0) - base for p in packets] == [(t - START_US) * 9 // 100 for t in times_us]
        assert [n for n, p in enumerate(packets) if p.is_keyframe] == [0, 25, 50]
    with av.open(io.BytesIO(b"".join(received)), format="mpegts") as container:
        assert [number_in(f.to_ndarray(format="gray")) for f in container.decode(video=0)] == list(range(60))


def test_each_picture_is_whole_on_the_wire_before_the_next(receiver: socket.socket) -> None:
    """A PES packet states its length and all of it has been sent when `send` returns."""
    with H264TsSender("127.0.0.1", receiver.getsockname()[1], *SIZE) as sender:
        for n in range(5):
            count = sender.send(picture_with_number(n, SIZE), START_US + 40_000 * n)
            stream = b"".join(receiver.recv(65536) for _ in range(count))
            pes = b"".join(video_payloads(stream))
            assert pes[:4] == b"\x00\x00\x01\xe0"
            assert int.from_bytes(pes[4:6], "big") == len(pes) - 6


def video_payloads(stream: bytes) -> Iterator[bytes]:
    for at in range(0, len(stream), TS_PACKET_BYTES):
        packet = stream[at : at + TS_PACKET_BYTES]
        if int.from_bytes(packet[1:3], "big") & 0x1FFF == 0x100:
            yield packet[5 + packet[4] :] if packet[3] & 0x20 else packet[4:]


def test_a_missing_receiver_does_not_stop_the_sender() -> None:
    """Nobody listens on the port; sending goes on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port = sock.getsockname()[1]
    with H264TsSender("127.0.0.1", port, *SIZE) as sender:
        for n in range(4):
            assert sender.send(picture_with_number(n, SIZE), START_US + 40_000 * n) >= 1


@pytest.mark.parametrize(
    ("image", "later_us", "message"),
    [
        (picture_with_number(0, (160, 120)), 40_000, "expected uint8"),
        (picture_with_number(0, SIZE).astype(np.float32), 40_000, "expected uint8"),
        (picture_with_number(0, SIZE), 0, "not later"),
    ],
)
def test_misuse_is_refused(receiver: socket.socket, image: np.ndarray, later_us: int, message: str) -> None:
    with H264TsSender("127.0.0.1", receiver.getsockname()[1], *SIZE) as sender:
        sender.send(picture_with_number(0, SIZE), START_US)
        with pytest.raises(ValueError, match=message):
            sender.send(image, START_US + later_us)


def test_odd_sizes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="even sides"):
        H264TsSender("127.0.0.1", 9, 321, 240)


def test_file_keeps_order_and_times(tmp_path: Path) -> None:
    """Every picture is in the mp4, at its exposure time, and the same pictures give the same file."""
    times_us = [START_US + 40_000 * n + 900 * (n % 3) for n in range(40)]
    for name in ("a.mp4", "b.mp4"):
        with H264FileWriter(tmp_path / name, *SIZE, fps=25) as writer:
            for n, t_us in enumerate(times_us):
                writer.write(np.dstack([picture_with_number(n, SIZE)] * 3), t_us)

    with av.open(str(tmp_path / "a.mp4")) as container:
        frames = list(container.decode(video=0))
    assert [number_in(f.to_ndarray(format="gray")) for f in frames] == list(range(40))
    # The container's clock ticks every 11 us.
    assert [f.time - frames[0].time for f in frames] == pytest.approx(
        [(t - START_US) / 1e6 for t in times_us], abs=2e-5
    )
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
