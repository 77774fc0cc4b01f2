from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.video.decoder import PictureDecoder, decode_last, image_from_jpeg
from backend.video.errors import UndecodableFrameError
from backend.video.jpeg import encode_jpeg
from backend.video.pictures import grey_from_frame
from tests.backend.video.coded import encoded_frames, h264_units
from tests.backend.video.pictures_with_numbers import number_in, picture_with_number

UNITS = h264_units(20)


@pytest.mark.parametrize("codec", ["h264", "hevc"])
def test_each_picture_comes_at_once_under_its_own_number(codec: str) -> None:
    units = UNITS if codec == "h264" else h264_units(20, codec="libx265")
    decoder = PictureDecoder(codec)
    for n, unit in enumerate(units):
        ((number, frame),) = decoder.decode(unit, 500 + n)
        assert (number, number_in(grey_from_frame(frame))) == (500 + n, n)
    assert decoder.errors == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 19), st.binary(max_size=300))
def test_garbage_is_counted_and_the_next_key_frame_heals(where: int, garbage: bytes) -> None:
    decoder = PictureDecoder("h264")
    for n, unit in enumerate(UNITS):
        decoder.decode(garbage if n == where else unit, n)
    shown = [
        (number, number_in(grey_from_frame(f))) for k, u in enumerate(UNITS) for number, f in decoder.decode(u, 100 + k)
    ]

    assert shown[-1] == (119, 19)


def test_the_last_of_a_group() -> None:
    frames = encoded_frames(12)

    assert number_in(grey_from_frame(decode_last(frames[:8]))) == 7
    with pytest.raises(UndecodableFrameError):
        decode_last(frames[3:8])


def test_jpeg() -> None:
    payload = encode_jpeg(np.dstack([picture_with_number(9)] * 3))

    grey, colour = image_from_jpeg(payload, colour=False), image_from_jpeg(payload, colour=True)

    assert grey is not None
    assert colour is not None
    assert number_in(grey) == number_in(colour) == 9
    assert image_from_jpeg(b"", colour=True) is None
    assert image_from_jpeg(b"\xff\xd8 no picture", colour=True) is None
