"""Small rasters for the tests, written with rasterio itself so that the product's writer is not its own judge."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import rasterio
from affine import Affine
from numpy.typing import NDArray

from estimator.geometry.local import LocalFrame

LAT_DEG, LON_DEG, ALT_M = 48.1374, 11.5755, 520.0
UTM = "EPSG:32632"


def frame() -> LocalFrame:
    return LocalFrame(math.radians(LAT_DEG), math.radians(LON_DEG), ALT_M)


def write(
    path: Path,
    bands: NDArray[Any],
    *,
    crs: str | None = UTM,
    gsd: float = 1.0,
    rotation_deg: float = 0.0,
    transform: Affine | None = None,
    mask: NDArray[np.bool_] | None = None,
    colormap: dict[int, tuple[int, int, int, int]] | None = None,
    **profile: Any,
) -> Path:
    """Write (b, rows, cols) centred on the test place, ``gsd`` in units of the CRS."""
    count, rows, cols = bands.shape
    if transform is None:
        x, y = (0.0, 0.0)
        if crs is not None:
            x, y = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(LON_DEG, LAT_DEG)
        cos, sin = gsd * math.cos(math.radians(rotation_deg)), gsd * math.sin(math.radians(rotation_deg))
        transform = Affine(
            cos, sin, x - cos * cols / 2 - sin * rows / 2, sin, -cos, y - sin * cols / 2 + cos * rows / 2
        )  # fmt: skip
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(
        path, "w", driver="GTiff", width=cols, height=rows, count=count, dtype=bands.dtype, crs=crs,
        transform=transform, **profile,
    ) as dataset:  # fmt: skip
        dataset.write(bands)
        if mask is not None:
            dataset.write_mask(mask.astype(np.uint8) * 255)
        if colormap is not None:
            dataset.write_colormap(1, colormap)
    return path


def texture(rows: int, cols: int, low: float = 30.0, high: float = 220.0) -> NDArray[np.float64]:
    """A smooth pattern without symmetry, so that a flip or a shift shows."""
    y, x = np.mgrid[0:rows, 0:cols] / 40.0
    wave = np.sin(x + 0.3 * y) * np.cos(0.7 * y - 0.2 * x) + 0.5 * np.sin(0.35 * x * y / 3.0 + 1.0)
    return low + (high - low) * (wave + 1.5) / 3.0


def bilinear(pixels: NDArray[Any], col: float, row: float) -> float:
    left, top = math.floor(col), math.floor(row)
    fx, fy = col - left, row - top
    cell = pixels[top : top + 2, left : left + 2].astype(np.float64)
    return float(
        cell[0, 0] * (1 - fx) * (1 - fy)
        + cell[0, 1] * fx * (1 - fy)
        + cell[1, 0] * (1 - fx) * fy
        + cell[1, 1] * fx * fy
    )
