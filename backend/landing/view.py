"""The pad as seen from straight above: pictures warped to its plane, and where its pattern lies in the video."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from backend.video.jpeg import encode_jpeg
from estimator.geometry.camera import Camera
from estimator.landing.pad import Pad, TagPad
from estimator.landing.pose import PadPose
from estimator.types import Float, FrameSample, PadSeen

PICTURES_KEPT = 60  # the estimator tells of the pad in a picture when it has passed it, a second later or so
SIDE_PX = 320
_NODE_PX = 8
JPEG_QUALITY = 85
_MARGIN = 1.25
_RING_POINTS = 20
_NOT_SEEN = 40  # grey of what lies outside the picture
_BESIDE_PX = -1e6
_LEAST_RING_PX = 1.5


class Pictures:
    """The newest pictures as the estimator gets them; filled by the decoder's thread, read by any."""

    def __init__(self) -> None:
        self._kept: deque[FrameSample] = deque(maxlen=PICTURES_KEPT)
        self._lock = threading.Lock()

    def take(self, picture: FrameSample) -> None:
        """Keep a picture, in place of the oldest."""
        with self._lock:
            self._kept.append(picture)

    def clear(self) -> None:
        """Nobody looks for a pad."""
        with self._lock:
            self._kept.clear()

    def get(self, frame_id: int) -> FrameSample | None:
        """A picture, None when it is gone."""
        with self._lock:
            return next((picture for picture in reversed(self._kept) if picture.frame_id == frame_id), None)


@dataclass(frozen=True, slots=True)
class PadView:
    """A picture of the pad's plane: a square of ``side_m`` about its centre, pad's x up and y to the right; JPEG."""

    frame_id: int
    t_us: int
    side_m: float
    jpeg: bytes


def pad_view(picture: FrameSample, seen: PadSeen, camera: Camera, pad: Pad) -> PadView:
    """A picture warped to the pad's plane; ``seen`` is the pad in this very picture."""
    side_m = view_side_m(seen, camera, pad)
    # Through the lens for one in eight pixels each way and between them linearly: a row and column more on each side.
    nodes = SIDE_PX // _NODE_PX + 2
    steps = ((np.arange(nodes) - 0.5) * _NODE_PX / SIDE_PX - 0.5) * side_m
    y_m, x_m = np.meshgrid(steps, -steps)
    plane = np.stack((x_m, y_m, np.zeros_like(x_m)), axis=-1)
    coarse = camera.project(plane @ seen.camera_from_pad.T + seen.pad_in_camera_m).astype(np.float32)
    fine = cv2.resize(coarse, (nodes * _NODE_PX, nodes * _NODE_PX), interpolation=cv2.INTER_LINEAR)
    uv = np.nan_to_num(fine[_NODE_PX:-_NODE_PX, _NODE_PX:-_NODE_PX], nan=_BESIDE_PX)
    warped = cv2.remap(
        np.asarray(picture.image), uv[..., 0], uv[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
        borderValue=_NOT_SEEN,
    )  # fmt: skip
    jpeg = encode_jpeg(np.asarray(warped, np.uint8), JPEG_QUALITY)
    return PadView(seen.frame_id, seen.t_us, side_m, jpeg)


def view_side_m(seen: PadSeen, camera: Camera, pad: Pad) -> float:
    """How much of the pad's plane is shown: all of the pad, or from close by what the picture holds of it.

    It changes by steps of the square root of two, so that it does not breathe.
    """
    whole = 2.2 * max(abs(bound) for bound in pad.bounds_m)
    distance_m = float(np.linalg.norm(seen.pad_in_camera_m))
    in_picture = _MARGIN * distance_m * max(camera.width_px / camera.fx_px, camera.height_px / camera.fy_px)
    steps = max(0, math.floor(2.0 * math.log2(whole / max(in_picture, 1e-3))))
    return float(whole * 2.0 ** (-0.5 * steps))


def outlines_px(seen: PadSeen | PadPose, camera: Camera, pad: Pad) -> list[list[tuple[float, float]]]:
    """The pattern's outlines where a pose puts them in the picture: rings' outer edges, or tags' borders.

    Those that the picture does not hold, or that are too small to be seen, are left out.
    """
    uv = camera.project(_outlines_m(pad) @ seen.camera_from_pad.T + seen.pad_in_camera_m)
    shows = np.isfinite(uv).all(axis=(1, 2)) & camera.contains(uv).any(axis=1)
    shows &= np.nan_to_num(np.ptp(uv, axis=1)).max(axis=1) >= _LEAST_RING_PX
    return [[(u, v) for u, v in outline] for outline in uv[shows].round(1).tolist()]


@lru_cache(maxsize=4)
def _outlines_m(pad: Pad) -> Float:
    """Points (outlines, n, 3) of the pattern's outlines in the pad frame."""
    if isinstance(pad, TagPad):
        return np.stack([tag.corners_m for tag in pad.tags])
    angle = np.arange(_RING_POINTS) * (2.0 * math.pi / _RING_POINTS)
    around = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(_RING_POINTS)))
    return np.stack([np.array((ring.x_m, ring.y_m, 0.0)) + ring.outer_m * around for ring in pad.rings])
