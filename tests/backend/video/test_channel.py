"""From the sender's socket to frames and pictures, over the real loopback."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from backend.clock import unix_us
from backend.video.channel import VideoChannel
from backend.video.frames import DecodedFrame, VideoStatus
from backend.video.misp import insert_sei
from backend.video.writer import TsWriter
from simulator.video_out import H264FileWriter, H264TsSender
from tests.backend.video.coded import encoded_frames, h264_units
from tests.backend.video.collector import Collector, free_udp_port
from tests.backend.video.pictures_with_numbers import number_in, picture_with_number
from tests.backend.video.rtp_sender import RtpSender, sdp
from tests.backend.video.test_mpegts import transport_stream

SIZE = (320, 240)


@pytest.fixture
def port() -> int:
    return free_udp_port()


@pytest.fixture
def udp() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        yield sock


def receiver(port: int, **options: object) -> Collector:
    return Collector(f"udp://127.0.0.1:{port}", **options)


def send_in_step(sender: H264TsSender, taking: Collector, numbers: range, size: tuple[int, int] = SIZE) -> list[int]:
    """Send pictures, each once the one before has come out decoded; returns their exposure times."""
    times = []
    for n in numbers:
        t_us = unix_us()
        before = len(taking.decoded)
        sender.send(picture_with_number(n, size), t_us)
        times.append(t_us)
        taking.wait_for(lambda before=before: len(taking.decoded) > before, f"picture {n}")
    return times


def test_every_stamp_survives_exactly(port: int) -> None:
    """Each picture sent comes out coded and decoded with its own exposure time, and shows its own number."""
    with receiver(port) as taking, H264TsSender("127.0.0.1", port, *SIZE) as sender:
        taking.wait_for_text(f"waiting for MPEG-TS on UDP port {port}: nothing received yet")
        times = send_in_step(sender, taking, range(60))
        held = [number_in(taking.channel.ring.image(f.frame_id)) for f in taking.encoded[::7]]
        health = taking.channel.health()

    assert [f.t_us for f in taking.encoded] == times == [f.t_us for f in taking.decoded]
    assert [f.frame_id for f in taking.encoded] == list(range(60)) == [f.frame_id for f in taking.decoded]
    assert [number_in(f.image) for f in taking.decoded] == list(range(60))
    assert held == list(range(0, 60, 7))
    assert all(f.t_us <= f.t_wire_us for f in taking.encoded)
    assert [n for n, f in enumerate(taking.encoded) if f.key] == [0, 25, 50]
    assert (health.status, health.decode_errors, health.width, health.codec) == (VideoStatus.FLOWING, 0, 320, "h264")


def test_stamps_go_through_the_vehicles_clock(port: int) -> None:
    with receiver(port, map_vehicle_unix=lambda t: t + 5_000) as taking:
        taking.wait_for_text("nothing received")
        with H264TsSender("127.0.0.1", port, *SIZE) as sender:
            times = [unix_us() - 20_000]
            sender.send(picture_with_number(1, SIZE), times[0])
            taking.wait_for(lambda: len(taking.decoded) == 1, "a picture")

    assert taking.decoded[0].t_us == times[0] + 5_000


def test_random_bytes_first_and_in_between(port: int, udp: socket.socket) -> None:
    """Fault: random datagrams. Expected: named in the health, and pictures come all the same."""
    rng = np.random.default_rng(5)
    with receiver(port) as taking, H264TsSender("127.0.0.1", port, *SIZE) as sender:
        taking.wait_for_text("nothing received")
        udp.sendto(bytes(300), ("127.0.0.1", port))
        taking.wait_for_text("300 bytes came, but they are no MPEG-TS")
        for n in range(40):
            # Without the sync byte: noise that imitates packets is in the tests of the demultiplexer.
            noise = rng.bytes(int(rng.integers(1, 1400))).replace(b"\x47", b"\x48")
            udp.sendto(noise, ("127.0.0.1", port))
            send_in_step(sender, taking, range(n, n + 1))

    assert [number_in(f.image) for f in taking.decoded] == list(range(40))


def test_lost_and_swapped_datagrams_give_no_false_picture(port: int, udp: socket.socket) -> None:
    """Fault: one datagram in nine lost, one in seven swapped. Expected: whole pictures or none, then all again."""
    coded = h264_units(125)
    t0_us = unix_us()
    units = [insert_sei(u, t0_us + 40 * n) for n, u in enumerate(coded)]
    with receiver(port) as taking:
        taking.wait_for_text("nothing received")
        datagrams = []
        for n, part in enumerate(transport_stream(units, lengths=True)):
            cut = [part[at : at + 1316] for at in range(0, len(part), 1316)]
            datagrams += cut if n >= 100 else [d for k, d in enumerate(cut) if (n + k) % 9 or n % 25 == 0]
        for n in range(30, len(datagrams) - 200, 7):
            datagrams[n], datagrams[n + 1] = datagrams[n + 1], datagrams[n]
        for datagram in datagrams:
            udp.sendto(datagram, ("127.0.0.1", port))
        taking.wait_for(lambda: bool(taking.decoded) and number_in(taking.decoded[-1].image) == 124, "the last picture")

    assert all(f.t_us == t0_us + 40 * number_in(f.image) for f in taking.decoded)
    shown = [number_in(f.image) for f in taking.decoded]
    assert shown == sorted(set(shown))
    assert len(shown) < 125


def test_a_stream_that_stops_and_comes_back(port: int) -> None:
    """Fault: the sender dies; another begins. Expected: stopped and why, then a new epoch with numbers going on."""
    ahead_us = 0
    with receiver(port, clock=lambda: unix_us() + ahead_us) as taking:
        taking.wait_for_text("nothing received")
        with H264TsSender("127.0.0.1", port, *SIZE) as sender:
            send_in_step(sender, taking, range(5))
        # The receiver's clock is moved instead of waiting for the silence.
        ahead_us = 3_000_000
        taking.wait_for(lambda: taking.channel.health().status is VideoStatus.STOPPED, "stopped")
        taking.wait_for_text(f"waiting for MPEG-TS on UDP port {port}: nothing received yet")
        ahead_us = 0
        with H264TsSender("127.0.0.1", port, *SIZE) as sender:
            send_in_step(sender, taking, range(10, 15))
        assert taking.channel.health().status is VideoStatus.FLOWING

    assert [f.frame_id for f in taking.decoded] == list(range(10))
    assert [number_in(f.image) for f in taking.decoded] == [0, 1, 2, 3, 4, 10, 11, 12, 13, 14]
    assert [f.epoch for f in taking.decoded] == [1] * 5 + [2] * 5


def test_a_change_of_size(port: int) -> None:
    """Fault: the picture's size changes in mid-stream. Expected: a new epoch, every picture whole."""
    with receiver(port) as taking:
        taking.wait_for_text("nothing received")
        for first, size in ((0, SIZE), (5, (640, 480)), (10, (352, 288))):
            with H264TsSender("127.0.0.1", port, *size) as sender:
                send_in_step(sender, taking, range(first, first + 5), size)

    assert [number_in(f.image) for f in taking.decoded] == list(range(15))
    assert [f.image.shape for f in taking.decoded] == [(240, 320)] * 5 + [(480, 640)] * 5 + [(288, 352)] * 5
    epochs = [f.epoch for f in taking.decoded]
    assert epochs == sorted(epochs)
    assert len(set(epochs)) == 3


