"""Fractal noise that is a function of the place, so that patches painted one by one fit together."""

from __future__ import annotations

import cv2
import numpy as np

from simulator.world.patch import Float32, Patch

_LATTICE = 512
_COARSE = 4


class FractalNoise:
    """Periodic value noise over several octaves; the period is 512 cells of each octave."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._lattice = rng.standard_normal((_LATTICE, _LATTICE)).astype(np.float32)
        self._origin = rng.uniform(0, _LATTICE, (16, 2))

    def sample(self, patch: Patch, cell_m: float, octaves: int, persistence: float = 0.6) -> Float32:
        """Noise (rows, cols) of about unit variance; ``cell_m`` is the coarsest cell, each octave halves it."""
        total = np.zeros((patch.rows, patch.cols), np.float32)
        weight, power = 1.0, 0.0
        coarse: Float32 | None = None
        coarse_patch = _coarse_patch(patch)
        for octave in range(octaves):
            size_m = cell_m / 2**octave
            if size_m >= 2 * _COARSE * patch.gsd_m:
                layer = self._octave(coarse_patch, size_m, octave, smooth=True)
                coarse = layer * weight if coarse is None else coarse + layer * weight
            else:
                total += self._octave(patch, size_m, octave, smooth=False) * np.float32(weight)
            power += weight**2
            weight *= persistence
        if coarse is not None:
            full = cv2.resize(coarse, None, fx=_COARSE, fy=_COARSE, interpolation=cv2.INTER_LINEAR)
            total += full[_COARSE : _COARSE + patch.rows, _COARSE : _COARSE + patch.cols]
        # Interpolation between lattice points takes about half of the variance.
        total *= np.float32(1.4 / np.sqrt(power))
        return total

    def _octave(self, patch: Patch, cell_m: float, octave: int, *, smooth: bool) -> Float32:
        origin = self._origin[octave % len(self._origin)]
        row = -patch.north_max_m / cell_m + origin[0]
        col = patch.east_min_m / cell_m + origin[1]
        step = patch.gsd_m / cell_m
        first_row, first_col = int(np.floor(row)) - 1, int(np.floor(col)) - 1
        rows = np.arange(first_row, first_row + int(patch.rows * step) + 5)
        cols = np.arange(first_col, first_col + int(patch.cols * step) + 5)
        window = self._lattice.take(rows, axis=0, mode="wrap").take(cols, axis=1, mode="wrap")
        inverse = np.array([[step, 0.0, col - first_col], [0.0, step, row - first_row]])
        flags = (cv2.INTER_CUBIC if smooth else cv2.INTER_LINEAR) | cv2.WARP_INVERSE_MAP
        size = (patch.cols, patch.rows)
        warped = cv2.warpAffine(window, inverse, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(warped, np.float32)


def _coarse_patch(patch: Patch) -> Patch:
    # One coarse pixel of margin, so that upsampling never has to extrapolate.
    grown = patch.grown(_COARSE)
    rows, cols = -(-grown.rows // _COARSE) + 1, -(-grown.cols // _COARSE) + 1
    shift_m = (_COARSE - 1) * patch.gsd_m / 2
    return Patch(grown.north_max_m - shift_m, grown.east_min_m + shift_m, rows, cols, patch.gsd_m * _COARSE)
