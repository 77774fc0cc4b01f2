"""Resampling of a raster onto any grid that knows its latitudes and longitudes.

Exact to a small part of a pixel: positions go through the full projection on a coarse net of nodes and are interpolated
bilinearly between them; the projections bend by well under a millimetre over the node spacing. Where the source is
finer than the grid it is averaged over the area of each target pixel; overviews are used when they are fine enough.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from geodata.raster import Bands, Level, Mask, Raster

Planes = NDArray[np.float32]
GeodeticAt = Callable[[Float, Float], tuple[Float, Float]]

_BLOCK_PX = 512
_SOURCE_PIXELS_PER_BLOCK = 4_000_000
_CHUNK_PX = 2048
_FAR_PX = -1.0e9


@dataclass(frozen=True, slots=True, eq=False)
class _Positions:
    """Source pixel coordinates of the nodes (n, m) of one block and how they spread over its samples."""

    col: Float
    row: Float
    row_weights: Float
    col_weights: Float

    def spread(self, nodes: Float) -> Float:
        spread: Float = self.row_weights @ nodes @ self.col_weights.T
        return spread


def resample(
    raster: Raster,
    render: Callable[[Bands], Planes],
    geodetic_at: GeodeticAt,
    rows: int,
    cols: int,
    *,
    node_step_px: float,
    exact: bool = False,
    region: tuple[int, int, int, int] | None = None,
) -> tuple[Planes, Mask]:
    """Resample a raster onto a grid of ``rows`` x ``cols`` pixels.

    Parameters
    ----------
    render
        Source bands (b, h, w) to the planes (p, h, w) that are interpolated.
    geodetic_at
        Target (row, col), pixel centres at whole numbers, to latitude and longitude in radians.
    node_step_px
        Greatest spacing of the nodes at which ``geodetic_at`` is evaluated, target pixels.
    exact
        Interpolate with full instead of 1/32 pixel resolution (for heights).
    region
        The part (top, left, bottom, right) of the grid that the raster can reach, when that is known.

    Returns
    -------
    planes, valid
        (p, rows, cols), zero where invalid, and (rows, cols).
    """
    planes: Planes | None = None
    valid = np.zeros((rows, cols), dtype=np.bool_)
    block = _block_size(raster, geodetic_at, rows, cols)
    first_row, first_col, last_row, last_col = region or (0, 0, rows, cols)
    for top in range(max(0, first_row), min(rows, last_row), block):
        for left in range(max(0, first_col), min(cols, last_col), block):
            height, width = min(block, rows - top), min(block, cols - left)
            piece = _block(raster, render, geodetic_at, (top, left, height, width), node_step_px, exact)
            if piece is None:
                continue
            values, known = piece
            if planes is None:
                planes = np.zeros((len(values), rows, cols), dtype=np.float32)
            planes[:, top : top + height, left : left + width] = values
            valid[top : top + height, left : left + width] = known
    if planes is None:
        planes = np.zeros((1, rows, cols), dtype=np.float32)
    return planes, valid


def _block_size(raster: Raster, geodetic_at: GeodeticAt, rows: int, cols: int) -> int:
    """Target block side such that its source window stays small in memory."""
    row = (rows - 1) / 2 + np.array([0.0, 1.0, 0.0])
    col = (cols - 1) / 2 + np.array([0.0, 0.0, 1.0])
    source_col, source_row = raster.pixel_from_geodetic(*geodetic_at(row, col))
    scale_x = math.hypot(source_col[1] - source_col[0], source_col[2] - source_col[0])
    scale_y = math.hypot(source_row[1] - source_row[0], source_row[2] - source_row[0])
    if not (math.isfinite(scale_x) and math.isfinite(scale_y)):
        return _BLOCK_PX
    level = _level(raster, scale_x, scale_y)
    pixels_each = max(1.0, scale_x / level.factor_x) * max(1.0, scale_y / level.factor_y)
    return max(4, min(_BLOCK_PX, int(math.sqrt(_SOURCE_PIXELS_PER_BLOCK / pixels_each))))


def _level(raster: Raster, scale_x: float, scale_y: float) -> Level:
    """The coarsest level that still has two pixels for each target pixel, so that its own filter does not show."""
    fine = [level for level in raster.levels if scale_x >= 2 * level.factor_x and scale_y >= 2 * level.factor_y]
    return max(fine, key=lambda level: level.factor_x, default=raster.levels[0])


def _block(
    raster: Raster,
    render: Callable[[Bands], Planes],
    geodetic_at: GeodeticAt,
    place: tuple[int, int, int, int],
    node_step_px: float,
    exact: bool,
) -> tuple[Planes, Mask] | None:
    nodes = _nodes(raster, geodetic_at, place, node_step_px, 1)
    scale_x, scale_y = _scale(nodes.col, place), _scale(nodes.row, place)
    if not (scale_x > 0 and scale_y > 0):
        return None
    level = _level(raster, scale_x, scale_y)
    scale_x, scale_y = scale_x / level.factor_x, scale_y / level.factor_y
    # A tenth coarser than the source shows no aliasing yet, and is what one projection differs from another.
    oversampling = 2 if max(scale_x, scale_y) > 1.1 else 1
    if oversampling > 1:
        nodes = _nodes(raster, geodetic_at, place, node_step_px, oversampling)
    level_col = (nodes.col + 0.5) / level.factor_x - 0.5
    level_row = (nodes.row + 0.5) / level.factor_y - 0.5

    thin_x, thin_y = _thinning(scale_x, level.width_px), _thinning(scale_y, level.height_px)
    window = _window(level_col, level_row, level, thin_x, thin_y)
    if window is None:
        return None
    left, top = window[:2]
    values, weight = _read_thinned(raster, level, window, render, (thin_x, thin_y))

    at_col = nodes.spread((level_col - left + 0.5) / thin_x - 0.5)
    at_row = nodes.spread((level_row - top + 0.5) / thin_y - 0.5)
    interpolate = _interpolate_exactly if exact else _interpolate
    stack = [interpolate(plane, at_col, at_row) for plane in (*values, weight)]
    if oversampling > 1:
        stack = [_halved(plane) for plane in stack]
    weight = stack[-1]
    valid = weight >= 0.5 - 1e-4
    out = np.stack(stack[:-1]) / np.where(valid, weight, np.float32(1.0))
    out[:, ~valid] = 0.0
    return out.astype(np.float32, copy=False), valid


def _nodes(
    raster: Raster, geodetic_at: GeodeticAt, place: tuple[int, int, int, int], step_px: float, oversampling: int
) -> _Positions:
    top, left, height, width = place
    node_rows = np.linspace(top - 0.5, top + height - 0.5, max(2, math.ceil(height / step_px) + 1))
    node_cols = np.linspace(left - 0.5, left + width - 0.5, max(2, math.ceil(width / step_px) + 1))
    sample_rows = top - 0.5 + (np.arange(height * oversampling) + 0.5) / oversampling
    sample_cols = left - 0.5 + (np.arange(width * oversampling) + 0.5) / oversampling
    mesh_rows, mesh_cols = np.meshgrid(node_rows, node_cols, indexing="ij")
    col, row = raster.pixel_from_geodetic(*geodetic_at(mesh_rows, mesh_cols))
    if np.all(np.isfinite(col) & np.isfinite(row)) or not np.any(np.isfinite(col) & np.isfinite(row)):
        return _Positions(col, row, _linear_weights(node_rows, sample_rows), _linear_weights(node_cols, sample_cols))
    # At the rim of a projection some nodes have no position: every sample becomes a node of its own.
    mesh_rows, mesh_cols = np.meshgrid(sample_rows, sample_cols, indexing="ij")
    col, row = raster.pixel_from_geodetic(*geodetic_at(mesh_rows, mesh_cols))
    lost = ~(np.isfinite(col) & np.isfinite(row))
    col, row = np.where(lost, _FAR_PX, col), np.where(lost, _FAR_PX, row)
    return _Positions(col, row, np.eye(len(sample_rows)), np.eye(len(sample_cols)))


def _linear_weights(nodes: Float, samples: Float) -> Float:
    """Matrix (samples, nodes) of linear interpolation between equally spaced nodes."""
    position = (samples - nodes[0]) / (nodes[1] - nodes[0])
    weights: Float = np.maximum(0.0, 1.0 - np.abs(position[:, None] - np.arange(len(nodes))[None, :]))
    return weights


def _scale(source: Float, place: tuple[int, int, int, int]) -> float:
    """Source pixels along one axis for each target pixel."""
    _, _, height, width = place
    down = np.diff(source, axis=0) * (source.shape[0] - 1) / height
    across = np.diff(source, axis=1) * (source.shape[1] - 1) / width
    scale = math.hypot(float(np.median(np.abs(down))), float(np.median(np.abs(across))))
    return scale if math.isfinite(scale) else 0.0


def _window(col: Float, row: Float, level: Level, thin_x: int, thin_y: int) -> tuple[int, int, int, int] | None:
    """The part of a level (left, top, right, bottom) that the nodes need, on a lattice of the thinning factors."""
    seen = (col > _FAR_PX / 2) & (row > _FAR_PX / 2)
    if not seen.any():
        return None
    margin_x, margin_y = 2 * thin_x, 2 * thin_y
    left = max(0, math.floor((col[seen].min() - margin_x) / thin_x) * thin_x)
    top = max(0, math.floor((row[seen].min() - margin_y) / thin_y) * thin_y)
    right = min(level.width_px, math.ceil(col[seen].max()) + margin_x)
    bottom = min(level.height_px, math.ceil(row[seen].max()) + margin_y)
    return (left, top, right, bottom) if left < right and top < bottom else None


def _thinning(scale: float, size_px: int) -> int:
    """The power of two by which a level is averaged before it is interpolated."""
    largest = min(_CHUNK_PX, 2 ** math.ceil(math.log2(size_px)))
    return int(min(largest, 2 ** max(0, math.floor(math.log2(min(scale, 1e9)) + 1e-6))))


def _read_thinned(
    raster: Raster,
    level: Level,
    window: tuple[int, int, int, int],
    render: Callable[[Bands], Planes],
    thinning: tuple[int, int],
) -> tuple[Planes, Planes]:
    """Read a window piece by piece, so that only its averages are held in memory together."""
    left, top, right, bottom = window
    thin_x, thin_y = thinning
    step_x, step_y = (thin * max(1, _CHUNK_PX // thin) for thin in thinning)
    lines: list[Planes] = []
    for row in range(top, bottom, step_y):
        pieces: list[Planes] = []
        for col in range(left, right, step_x):
            bands, known = raster.read(level, col, row, min(step_x, right - col), min(step_y, bottom - row))
            values, weight = _area_mean(render(bands), known, thin_x, thin_y)
            pieces.append(np.concatenate([values, weight[np.newaxis]]))
        lines.append(np.concatenate(pieces, axis=2))
    planes = np.concatenate(lines, axis=1)
    return planes[:-1], planes[-1]


def _area_mean(values: Planes, valid: Mask, thin_x: int, thin_y: int) -> tuple[Planes, Planes]:
    """Means over thin_y x thin_x boxes of values times validity (p, h, w), and of validity (h, w)."""
    weight = valid.astype(np.float32)
    values = np.where(valid, values, np.float32(0.0))
    if thin_x == 1 and thin_y == 1:
        return values, weight
    planes = np.concatenate([values, weight[np.newaxis]])
    pad_y, pad_x = -planes.shape[1] % thin_y, -planes.shape[2] % thin_x
    planes = np.pad(planes, ((0, 0), (0, pad_y), (0, pad_x)))
    count, height, width = planes.shape
    boxes = planes.reshape(count, height // thin_y, thin_y, width // thin_x, thin_x)
    means = boxes.mean(axis=(2, 4), dtype=np.float32)
    return means[:-1], means[-1]


def _interpolate(plane: Planes, col: Float, row: Float) -> Planes:
    return np.asarray(
        cv2.remap(
            plane,
            np.clip(col, -1e6, 1e6).astype(np.float32),
            np.clip(row, -1e6, 1e6).astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=0.0,
        ),
        dtype=np.float32,
    )


def _halved(plane: Planes) -> Planes:
    height, width = plane.shape
    return np.asarray(cv2.resize(plane, (width // 2, height // 2), interpolation=cv2.INTER_AREA), dtype=np.float32)


def _interpolate_exactly(plane: Planes, col: Float, row: Float) -> Planes:
    padded = np.pad(plane, 1)
    rows, cols = padded.shape
    x = np.clip(col + 1.0, 0.0, cols - 1.001)
    y = np.clip(row + 1.0, 0.0, rows - 1.001)
    left, top = x.astype(np.int64), y.astype(np.int64)
    fx, fy = x - left, y - top
    upper = padded[top, left] * (1 - fx) + padded[top, left + 1] * fx
    lower = padded[top + 1, left] * (1 - fx) + padded[top + 1, left + 1] * fx
    return (upper * (1 - fy) + lower * fy).astype(np.float32)
