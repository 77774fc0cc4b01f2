from __future__ import annotations

import numpy as np
import pytest

from backend.video.jpeg import encode_jpeg, jpeg_size_px
from tests.backend.video.pictures_with_numbers import picture_with_number


def test_size_is_read_from_the_header() -> None:
    assert jpeg_size_px(encode_jpeg(picture_with_number(5, (322, 241)))) == (322, 241)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8", b"\x89PNG\r\n", b"\xff\xd8" + b"\x00" * 40])
def test_other_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="not a"):
        jpeg_size_px(data)


def test_what_is_no_picture_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot be written as JPEG"):
        encode_jpeg(np.zeros((0, 4), np.uint8))