def test_a_frozen_picture_is_seen(port: int) -> None:
    """Fault: the same picture is sent for more than a second of the receiver's clock. Expected: frozen."""
    now_us = unix_us()
    with receiver(port, clock=lambda: now_us) as taking, H264TsSender("127.0.0.1", port, *SIZE) as sender:
        taking.wait_for_text("nothing received")
        statuses = []
        for n in range(60):
            now_us += 40_000
            before = len(taking.decoded)
            sender.send(picture_with_number(min(n, 20), SIZE), now_us)
            taking.wait_for(lambda before=before: len(taking.decoded) > before, f"picture {n}")
            statuses.append(taking.channel.health().status)

    assert set(statuses[:20]) == {VideoStatus.FLOWING}
    assert statuses[-1] is VideoStatus.FROZEN


def test_a_slow_consumer_gets_the_newest(port: int) -> None:
    """Fault: whoever takes pictures hangs. Expected: coded frames go on at once; then it is given the newest."""
    release, last_shown = threading.Event(), threading.Event()
    shown: list[int] = []

    def slow(frame: DecodedFrame) -> None:
        shown.append(number_in(frame.image))
        if shown[-1] == 199:
            last_shown.set()
        release.wait(20)

    encoded = threading.Semaphore(0)
    channel = VideoChannel(f"udp://127.0.0.1:{port}", on_encoded=lambda _: encoded.release(), on_decoded=slow)
    channel.start()
    try:
        with H264TsSender("127.0.0.1", port, *SIZE) as sender:
            # Again until the port is open: what is sent to a closed one is gone.
            while not encoded.acquire(timeout=0.2):
                sender.send(picture_with_number(0, SIZE), unix_us())
            for n in range(1, 200):
                sender.send(picture_with_number(n, SIZE), unix_us())
                # Coded frames come although nobody takes the pictures.
                assert encoded.acquire(timeout=20)
        release.set()
        assert last_shown.wait(20)
    finally:
        release.set()
        channel.close()

    assert len(shown) < 40
    assert channel.dropped_pictures + len(shown) >= 200


