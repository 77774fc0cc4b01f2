"""A landing pad and the ground around it from near by: what the rasters of the world are too coarse for.

The pad is drawn by its geometry in each picture: pixels that the edge of a ring passes are the mean of sixteen rays,
all others one. The ground gets grain of two sizes, since its raster of some decimetres is a blur from a few metres.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.camera import Camera
from estimator.landing.pad import Ring
from estimator.types import Float, Image
from simulator.random_streams import rng_for
from simulator.world.noise import FractalNoise
from simulator.world.pad_place import PadPlace
from simulator.world.pad_print import INK, PAPER, SUPERSAMPLING, Float32, Sheet, in_ring, in_sheet, on_plane
from simulator.world.patch import Patch

_SMALLEST_PX = 0.15
"""A ring of a smaller radius is grey dust on the sheet, and left out."""
_GRAINS = ((0.02, 0.6, 5, 0.11, 45.0), (0.002, 0.05, 4, 0.09, 4.0))
"""Of each grain: size of a texture's pixel, longest wave, octaves, strength, and height up to which it shows."""
_TEXTURE_PX = 1024
_CHUNK = 20_000
_COARSE_PX = 8
_LOWEST_M = -0.01


class PadView:
    """Draws a pad into the pictures of one camera."""

    def __init__(self, place: PadPlace, camera: Camera, seed: int) -> None:
        self.place, self._camera = place, camera
        u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        rays = camera.rays(np.stack((u, v), axis=-1))
        self._rays: Float32 = np.ascontiguousarray(rays[..., :2] / rays[..., 2:], dtype=np.float32)
        self._grain = [
            (gsd, _grain(seed, number, gsd, wave, octaves, strength), top)
            for number, (gsd, wave, octaves, strength, top) in enumerate(_GRAINS)
        ]

    def roughen(self, sharp: Image, col: Float32, row: Float32, ground: Patch, up_m: float) -> Image:
        """The ground's colours (rows, cols, 3), seen at ``col``, ``row`` of its raster, with grain where it is near.

        ``up_m`` is the camera's height in the world's frame.
        """
        height_m = up_m + float(self.place.pos_ned_m[2])
        row_0, col_0 = ground.row_col(self.place.pos_ned_m[:2]).tolist()
        for gsd_m, texture, top_m in self._grain:
            if height_m >= top_m:
                continue
            scale = ground.gsd_m / gsd_m
            right = cv2.addWeighted(col, scale, col, 0.0, _TEXTURE_PX / 2 - scale * col_0)
            down = cv2.addWeighted(row, scale, row, 0.0, _TEXTURE_PX / 2 - scale * row_0)
            grain = cv2.remap(texture, right, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
            sharp = np.asarray(cv2.multiply(sharp, cv2.merge([grain, grain, grain]), scale=1 / 128.0), np.uint8)
        return sharp

    def draw(self, sharp: Image, pos_ned_m: Float, ned_from_camera: Float) -> None:
        """Put the pad into a picture (rows, cols, 3) of the ground, in place."""
        camera_from_pad = ned_from_camera.T @ self.place.ned_from_pad
        centre = ned_from_camera.T @ (self.place.pos_ned_m - pos_ned_m)
        if float((pos_ned_m - self.place.pos_ned_m) @ self.place.ned_from_pad[:, 2]) > _LOWEST_M:
            return
        print_ = _Print(self._rays, camera_from_pad, centre)
        box = print_.box_of(self.place.pad.bounds_m)
        if box is None:
            return
        white = print_.sheet(box, self.place.pad.bounds_m)
        black = np.zeros_like(white)
        per_m = self._camera.fx_px / max(float(centre[2]), 0.05)
        for ring in self.place.pad.rings:
            part = print_.box_of(_square(ring))
            part = None if part is None else _common(part, box)
            if part is not None and ring.outer_m * per_m >= _SMALLEST_PX:
                inner = tuple(slice(p.start - b.start, p.stop - b.start) for p, b in zip(part, box, strict=True))
                black[inner] += print_.ring(part, ring)
        grey = cv2.addWeighted(black, INK - PAPER, black, 0.0, PAPER, dtype=cv2.CV_8U)
        colours = cv2.merge([grey, grey, grey])
        ground = np.ascontiguousarray(sharp[box])
        sharp[box] = cv2.blendLinear(colours, ground, white, np.float32(1.0) - white)


class _Print:
    """Shares of pixels that sheet and rings cover, for one pose."""

    def __init__(self, rays: Float32, camera_from_pad: Float, centre: Float) -> None:
        self._rays, self._camera_from_pad, self._centre = rays, camera_from_pad, centre
        self._coarse = self._on_plane(rays[::_COARSE_PX, ::_COARSE_PX])
        steps = [np.abs(np.gradient(self._coarse, axis=axis)) for axis in (0, 1)]
        self._steps = np.asarray(steps[0].sum(axis=-1) + steps[1].sum(axis=-1), np.float32)

    def _on_plane(self, rays: Float32) -> Float32:
        return on_plane(rays, self._camera_from_pad, self._centre)

    def box_of(self, square: Sheet) -> tuple[slice, slice] | None:
        """Rows and columns that may show a rectangle of the pad's plane: those of a coarse grid and one more."""
        x, y, step = self._coarse[..., 0], self._coarse[..., 1], self._steps
        shows = (x > square[0] - step) & (y > square[1] - step) & (x < square[2] + step) & (y < square[3] + step)
        rows, cols = np.flatnonzero(shows.any(axis=1)), np.flatnonzero(shows.any(axis=0))
        if not len(rows):
            return None
        height, width = self._rays.shape[:2]
        return (
            slice(max((int(rows[0]) - 1) * _COARSE_PX, 0), min((int(rows[-1]) + 2) * _COARSE_PX, height)),
            slice(max((int(cols[0]) - 1) * _COARSE_PX, 0), min((int(cols[-1]) + 2) * _COARSE_PX, width)),
        )

    def sheet(self, box: tuple[slice, slice], sheet: Sheet) -> Float32:
        """The share (rows, cols) that is on the sheet."""
        steps = self._steps
        reach_in = (sheet[0] + steps, sheet[1] + steps, sheet[2] - steps, sheet[3] - steps)
        if in_sheet(self._coarse[..., 0], self._coarse[..., 1], reach_in).all():
            return np.ones(self._rays[box].shape[:2], np.float32)
        xy = self._on_plane(self._rays[box])
        x, y, reach = xy[..., 0], xy[..., 1], _reach(xy)
        share = in_sheet(x, y, sheet).astype(np.float32)
        near = in_sheet(x, y, (sheet[0] - reach, sheet[1] - reach, sheet[2] + reach, sheet[3] + reach))
        near &= ~in_sheet(x, y, (sheet[0] + reach, sheet[1] + reach, sheet[2] - reach, sheet[3] - reach))
        self._refine(share, near, box, lambda u, v: in_sheet(u, v, sheet))
        return share

    def ring(self, box: tuple[slice, slice], ring: Ring) -> Float32:
        """The share (rows, cols) that is on the black of a ring."""
        xy = self._on_plane(self._rays[box])
        reach = _reach(xy)
        squared = (xy[..., 0] - np.float32(ring.x_m)) ** 2 + (xy[..., 1] - np.float32(ring.y_m)) ** 2
        share = ((squared <= ring.outer_m**2) & (squared > ring.inner_m**2)).astype(np.float32)
        near = np.zeros(share.shape, bool)
        for radius in (ring.outer_m, ring.inner_m):
            near |= (squared > max(radius - reach, 0.0) ** 2) & (squared < (radius + reach) ** 2)
        # A ring within a pixel has no pixel's middle near its edge's circle.
        near |= squared < reach**2
        self._refine(share, near, box, lambda u, v: in_ring(u, v, ring))
        return share

    def _refine(
        self, share: Float32, near: NDArray[np.bool_], box: tuple[slice, slice],
        inside: Callable[[Float32, Float32], NDArray[np.bool_]],
    ) -> None:  # fmt: skip
        """Replace the shares of pixels that an edge may pass by the mean of sixteen rays."""
        rows, cols = np.nonzero(near)
        for start in range(0, len(rows), _CHUNK):
            at = rows[start : start + _CHUNK], cols[start : start + _CHUNK]
            fine = self._on_plane(_finer(self._rays[box], *at))
            share[at] = inside(fine[..., 0], fine[..., 1]).mean(axis=1, dtype=np.float32)


def _reach(xy: Float32) -> float:
    """More than any part of a pixel is away from its middle: the largest distance of two neighbours."""
    return max(float(np.abs(np.diff(part, axis=axis)).max()) for axis, part in ((0, xy[:, ::4]), (1, xy[::4])))


def _finer(rays: Float32, rows: NDArray[np.intp], cols: NDArray[np.intp]) -> Float32:
    """Sixteen rays (n, 16, 2) of each of some pixels; the lens is smooth, so neighbours tell how they spread."""
    height, width = rays.shape[:2]
    here = rays[rows, cols]
    up, left = np.clip(rows, 0, height - 2), np.clip(cols, 0, width - 2)
    down = rays[up + 1, cols] - rays[up, cols]
    right = rays[rows, left + 1] - rays[rows, left]
    part = (np.arange(SUPERSAMPLING, dtype=np.float32) + np.float32(0.5)) / SUPERSAMPLING - np.float32(0.5)
    v, u = (grid.ravel()[:, np.newaxis] for grid in np.meshgrid(part, part, indexing="ij"))
    fine: Float32 = here[:, np.newaxis] + v * down[:, np.newaxis] + u * right[:, np.newaxis]
    return fine


def _square(ring: Ring) -> Sheet:
    return (
        ring.x_m - ring.outer_m, ring.y_m - ring.outer_m, ring.x_m + ring.outer_m, ring.y_m + ring.outer_m,
    )  # fmt: skip


def _common(one: tuple[slice, slice], other: tuple[slice, slice]) -> tuple[slice, slice] | None:
    both = [slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(one, other, strict=True)]
    return None if any(part.stop - part.start < 2 for part in both) else (both[0], both[1])


def _grain(seed: int, number: int, gsd_m: float, wave_m: float, octaves: int, strength: float) -> Image:
    """A texture of factors, 128 for one, that goes on where it ends."""
    half = Patch(0.0, 0.0, _TEXTURE_PX // 2, _TEXTURE_PX // 2, gsd_m)
    noise = FractalNoise(rng_for(seed, "pad", f"grain-{number}")).sample(half, wave_m, octaves, 0.8)
    whole = np.hstack((noise, noise[:, ::-1]))
    whole = np.vstack((whole, whole[::-1]))
    return np.clip(np.round(128.0 * (1.0 + strength * whole)), 0, 255).astype(np.uint8)
