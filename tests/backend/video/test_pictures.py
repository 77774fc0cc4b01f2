from __future__ import annotations

import av
import numpy as np
import pytest

from backend.video.pictures import bgr_from_frame, grey_from_frame

# Smooth colours: chroma is stored at half the resolution.
ROWS, COLUMNS = np.mgrid[0:96, 0:130]
BGR = np.dstack([ROWS * 2, COLUMNS + 60, 200 - ROWS]).clip(0, 255).astype(np.uint8)
LUMA = 0.114 * BGR[..., 0] + 0.587 * BGR[..., 1] + 0.299 * BGR[..., 2]


@pytest.mark.parametrize("pixels", ["yuv420p", "yuvj420p", "yuv422p", "nv12", "rgb24", "bgr24", "yuv420p10le"])
def test_colours_survive(pixels: str) -> None:
    frame = av.VideoFrame.from_ndarray(BGR, format="bgr24").reformat(format=pixels, threads=1)

    colours = bgr_from_frame(frame)

    assert colours.shape == BGR.shape
    # Half-resolution chroma and rounding of either conversion cost a few levels.
    assert np.abs(colours.astype(int) - BGR).mean() < 3


@pytest.mark.parametrize("pixels", ["yuv420p", "yuvj420p", "yuv422p", "nv12", "gray", "rgb24", "yuv420p10le"])
def test_grey_is_brightness(pixels: str) -> None:
    """Up to the coded range: a straight line of slope 219/255 or 1."""
    frame = av.VideoFrame.from_ndarray(BGR, format="bgr24").reformat(format=pixels, threads=1)

    grey = grey_from_frame(frame)

    assert grey.shape == LUMA.shape
    assert grey.flags.owndata
    slope, offset = np.polyfit(LUMA.ravel(), grey.ravel(), 1)
    assert slope == pytest.approx(219 / 255, abs=0.01) or slope == pytest.approx(1, abs=0.01)
    assert np.abs(slope * LUMA + offset - grey).max() < 4
