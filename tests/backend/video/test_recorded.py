from __future__ import annotations

import math
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from backend.video.annexb import nal_type, nal_units
from backend.video.errors import FrameNotFoundError, RecordedVideoError, UndecodableFrameError
from backend.video.recorded import RecordedVideo
from tests.backend.video.pictures_with_numbers import number_in, picture_with_number
from tests.shared_data import shared_data


def write_video(
    path: Path,
    count: int,
    codec: str = "libx264",
    options: dict[str, str] | None = None,
    size: tuple[int, int] = (320, 240),
) -> None:
    """A file whose n-th picture shows the number n."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options or {})
        stream.width, stream.height = size
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for n in range(count):
            picture = av.VideoFrame.from_ndarray(picture_with_number(n, size), format="gray")
            container.mux(stream.encode(picture.reformat(format=stream.pix_fmt)))
        container.mux(stream.encode())


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("plain.mp4", "libx264", {"g": "25", "bf": "0"}),
        ("reordered.mp4", "libx264", {"g": "25", "bf": "3"}),
        ("reordered.mkv", "libx264", {"g": "25", "bf": "3"}),
        ("transport.ts", "libx264", {"g": "25", "bf": "2"}),
        ("old.avi", "libx264", {"g": "25", "bf": "0"}),
        ("hevc.mp4", "libx265", {"x265-params": "log-level=error:keyint=25:pools=1"}),
        ("motion.avi", "mjpeg", {}),
    ],
)
def test_every_picture_comes_once_in_order(tmp_path: Path, name: str, codec: str, options: dict[str, str]) -> None:
    """Numbers drawn into the pictures agree with the indices, from the start, from the middle, and one by one."""
    write_video(tmp_path / name, 60, codec, options)
    video = RecordedVideo.open(tmp_path / name)

    frames = list(video.frames())
    later = list(video.frames(37))

    assert video.frame_count == 60
    assert [f.index for f in frames] == list(range(60)) == [number_in(f.image) for f in frames]
    assert [f.index for f in later] == list(range(37, 60)) == [number_in(f.image) for f in later]
    assert [f.pts_s for f in frames] == pytest.approx([n / 25 for n in range(60)], abs=1e-3)
    for n in (59, 0, 24, 25, 26):
        assert number_in(video.frame(n, colour=False).image) == n


@pytest.mark.parametrize("name", ["a.mp4", "a.ts", "a.mkv"])
def test_packets_are_byte_stream_with_parameter_sets(tmp_path: Path, name: str) -> None:
    """A decoder that sees only the packets from any key frame on gives the right pictures under the right numbers."""
    write_video(tmp_path / name, 60, options={"g": "20", "bf": "2"})
    video = RecordedVideo.open(tmp_path / name)

    packets = list(video.packets(45))

    assert packets[0].key
    assert packets[0].index == 40
    assert {p.codec for p in packets} == {"h264"}
    assert all({7, 8} <= {nal_type(u) for u in nal_units(p.payload)} for p in packets if p.key)
    assert (packets[0].width_px, packets[0].height_px) == (320, 240)
    decoder = av.CodecContext.create("h264", "r")
    shown = []
    for recorded in packets:
        packet = av.Packet(recorded.payload)
        packet.pts = recorded.index
        shown += decoder.decode(packet)
    shown += decoder.decode(None)
    assert [f.pts for f in shown] == list(range(40, 60))
    assert [number_in(f.to_ndarray(format="gray")) for f in shown] == list(range(40, 60))


def test_other_codecs_become_jpeg(tmp_path: Path) -> None:
    """A browser that only takes H.264 still sees an H.265 recording."""
    write_video(tmp_path / "a.mp4", 8, "libx265", {"x265-params": "log-level=error:pools=1"})

    packets = list(RecordedVideo.open(tmp_path / "a.mp4").packets())

    assert {(p.codec, p.key, p.width_px, p.height_px) for p in packets} == {("jpeg", True, 320, 240)}
    images = [cv2.imdecode(np.frombuffer(p.payload, np.uint8), cv2.IMREAD_GRAYSCALE) for p in packets]
    assert [number_in(np.asarray(i, np.uint8)) for i in images] == list(range(8))


def test_copter_flight_has_every_frame() -> None:
    """The 2500 pictures that frames.csv lists come in order, 0.1 s apart."""
    folder = shared_data("flights/copter_120m")
    video = RecordedVideo.open(folder / "video.mp4")
    listed = (folder / "frames.csv").read_text().splitlines()[1:]
    times_us = [int(line.split(",")[1]) for line in listed]

    indices, pts_s = [], []
    for frame in video.frames():
        assert frame.image.shape == (480, 640)
        indices.append(frame.index)
        pts_s.append(frame.pts_s)

    assert indices == [int(line.split(",")[0]) for line in listed]
    # The container's clock ticks every 0.1 ms, the listed times are whole microseconds.
    assert np.abs(np.array(pts_s) - (np.array(times_us) - times_us[0]) / 1e6).max() < 2e-4
    assert video.decode_errors == 0


def test_grey_is_the_coded_brightness() -> None:
    """The grey picture equals the Y plane that FFmpeg hands out as grey."""
    video = RecordedVideo.open(shared_data("flights/copter_120m/video.mp4"))
    with av.open(str(video.path)) as container:
        expected = next(container.decode(video=0)).to_ndarray()[:480, :640]

    assert np.array_equal(next(video.frames()).image, expected)
    assert video.frame(0).image.shape == (480, 640, 3)


def test_folder_of_pictures() -> None:
    """The 118 pictures of a flight made of stills come in order, coded ones unchanged."""
    folder = shared_data("flights/ariel_b/frames")
    video = RecordedVideo.open(folder)

    packets = list(video.packets(100))

    assert (video.frame_count, video.width_px, video.height_px) == (118, 960, 540)
    assert [f.index for f in video.frames()] == list(range(118))
    assert [p.index for p in packets] == list(range(100, 118))
    assert packets[0].payload == (folder / "000100.jpg").read_bytes()
    assert (packets[0].width_px, packets[0].height_px) == (960, 540)
    assert math.isnan(packets[0].pts_s)
    assert video.frame(7).image.shape == (540, 960, 3)


def test_folder_with_gaps_and_damage(tmp_path: Path) -> None:
    """Fault: a missing number, a picture that is not one. Expected: the others keep their numbers."""
    for n in (3, 5, 9):
        cv2.imwrite(str(tmp_path / f"{n:06d}.png"), picture_with_number(n))
    (tmp_path / "000007.jpg").write_bytes(b"\xff\xd8 no picture")
    (tmp_path / "notes.txt").write_text("not a picture")
    video = RecordedVideo.open(tmp_path)

    assert [(f.index, number_in(f.image)) for f in video.frames()] == [(3, 3), (5, 5), (9, 9)]
    assert video.decode_errors == 1
    assert [p.index for p in video.packets(4)] == [5, 9]
    with pytest.raises(FrameNotFoundError):
        video.frame(4)
    with pytest.raises(UndecodableFrameError):
        video.frame(7)


def test_folder_with_two_pictures_of_one_number(tmp_path: Path) -> None:
    for name in ("1.png", "000001.png"):
        cv2.imwrite(str(tmp_path / name), picture_with_number(1))

    with pytest.raises(RecordedVideoError, match="both are frame 1"):
        RecordedVideo.open(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "empty"), (bytes(range(256)) * 40, "cannot be read as video"), (None, "no such file")],
)
def test_what_is_no_video_is_named(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "video.mp4"
    if content is not None:
        path.write_bytes(content)

    with pytest.raises(RecordedVideoError, match=message) as caught:
        RecordedVideo.open(path)
    assert str(path) in str(caught.value)


def test_truncated_mp4_is_named(tmp_path: Path) -> None:
    """An mp4 whose index was never written cannot be played, and the error says so."""
    write_video(tmp_path / "whole.mp4", 30)
    whole = (tmp_path / "whole.mp4").read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])

    with pytest.raises(RecordedVideoError, match="cannot be read as video"):
        RecordedVideo.open(tmp_path / "cut.mp4")


def test_damage_inside_costs_only_damaged_pictures(tmp_path: Path) -> None:
    """Fault: 2 kB of the picture data overwritten. Expected: numbers of the rest stay right."""
    write_video(tmp_path / "a.mp4", 75, options={"g": "25", "bf": "0"})
    data = bytearray((tmp_path / "a.mp4").read_bytes())
    start = data.index(b"mdat") + 4
    middle = start + (len(data) - start) // 3
    data[middle : middle + 2000] = bytes(b ^ 0x5A for b in data[middle : middle + 2000])
    (tmp_path / "a.mp4").write_bytes(data)
    video = RecordedVideo.open(tmp_path / "a.mp4")

    frames = list(video.frames())

    assert [f.index for f in frames] == sorted({f.index for f in frames})
    assert all(number_in(f.image) == f.index for f in frames if f.index >= 50)
    assert {f.index for f in frames} >= set(range(50, 75))


def test_frame_out_of_range(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mp4", 5)

    with pytest.raises(FrameNotFoundError, match="frames 0 to 4"):
        RecordedVideo.open(tmp_path / "a.mp4").frame(5)
