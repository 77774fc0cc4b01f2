"""Rings in a picture: dark closed bands with a bright middle, both elliptical and concentric, over scales."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.landing.edges import edges_along
from estimator.types import Float, Image

_BLOCK_PX, _DARKER = 41, 7
_LEAST_PX, _MOST_PX = 8, 76
"""Widths of rings that are sought at each scale of the pyramid; twice the one and more is the other's part."""
_SMALLEST_PICTURE_PX = 60
_CONCENTRIC = 0.15
_POINTS = 32
_FEWEST_SHARE = 0.6
_ROUGHNESS = 0.06


@dataclass(frozen=True, slots=True, eq=False)
class Ellipse:
    """Centre and half axes in pixels, and the direction of the first axis."""

    u_px: float
    v_px: float
    a_px: float
    b_px: float
    angle_rad: float

    @property
    def size_px(self) -> float:
        """Radius of the circle of the same area."""
        return float(np.sqrt(self.a_px * self.b_px))

    def points(self, count: int) -> tuple[Float, Float]:
        """Evenly spread points (count, 2) and outward unit normals (count, 2)."""
        t = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        turn = np.array(((c, s), (-s, c)))
        flat = np.column_stack((self.a_px * np.cos(t), self.b_px * np.sin(t)))
        normal = np.column_stack((self.b_px * np.cos(t), self.a_px * np.sin(t)))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return flat @ turn + (self.u_px, self.v_px), normal @ turn


@dataclass(frozen=True, slots=True, eq=False)
class RingSeen:
    """A ring as seen: its outer ellipse, and the ratio of inner to outer radius."""

    outer: Ellipse
    ratio: float