def test_rtp_with_an_sdp(port: int, tmp_path: Path) -> None:
    """The SDP is not there at first; then RTP as FFmpeg sends it comes out picture by picture."""
    file = tmp_path / "camera.sdp"
    with Collector(f"rtp:{file}") as taking:
        taking.wait_for_text(f"waiting for the SDP file {file}: no such file")
        file.write_text("v=0\r\n")
        taking.wait_for_text("cannot be used: it has no line 'm=video")
        file.write_text(sdp(port))
        taking.wait_for_text(f"waiting for RTP on UDP port {port}: nothing received yet")
        t0_us = unix_us()
        with RtpSender(port) as sender:
            for n, unit in enumerate(h264_units(40)):
                sender.send(insert_sei(unit, t0_us + n))
                taking.wait_for(lambda n=n: len(taking.decoded) > n, f"picture {n}")

    assert [f.t_us - t0_us for f in taking.decoded] == list(range(40)) == [number_in(f.image) for f in taking.decoded]


def test_h265_becomes_jpeg(port: int, udp: socket.socket) -> None:
    """No browser takes H.265 as it is: it comes out as JPEG, said so in the codec, every picture a key frame."""
    with receiver(port) as taking:
        taking.wait_for_text("nothing received")
        for part in transport_stream(h264_units(10, codec="libx265"), lengths=True, codec="hevc"):
            udp.sendto(part, ("127.0.0.1", port))
        taking.wait_for(lambda: len(taking.decoded) == 10, "ten pictures")

    assert {(f.codec, f.codec_string, f.key, f.width, f.height) for f in taking.encoded} == {
        ("jpeg", "jpeg", True, *SIZE)
    }
    pictures = [cv2.imdecode(np.frombuffer(f.payload, np.uint8), cv2.IMREAD_GRAYSCALE) for f in taking.encoded]
    assert [number_in(np.asarray(p, np.uint8)) for p in pictures] == list(range(10))
    assert [(f.frame_id, number_in(f.image)) for f in taking.decoded] == [(n, n) for n in range(10)]


def test_a_stream_without_key_frames_becomes_jpeg(port: int, udp: socket.socket) -> None:
    """An encoder that refreshes in stripes sends no key frame to join at: after 3 s of it pictures come as JPEG."""
    units = h264_units(180, more=":intra-refresh=1")[10:]
    with receiver(port) as taking:
        taking.wait_for_text("nothing received")
        for part in transport_stream(units, lengths=True):
            udp.sendto(part, ("127.0.0.1", port))
        taking.wait_for(lambda: bool(taking.decoded) and number_in(taking.decoded[-1].image) == 179, "the last picture")

    assert {f.codec for f in taking.encoded} == {"jpeg"}
    assert len(taking.decoded) >= 40


def test_jpeg_beside_h264_when_wanted(port: int) -> None:
    with receiver(port) as taking, H264TsSender("127.0.0.1", port, *SIZE) as sender:
        taking.wait_for_text("nothing received")
        taking.channel.jpeg_wanted = True
        send_in_step(sender, taking, range(5))
        taking.wait_for(lambda: len(taking.jpegs) == 5, "five JPEGs")

    assert [(j.frame_id, j.t_us) for j in taking.jpegs] == [(f.frame_id, f.t_us) for f in taking.encoded]
    pictures = [cv2.imdecode(np.frombuffer(j.payload, np.uint8), cv2.IMREAD_GRAYSCALE) for j in taking.jpegs]
    assert [number_in(np.asarray(p, np.uint8)) for p in pictures] == list(range(5))


