from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from backend.video.catch_up import pictures_after
from backend.video.errors import FrameNotFoundError, UndecodableFrameError
from backend.video.jpeg import encode_jpeg
from backend.video.ring import FrameRing
from tests.backend.video.coded import encoded_frames
from tests.backend.video.pictures_with_numbers import number_in, picture_with_number

FRAMES = encoded_frames(100, gop=10, first_id=1000)


def filled(seconds: float = 60, max_bytes: int = 10**8) -> FrameRing:
    ring = FrameRing(seconds, max_bytes)
    for frame in FRAMES:
        ring.append(frame)
    return ring


@pytest.mark.parametrize("n", [0, 1, 9, 10, 57, 99])
def test_a_number_gives_exactly_its_picture(n: int) -> None:
    ring = filled()

    assert ring.get(1000 + n) is FRAMES[n]
    assert number_in(ring.image(1000 + n)) == n
    decoded = cv2.imdecode(np.frombuffer(ring.jpeg(1000 + n), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert number_in(np.asarray(decoded, np.uint8)) == n


def test_old_groups_go_whole() -> None:
    """Two seconds are asked for: whatever is held begins with a key frame and spans at least that."""
    ring = filled(seconds=2)

    with pytest.raises(FrameNotFoundError, match="frames 1040 to 1099 are held"):
        ring.get(1039)
    assert [f.frame_id for f in ring.from_key(1049)] == list(range(1040, 1050))
    assert ring.byte_count == sum(len(f.payload) for f in FRAMES[40:])


def test_memory_is_bounded() -> None:
    limit = sum(len(f.payload) for f in FRAMES[60:]) + 10
    ring = filled(max_bytes=limit)

    assert ring.byte_count <= limit
    assert ring.get(1099) is FRAMES[99]


def test_one_endless_group_is_bounded_too() -> None:
    ring = FrameRing(60, max_bytes=50_000)
    for n, frame in enumerate(FRAMES):
        ring.append(replace(frame, key=n == 0))

    assert ring.byte_count <= 50_000


def test_newest_group() -> None:
    assert [f.frame_id for f in filled().newest_group()] == list(range(1090, 1100))
    assert FrameRing().newest_group() == []


def test_absent_and_damaged_frames_are_told_apart() -> None:
    ring = FrameRing()
    with pytest.raises(FrameNotFoundError, match="no frame is held"):
        ring.jpeg(3)
    ring.append(FRAMES[1])  # its key frame is not there
    with pytest.raises(FrameNotFoundError):
        ring.get(1001)
    ring.append(FRAMES[10])
    ring.append(replace(FRAMES[11], payload=b"\x00\x00\x00\x01\x41 nothing that decodes"))
    with pytest.raises(UndecodableFrameError):
        ring.jpeg(1011)


def test_jpeg_frames_are_handed_out_as_they_are() -> None:
    ring = FrameRing()
    payload = encode_jpeg(picture_with_number(5))
    ring.append(replace(FRAMES[0], codec="jpeg", payload=payload))

    assert ring.jpeg(1000) == payload
    assert number_in(ring.image(1000)) == 5


def test_who_begins_late_sees_everything_since_in_steps() -> None:
    ring = filled()
    pictures = pictures_after(ring, 1013, 100_000)
    first = [next(pictures) for _ in range(3)]
    rest = list(pictures)

    # 40 ms apart: at least 100 ms are three frames
    assert [frame.frame_id for frame, _ in first] == [1016, 1019, 1022]
    assert [number_in(image) for _, image in first] == [16, 19, 22]
    assert rest[-1][0].frame_id == 1097
    assert [number_in(image) for _, image in rest] == list(range(25, 100, 3))


def test_frames_that_come_meanwhile_are_seen_too_and_those_gone_end_it() -> None:
    ring = FrameRing()
    for frame in FRAMES[:20]:
        ring.append(frame)
    pictures = pictures_after(ring, 1000, 400_000)
    seen = [next(pictures)[0].frame_id]
    for frame in FRAMES[20:40]:
        ring.append(frame)
    seen += [frame.frame_id for frame, _ in pictures]

    assert seen == [1010, 1020, 1030]
    assert list(pictures_after(ring, 5, 0)) == []
    with pytest.raises(FrameNotFoundError):
        ring.after(5)


def test_jpeg_frames_are_caught_up_with_as_well() -> None:
    ring = FrameRing()
    for n, frame in enumerate(FRAMES[:6]):
        jpeg = encode_jpeg(np.asarray(picture_with_number(n)))
        ring.append(replace(frame, codec="jpeg", key=True, payload=jpeg))

    assert [number_in(image) for _, image in pictures_after(ring, 1001, 0)] == [2, 3, 4, 5]
