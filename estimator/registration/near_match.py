"""Similarity of a piece of ground with the map about one place: normalised under the piece's own outline.

What the whole-map search (`global_search`) compares, with the energy of exactly the map's cells that the piece covers,
and in units of what the same piece reaches at places that have nothing to do with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.registration.global_search import EdgeMap, Slice, Template, turned_template
from estimator.robust import robust_std
from estimator.types import Float

MIN_COVERED = 0.6
# fractional parts of k times these fill square and circle evenly (the R sequences of Roberts, 2018)
_EVENLY = np.array([0.8191725134, 0.6710436067, 0.5497004779])


@dataclass(frozen=True, slots=True, eq=False)
class NearSurface:
    """Similarity (2 reach + 1, 2 reach + 1) in [-1, 1] about cell (``row``, ``col``), -1 where too little is known.

    ``cells`` is how many of the map's cells the template covers.
    """

    similarity: NDArray[np.float32]
    row: int
    col: int
    cells: float


class NearMatcher:
    """Compares templates with small windows of an edge map."""

    def __init__(self, coarse: EdgeMap) -> None:
        self.map = coarse
        known = coarse.density[coarse.valid]
        self._floor = 0.15 * float(np.median(known * known)) if known.size else 1.0

    def half_cells(self, template: Template, scale: float) -> int:
        """Half the side of the square of cells that holds a template, turned at will."""
        rows, cols = np.nonzero(template.known)
        away = np.hypot(rows - template.centre_px[0], cols - template.centre_px[1])
        return int(np.ceil(float(away.max()) * template.gsd_m * scale / self.map.cell_m)) + 1

    def surface(
        self, template: Template, what: Slice, centre_ne_m: Float, reach_cells: int, half: int
    ) -> NearSurface | None:
        """Similarity with the template's centre within a reach of a place (2,); None off the map.

        ``half`` is `half_cells` of the template at this scale or a larger one.
        """
        row = round((self.map.north_max_m - centre_ne_m[0]) / self.map.cell_m)
        col = round((centre_ne_m[1] - self.map.east_min_m) / self.map.cell_m)
        rows, cols = self.map.shape
        if not (0 <= row < rows and 0 <= col < cols):
            return None
        turned = turned_template(template, what, self.map.cell_m, half)
        if turned is None:
            return None
        around = half + reach_cells
        density, valid = self._window(self.map.density, row, col, around), self.map.valid
        product = cv2.matchTemplate(density, turned.density, cv2.TM_CCORR)
        energy = cv2.matchTemplate(density * density, turned.mask, cv2.TM_CCORR)
        own = max(float((turned.density * turned.density).sum()), 1e-9)
        similarity = product / np.sqrt(np.maximum(energy, self._floor * turned.cells) * own)
        inside = valid[max(row - around, 0) : row + around + 1, max(col - around, 0) : col + around + 1]
        if inside.size < (2 * around + 1) ** 2 or not inside.all():
            known = self._window(valid.astype(np.float32), row, col, around)
            covered = cv2.matchTemplate(known, turned.mask, cv2.TM_CCORR)
            similarity[covered < MIN_COVERED * turned.cells] = -1.0
        return NearSurface(np.asarray(similarity, dtype=np.float32), row, col, turned.cells)

    @staticmethod
    def _window(values: NDArray[np.float32], row: int, col: int, around: int) -> NDArray[np.float32]:
        side = 2 * around + 1
        window = np.zeros((side, side), dtype=np.float32)
        top, left = max(row - around, 0), max(col - around, 0)
        part = values[top : row + around + 1, left : col + around + 1]
        first_r, first_c = top - row + around, left - col + around
        window[first_r : first_r + part.shape[0], first_c : first_c + part.shape[1]] = part
        return window

    def clutter(self, template: Template, scale: float, places: int = 60) -> float | None:
        """Standard deviation of the similarity at places and headings that fill map and circle evenly, for one cell.

        That of n cells is this over the root of n. None where the template fits nowhere.
        """
        half = self.half_cells(template, scale)
        rows, cols = self.map.shape
        values = []
        for k in range(1, places + 1):
            down, right, round_ = (k * _EVENLY) % 1.0
            centre = self.map.ne_m(down * (rows - 1), right * (cols - 1))
            found = self.surface(template, Slice(2.0 * np.pi * float(round_), scale), centre, 2, half)
            if found is not None:
                # every other cell: neighbours are alike
                near = found.similarity[::4, ::4]
                values.append(near[near > -0.999] * np.sqrt(found.cells))
        sampled = np.concatenate(values) if values else np.empty(0)
        return max(robust_std(sampled), 0.05) if sampled.size >= 50 else None
