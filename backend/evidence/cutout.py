"""The picture of a target: a square about the pixel that was clicked, out of the picture kept as evidence."""

from __future__ import annotations

import math

import cv2
import numpy as np

from backend.errors import NoEvidenceError
from backend.evidence.bundle import Bundle
from backend.video.jpeg import encode_jpeg

QUALITY = 85


def cutout(bundle: Bundle, size_px: int) -> bytes:
    """JPEG of ``size_px`` x ``size_px`` pixels of the video with the clicked one at row and column ``size_px // 2``.

    What lies outside the video is black.

    Raises
    ------
    NoEvidenceError
        No picture was kept, or what was kept is none.
    """
    evidence = bundle.evidence
    if bundle.picture is None:
        raise NoEvidenceError(evidence.target.id, f"no picture was kept: {evidence.picture.problem}")
    picture = cv2.imdecode(np.frombuffer(bundle.picture, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise NoEvidenceError(evidence.target.id, "the picture that was kept cannot be read")
    half = size_px // 2
    # The kept picture may be smaller than the video was; pixel (0, 0) is the centre of the first.
    scale = picture.shape[1] / evidence.frame.width_px
    column = math.floor((evidence.click.u_px + 0.5) * scale)
    row = math.floor((evidence.click.v_px + 0.5) * scale)
    left, top = column - half, row - half
    cut = np.zeros((size_px, size_px, 3), np.uint8)
    inside = picture[max(top, 0) : max(top + size_px, 0), max(left, 0) : max(left + size_px, 0)]
    at_row, at_col = max(-top, 0), max(-left, 0)
    cut[at_row : at_row + inside.shape[0], at_col : at_col + inside.shape[1]] = inside
    return encode_jpeg(cut, QUALITY)
