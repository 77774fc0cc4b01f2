"""Test pictures that show a number as sixteen black or white squares, so that coding loss cannot change it."""

from __future__ import annotations

import numpy as np

from estimator.types import Image

BITS = 16
SQUARE_PX = 16


def picture_with_number(number: int, size: tuple[int, int] = (320, 240)) -> Image:
    """Grey picture of textured ground with ``number`` along its top edge; ``size`` is (width, height)."""
    width, height = size
    rows, columns = np.mgrid[0:height, 0:width]
    image = (128 + 40 * np.sin((columns + 3 * number) / 9.0) * np.cos(rows / 7.0)).astype(np.uint8)
    for bit in range(BITS):
        image[0:SQUARE_PX, bit * SQUARE_PX : (bit + 1) * SQUARE_PX] = 230 if number >> bit & 1 else 25
    return image


def number_in(image: Image) -> int:
    """The number that a picture shows; grey or BGR."""
    grey = image if image.ndim == 2 else image.mean(axis=2)
    centre = grey[SQUARE_PX // 2 - 3 : SQUARE_PX // 2 + 3]
    middles = [centre[:, b * SQUARE_PX + 5 : b * SQUARE_PX + 11].mean() for b in range(BITS)]
    return sum(int(level > 128) << bit for bit, level in enumerate(middles))