def test_a_port_in_use_is_said_and_tried_again(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        with receiver(port) as taking:
            taking.wait_for_text(f"waiting for UDP port {port}")
            taking.wait_for_text("does another program use it?")
            other.close()
            taking.wait_for_text("nothing received yet")


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("device:/dev/video-none", "waiting for the camera /dev/video-none: no such device"),
        ("file:/nowhere/flight.mp4", "waiting for the file /nowhere/flight.mp4: no such file or folder"),
        ("rtp:/nowhere/camera.sdp", "waiting for the SDP file /nowhere/camera.sdp: no such file"),
    ],
)
def test_what_is_absent_is_waited_for(url: str, text: str) -> None:
    with Collector(url) as taking:
        taking.wait_for_text(text)
        assert taking.channel.health().status is VideoStatus.WAITING


def test_rtsp_that_does_not_answer() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as closed:
        closed.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{closed.getsockname()[1]}"
        with Collector(f"rtsp://user:secret@{address}/stream") as taking:
            taking.wait_for_text(f"waiting for rtsp://{address}/stream: cannot connect")
            assert "trying again" in taking.channel.health().text
            assert "secret" not in taking.channel.health().text


def test_a_file_plays_in_order_and_again(tmp_path: Path) -> None:
    """With ?loop the file begins again in a new epoch; numbers never repeat."""
    path = tmp_path / "flight.mp4"
    with H264FileWriter(path, *SIZE, fps=100) as writer:
        for n in range(10):
            writer.write(picture_with_number(n, SIZE), 10_000 * n)
    with Collector(f"file:{path}?loop") as taking:
        taking.wait_for(lambda: len(taking.encoded) >= 25, "two and a half rounds")

    frames = taking.encoded[:25]
    assert [f.frame_id for f in frames] == list(range(25))
    assert [f.epoch for f in frames] == [1] * 10 + [2] * 10 + [3] * 5
    shown = {f.frame_id: number_in(f.image) for f in taking.decoded}
    assert all(number == frame_id % 10 for frame_id, number in shown.items())
    # PTS ticks of 11 us; a picture less delayed than all before it moves the times a little.
    assert all(0 < pace < 10_012 for pace in np.diff([f.t_us for f in frames[:10]]))


def test_a_corrupt_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "flight.mp4"
    path.write_bytes(b"\x00\x00\x00\x18ftypmp42" + bytes(range(256)) * 20)
    with Collector(f"file:{path}") as taking:
        taking.wait_for_text(f"waiting for the file {path}: it cannot be read as video")


def test_a_recording_of_the_stream_plays(port: int, tmp_path: Path) -> None:
    """What the channel hands on can be written and played back, frame for frame."""
    with receiver(port) as taking, H264TsSender("127.0.0.1", port, *SIZE) as sender:
        taking.wait_for_text("nothing received")
        send_in_step(sender, taking, range(30))
    with TsWriter(tmp_path / "video.ts") as writer:
        for frame in taking.encoded:
            writer.write(frame)

    with av.open(str(tmp_path / "video.ts")) as container:
        assert [number_in(f.to_ndarray(format="gray")) for f in container.decode(video=0)] == list(range(30))


def test_frames_without_stamp_follow_the_senders_clock(port: int, udp: socket.socket) -> None:
    """Plain H.264: exposures run at the even pace of the PTS, moved by the configured offset."""
    units = [f.payload for f in encoded_frames(30)]
    with receiver(port, time_offset_s=-0.05) as taking:
        taking.wait_for_text("nothing received")
        for n, part in enumerate(transport_stream(units, lengths=True)):
            udp.sendto(part, ("127.0.0.1", port))
            taking.wait_for(lambda n=n: len(taking.encoded) > n, f"frame {n}")

    first = taking.encoded[0]
    assert first.t_us == first.t_wire_us - 50_000
    # Sent much faster than 25 a second, so the sender's clock runs ahead and every arrival is the least delayed yet.
    assert all(f.t_us <= f.t_wire_us - 50_000 for f in taking.encoded)


def test_closing_ends_all_threads(port: int) -> None:
    before = set(threading.enumerate())
    with receiver(port) as taking:
        taking.wait_for_text("nothing received")
        assert len(set(threading.enumerate()) - before) == 2

    assert set(threading.enumerate()) <= before
