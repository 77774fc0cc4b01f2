"""Whether a picture shows enough to navigate by."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.types import Image

REDUCTION = 4
TILES = (6, 8)
MIN_TEXTURE = 1.5
"""Grey levels. Fields show 6 and more, haze that can be seen through 2, the noise of a dark or capped camera 1."""
SATURATED, MAX_SATURATED = 250, 0.1
"""Grey level of a pixel that is full, and the share of them beyond which a light shines into the lens: its rim stands
still in the picture while the ground moves, and is followed for ground."""


def grey(image: Image) -> Image:
    """A picture (rows, cols), or (rows, cols, 3) in colour, as grey (rows, cols)."""
    return image if image.ndim == 2 else image.mean(axis=2).astype(np.uint8)


def texture(image: Image) -> float:
    """Median over tiles of the standard deviation of a grey picture (rows, cols), in grey levels.

    The picture is averaged first, so that noise does not count; the median lets one bright spot, or one dark, not
    stand for the whole.
    """
    rows, cols = (max(side // REDUCTION, n) for side, n in zip(image.shape, TILES, strict=True))
    small = cv2.resize(image, (cols, rows), interpolation=cv2.INTER_AREA).astype(np.float32)
    high, wide = rows // TILES[0], cols // TILES[1]
    tiles = small[: high * TILES[0], : wide * TILES[1]].reshape(TILES[0], high, TILES[1], wide)
    return float(np.median(tiles.std(axis=(1, 3))))


class Repeats:
    """Tells pictures that repeat the last one: a still aircraft's differ by their noise at least."""

    def __init__(self, least_difference: float) -> None:
        self._least_difference = least_difference
        self._thumbnail: Image | None = None

    def last(self, image: Image) -> bool:
        """Whether a grey picture's mean change of grey since the one handed in before is below the least."""
        thumbnail = image[::REDUCTION, ::REDUCTION].copy()
        last, self._thumbnail = self._thumbnail, thumbnail
        if last is None or last.shape != thumbnail.shape:
            return False
        return float(np.mean(np.abs(thumbnail.astype(np.int16) - last))) < self._least_difference


def shows_ground(image: Image) -> bool:
    """Whether a grey picture (rows, cols) shows enough, and is not blinded, to be matched and followed."""
    if image.size == 0:
        return False
    saturated = float(np.mean(image[::REDUCTION, ::REDUCTION] >= SATURATED))
    return saturated <= MAX_SATURATED and texture(image) >= MIN_TEXTURE
