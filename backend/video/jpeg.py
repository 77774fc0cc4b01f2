"""JPEG pictures: writing them, and reading a picture's size without decoding it."""

from __future__ import annotations

import cv2

from estimator.types import Image

DEFAULT_QUALITY = 80
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_WITHOUT_LENGTH = frozenset({0x01, *range(0xD0, 0xDA)})


def encode_jpeg(image: Image, quality: int = DEFAULT_QUALITY) -> bytes:
    """JPEG of a grey (rows, columns) or BGR (rows, columns, 3) picture.

    Raises
    ------
    ValueError
        The array is not a picture.
    """
    try:
        done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    except cv2.error as error:
        raise ValueError(f"array of shape {image.shape} cannot be written as JPEG: {error}") from error
    if not done:
        raise ValueError(f"array of shape {image.shape} cannot be written as JPEG")
    return bytes(data)


def jpeg_size_px(data: bytes) -> tuple[int, int]:
    """Width and height that a JPEG's frame header states (ITU-T T.81, annex B).

    Raises
    ------
    ValueError
        The bytes are no JPEG, or end before the frame header.
    """
    if data[:2] != b"\xff\xd8":
        raise ValueError("not a JPEG: it does not begin with FF D8")
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            break
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
        elif marker in _START_OF_FRAME:
            return int.from_bytes(data[at + 7 : at + 9], "big"), int.from_bytes(data[at + 5 : at + 7], "big")
        elif marker in _WITHOUT_LENGTH:
            at += 2
        else:
            at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise ValueError("not a whole JPEG: it holds no frame header")
