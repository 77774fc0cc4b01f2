from __future__ import annotations

from dataclasses import replace

from backend.video.annexb import PPS, SPS, START_CODE, nal_type, nal_units
from backend.video.frames import VideoUnit
from backend.video.identity import FrameMaker
from backend.video.jpeg import encode_jpeg
from backend.video.misp import insert_sei
from backend.video.timing import ExposureClock
from tests.backend.video.coded import h264_units
from tests.backend.video.pictures_with_numbers import picture_with_number

T0_US = 1_760_000_000_000_000


def units(count: int, size: tuple[int, int] = (320, 240), gop: int = 5) -> list[VideoUnit]:
    return [
        VideoUnit("h264", insert_sei(u, T0_US + 40_000 * n), 40_000 * n, T0_US + 40_000 * n + 9_000)
        for n, u in enumerate(h264_units(count, size, gop))
    ]


def maker() -> FrameMaker:
    return FrameMaker(ExposureClock())


def test_numbers_times_and_sizes() -> None:
    making = maker()
    frames = [making.frame(u) for u in units(12)]

    made = [f for f in frames if f is not None]
    assert [f.frame_id for f in made] == list(range(12))
    assert [f.t_us for f in made] == [T0_US + 40_000 * n for n in range(12)]
    assert [f.t_wire_us for f in made] == [T0_US + 40_000 * n + 9_000 for n in range(12)]
    assert [n for n, f in enumerate(made) if f.key] == [0, 5, 10]
    assert {(f.epoch, f.width, f.height, f.codec) for f in made} == {(1, 320, 240, "h264")}
    assert all(f.codec_string.startswith("avc1.42") for f in made)


def test_nothing_before_the_first_key_frame() -> None:
    making = maker()
    frames = [making.frame(u) for u in units(8)[2:]]

    assert [f is not None for f in frames] == [False, False, False, True, True, True]
    assert making.left_out == 3
    assert next(f for f in frames if f is not None).key


def test_after_a_loss_nothing_up_to_the_next_key_frame() -> None:
    """Fault: a picture is lost on the way. Expected: those that lean on it are left out, none of them is numbered."""
    making = maker()
    stream = units(12)
    stream[7] = replace(stream[7], after_loss=True)
    frames = [making.frame(u) for n, u in enumerate(stream) if n != 6]

    assert [f.t_us for f in frames if f is not None] == [T0_US + 40_000 * n for n in (0, 1, 2, 3, 4, 5, 10, 11)]
    assert [f.frame_id for f in frames if f is not None] == list(range(8))


def test_a_change_of_size_begins_an_epoch() -> None:
    making = maker()
    frames = [making.frame(u) for u in [*units(3), *units(3, (640, 480)), *units(2)]]

    assert [(f.epoch, f.width) for f in frames if f is not None] == [(1, 320)] * 3 + [(2, 640)] * 3 + [(3, 320)] * 2
    assert [f.frame_id for f in frames if f is not None] == list(range(8))


def test_a_restart_begins_an_epoch_at_a_key_frame() -> None:
    making = maker()
    making.restart()
    assert making.epoch == 1

    for unit in units(3):
        making.frame(unit)
    making.restart()
    making.restart()

    assert making.epoch == 2
    assert making.frame(units(2)[1]) is None
    frame = making.frame(units(1)[0])
    assert frame is not None
    assert (frame.frame_id, frame.epoch) == (3, 2)


def without_parameter_sets(payload: bytes) -> bytes:
    return b"".join(START_CODE + u for u in nal_units(payload) if nal_type(u) not in (SPS, PPS))


def test_every_key_frame_carries_parameter_sets() -> None:
    stream = units(12)
    bare = stream[:1] + [replace(u, payload=without_parameter_sets(u.payload)) for u in stream[1:]]
    making = maker()
    keys = [f for f in map(making.frame, bare) if f is not None and f.key]

    assert len(keys) == 3
    assert all({SPS, PPS} <= {nal_type(x) for x in nal_units(f.payload)} for f in keys)


def test_jpeg_frames() -> None:
    making = maker()
    whole = making.frame(VideoUnit("jpeg", encode_jpeg(picture_with_number(1)), None, T0_US))
    broken = making.frame(VideoUnit("jpeg", b"\xff\xd8 no picture", None, T0_US))

    assert whole is not None
    assert (whole.key, whole.codec, whole.width, whole.height) == (True, "jpeg", 320, 240)
    assert broken is None
    assert making.left_out == 1


def test_a_stream_without_key_frames_is_recognised() -> None:
    making = maker()
    stream = units(80, gop=200)
    for unit in stream[1:75]:
        making.frame(unit)
    assert not making.never_keyed

    for unit in stream[75:]:
        making.frame(unit)
    assert making.never_keyed