def ring_levels(image: Image, most: int = 24) -> Iterator[list[RingSeen]]:
    """Rings of a grey picture (rows, cols), the largest first, after each scale from the coarsest to the finest."""
    pyramid = [image]
    while min(pyramid[-1].shape) >= 2 * _SMALLEST_PICTURE_PX:
        half = cv2.resize(pyramid[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        pyramid.append(np.asarray(half, np.uint8))
    found: list[RingSeen] = []
    for step in reversed(range(len(pyramid))):
        for outer, inner in _bands(pyramid[step]):
            ring = _refined(image, _enlarged(outer, 2.0**step), _enlarged(inner, 2.0**step))
            if ring is not None and not any(_same(ring, other) for other in found):
                found.append(ring)
        found.sort(key=lambda ring: -ring.outer.size_px)
        yield found[:most]


def _bands(image: Image) -> list[tuple[Ellipse, Ellipse]]:
    """Dark bands around one bright hole, of this scale's sizes."""
    dark = cv2.adaptiveThreshold(image, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, _BLOCK_PX, _DARKER)
    contours, tree = cv2.findContours(dark, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not len(contours):
        return []
    lengths = np.array([len(contour) for contour in contours])
    parents = tree[0, :, 3]
    holes = np.flatnonzero((parents >= 0) & (lengths >= 6) & (lengths <= 4 * _MOST_PX))
    holes = holes[(lengths[parents[holes]] >= 2 * _LEAST_PX) & (lengths[parents[holes]] <= 4 * _MOST_PX)]
    return [
        band for hole in holes.tolist() if (band := _band(contours[int(parents[hole])], contours[hole])) is not None
    ]


def _band(outside: NDArray[Any], inside: NDArray[Any]) -> tuple[Ellipse, Ellipse] | None:
    x, y, width, height = cv2.boundingRect(outside)
    if not (_LEAST_PX <= max(width, height) <= _MOST_PX and max(width, height) <= 3 * min(width, height)):
        return None
    x_in, y_in, width_in, height_in = cv2.boundingRect(inside)
    apart = max(abs(x + width / 2 - x_in - width_in / 2), abs(y + height / 2 - y_in - height_in / 2))
    if apart > _CONCENTRIC * max(width, height) or not 0.2 < width_in / width < 0.95:
        return None
    if len(inside) < 6:
        return None
    # Contours run through the dark pixels' centres: the edges lie half a pixel beyond.
    outer, inner = _fitted(outside.reshape(-1, 2), 0.5), _fitted(inside.reshape(-1, 2), -0.5)
    if outer is None or inner is None or inner.size_px < 1.0:
        return None
    return outer, inner


def _fitted(points: NDArray[Any], grow_px: float) -> Ellipse | None:
    """The ellipse through contour points, if they lie on one (Fitzgibbon, Pilu and Fisher, PAMI 21(5), 1999)."""
    (u, v), (width, height), angle = cv2.fitEllipseDirect(points.astype(np.float32))
    if not (np.isfinite((u, v, width, height, angle)).all() and min(width, height) > 1.0):
        return None
    ellipse = Ellipse(u, v, width / 2, height / 2, float(np.deg2rad(angle)))
    # Mean algebraic distance in units of the radius; pixel steps alone give up to a quarter of a pixel.
    c, s = np.cos(ellipse.angle_rad), np.sin(ellipse.angle_rad)
    x, y = points[:, 0] - u, points[:, 1] - v
    radius = np.hypot((c * x + s * y) / ellipse.a_px, (c * y - s * x) / ellipse.b_px)
    if float(np.mean(np.abs(radius - 1.0))) > _ROUGHNESS + 0.35 / ellipse.size_px:
        return None
    return Ellipse(u, v, ellipse.a_px + grow_px, ellipse.b_px + grow_px, ellipse.angle_rad)


def _enlarged(ellipse: Ellipse, scale: float) -> Ellipse:
    """The same in a picture ``scale`` times as large; pixel (0, 0) is a pixel's centre."""
    half = 0.5 * (scale - 1.0)
    return Ellipse(
        ellipse.u_px * scale + half, ellipse.v_px * scale + half, ellipse.a_px * scale, ellipse.b_px * scale,
        ellipse.angle_rad,
    )  # fmt: skip


def _refined(image: Image, outer: Ellipse, inner: Ellipse) -> RingSeen | None:
    """Both ellipses through sub-pixel edges; None where edges of the right sign are missing."""
    reach = max(1.5, 0.45 * (outer.size_px - inner.size_px))
    fine = [_through_edges(image, one, rises, reach) for one, rises in ((outer, 1.0), (inner, -1.0))]
    if fine[0] is None or fine[1] is None:
        return None
    apart = np.hypot(fine[0].u_px - fine[1].u_px, fine[0].v_px - fine[1].v_px)
    ratio = fine[1].size_px / fine[0].size_px
    if apart > 0.5 + 0.1 * fine[0].size_px or not 0.15 < ratio < 0.9:
        return None
    return RingSeen(fine[0], ratio)


def _through_edges(image: Image, ellipse: Ellipse, rises: float, reach_px: float) -> Ellipse | None:
    points, normals = ellipse.points(_POINTS)
    offsets, _ = edges_along(image, points, normals, np.full(_POINTS, rises), reach_px)
    there = np.isfinite(offsets)
    if np.count_nonzero(there) < _FEWEST_SHARE * _POINTS:
        return None
    # What lies off the others is another edge.
    there &= np.abs(offsets - np.nanmedian(offsets)) < max(1.0, 0.15 * ellipse.size_px)
    if np.count_nonzero(there) < _FEWEST_SHARE * _POINTS:
        return None
    on = points[there] + normals[there] * offsets[there, np.newaxis]
    (u, v), (width, height), angle = cv2.fitEllipseDirect(on.astype(np.float32))
    if not (np.isfinite((u, v, width, height, angle)).all() and min(width, height) > 1.0):
        return None
    return Ellipse(u, v, width / 2, height / 2, float(np.deg2rad(angle)))


def _same(ring: RingSeen, other: RingSeen) -> bool:
    apart = np.hypot(ring.outer.u_px - other.outer.u_px, ring.outer.v_px - other.outer.v_px)
    return bool(apart < 0.3 * ring.outer.size_px and 0.8 < ring.outer.size_px / other.outer.size_px < 1.25)
