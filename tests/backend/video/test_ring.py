from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

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
