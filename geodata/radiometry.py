"""From a raster's own bands to 8-bit grey and colour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from geodata.errors import EmptyRasterError
from geodata.raster import Bands, Raster

Planes = NDArray[np.float32]

# Rec. 601 luma, as OpenCV's grey conversion, so that map and video pictures are reduced alike.
_LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)

# Half a per cent at each end: glints and dead pixels do not set the contrast.
_PERCENTILES = (0.5, 99.5)


@dataclass(frozen=True, slots=True, eq=False)
class Radiometry:
    """How the bands of one raster become grey levels 0 to 255.

    ``palette`` (n, 4) translates indices; ``low`` and ``high`` (bands,) stretch anything that is not 8-bit.
    """

    palette: NDArray[np.uint8] | None
    low: Float | None
    high: Float | None

    @classmethod
    def of(cls, raster: Raster) -> Radiometry:
        """Choose the rendering of a raster from its type and, unless 8-bit, from a sample of its pixels."""
        if raster.palette is not None:
            return cls(raster.palette, None, None)
        if raster.dtype == np.uint8:
            return cls(None, None, None)
        bands, valid = raster.sample()
        if not valid.any():
            raise EmptyRasterError(raster.path, "holds no valid pixel (all nodata)", "check its nodata value and mask")
        shown = bands[: _shown(len(bands)), valid].astype(np.float64)
        low, high = np.percentile(shown, _PERCENTILES, axis=1)
        flat = high <= low
        return cls(None, np.where(flat, low - 0.5, low), np.where(flat, low + 0.5, high))

    def colour(self, bands: Bands) -> Planes:
        """Red, green, blue (3, h, w) or grey (1, h, w), float in [0, 255]."""
        if self.palette is not None:
            index = np.clip(bands[0].astype(np.int64), 0, len(self.palette) - 1)
            return np.moveaxis(self.palette[index, :3], -1, 0).astype(np.float32)
        planes = bands[: _shown(len(bands))].astype(np.float32)
        if self.low is not None and self.high is not None:
            low, span = self.low[:, None, None], (self.high - self.low)[:, None, None]
            with np.errstate(invalid="ignore", over="ignore"):
                planes = ((planes - low) * (255.0 / span)).astype(np.float32)
            planes = np.clip(np.nan_to_num(planes, nan=0.0), 0.0, 255.0)
        return planes

    def grey(self, bands: Bands) -> Planes:
        """Grey (1, h, w), float in [0, 255]."""
        planes = self.colour(bands)
        if len(planes) == 1:
            return planes
        grey: NDArray[Any] = np.tensordot(_LUMA, planes, axes=1)[np.newaxis]
        return grey.astype(np.float32, copy=False)


def _shown(bands: int) -> int:
    return 3 if bands >= 3 else 1
