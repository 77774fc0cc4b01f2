"""The ground along a ray: what of a model the computation looked at, and a model made of just that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from backend.evidence.schema import FlatPart, StripPart
from estimator.ports import GroundModel
from estimator.types import Float
from geodata.elevation import ElevationGrid, FlatGround

# A reader who marches in other steps than the estimator looks at neighbours of the cells that it looked at.
MARGIN_CELLS = 1


class WatchedGround:
    """A ground model that remembers where it was asked."""

    def __init__(self, ground: GroundModel) -> None:
        self.ground = ground
        self._asked: list[Float] = []

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        """As the model says."""
        north, east = np.broadcast_arrays(np.asarray(north_m, dtype=np.float64), np.asarray(east_m, dtype=np.float64))
        self._asked.append(np.stack((north.ravel(), east.ravel()), axis=-1))
        return self.ground.alt_amsl_m(north_m, east_m)

    def asked_ne_m(self) -> Float:
        """All places asked for, (n, 2)."""
        return np.concatenate(self._asked) if self._asked else np.zeros((0, 2))


class GroundStrip:
    """Altitudes from some cells of a grid: to the last bit those of the grid that they were taken from.

    ``cells`` (rows, cols), NaN where unknown, begin in ``first_row`` and each row in the grid's ``first_cols`` (rows,).
    """

    def __init__(
        self, cells: Float, first_row: int, first_cols: NDArray[np.intp], north_max_m: float, east_min_m: float,
        gsd_m: float,
    ) -> None:  # fmt: skip
        # Rows end in a NaN, which stands for all that is not listed.
        self._cells = np.pad(cells, ((0, 0), (0, 1)), constant_values=np.nan)
        self._first_row, self._first_cols = first_row, first_cols
        # The grid's own arithmetic: its first row and column are a border about the cells.
        self._north_zero_m, self._east_zero_m = north_max_m + gsd_m, east_min_m - gsd_m
        self._per_m = 1.0 / gsd_m

    @classmethod
    def of(cls, strip: StripPart) -> GroundStrip:
        """The cells of evidence."""
        cells = np.full((len(strip.alt_amsl_m), max(len(row) for row in strip.alt_amsl_m)), np.nan)
        for row, heights in enumerate(strip.alt_amsl_m):
            cells[row, : len(heights)] = [np.nan if height is None else height for height in heights]
        firsts = np.array(strip.first_cols, dtype=np.intp)
        return cls(cells, strip.first_row, firsts, strip.north_max_m, strip.east_min_m, strip.gsd_m)

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        """Altitude by bilinear interpolation, in the shape of the broadcast inputs; NaN beside the cells."""
        north, east = np.broadcast_arrays(np.asarray(north_m, dtype=np.float64), np.asarray(east_m, dtype=np.float64))
        row, col = (self._north_zero_m - north) * self._per_m, (east - self._east_zero_m) * self._per_m
        known = np.isfinite(row) & np.isfinite(col) & (np.abs(row) < 1e9) & (np.abs(col) < 1e9)
        row, col = np.where(known, row, 0.0), np.where(known, col, 0.0)
        top, left = np.floor(row).astype(np.intp), np.floor(col).astype(np.intp)
        down, right = row - top, col - left
        upper, lower = self._at(top, left), self._at(top + 1, left)
        upper = upper + right * (self._at(top, left + 1) - upper)
        lower = lower + right * (self._at(top + 1, left + 1) - lower)
        alt_amsl_m: Float = np.where(known, upper + down * (lower - upper), np.nan)
        return alt_amsl_m

    def _at(self, row: NDArray[np.intp], col: NDArray[np.intp]) -> Float:
        i = row - 1 - self._first_row
        inside = (i >= 0) & (i < len(self._cells))
        i = np.where(inside, i, 0)
        j = col - 1 - self._first_cols[i]
        inside &= (j >= 0) & (j < self._cells.shape[1])
        cells: Float = self._cells[i, np.where(inside, j, -1)]
        return cells


def ground_model_of(part: FlatPart | StripPart) -> GroundModel:
    """The ground that evidence holds."""
    return FlatGround(part.alt_amsl_m) if isinstance(part, FlatPart) else GroundStrip.of(part)


def ground_part_of(watched: WatchedGround, origin_ned_m: Float, point_ned_m: Float) -> FlatPart | StripPart:
    """What is needed of a ground model to cut the ray from a camera to a point again.

    Raises
    ------
    TypeError
        There is no way to keep a sample of such a model.
    """
    match watched.ground:
        case FlatGround() as flat:
            return FlatPart(alt_amsl_m=float(flat.alt_amsl_m(np.zeros(1), np.zeros(1))[0]))
        case ElevationGrid() as grid:
            return _strip(grid, watched.asked_ne_m(), origin_ned_m, point_ned_m)
        case other:
            raise TypeError(f"no evidence can be kept of a ground model of type {type(other).__name__}")


def _strip(grid: ElevationGrid, asked_ne_m: Float, origin_ned_m: Float, point_ned_m: Float) -> StripPart:
    rows, cols = grid.alt_amsl_grid_m.shape
    path_m = float(np.hypot(*(point_ned_m - origin_ned_m)[:2]))
    along = np.linspace(0.0, 1.0, int(2.0 * path_m / grid.gsd_m) + 2)[:, np.newaxis]
    path = origin_ned_m[:2] + along * (point_ned_m - origin_ned_m)[:2]
    ne = np.concatenate((asked_ne_m, path))
    row = np.floor((grid.north_max_m - ne[:, 0]) / grid.gsd_m)
    col = np.floor((ne[:, 1] - grid.east_min_m) / grid.gsd_m)
    near = (row >= -2) & (row <= rows) & (col >= -2) & (col <= cols)
    row, col = row[near].astype(np.intp), col[near].astype(np.intp)
    first, last = np.full(rows, cols, dtype=np.intp), np.full(rows, -1, dtype=np.intp)
    for step in range(-MARGIN_CELLS, MARGIN_CELLS + 2):
        at = np.clip(row + step, 0, rows - 1)
        np.minimum.at(first, at, np.clip(col - MARGIN_CELLS, 0, cols - 1))
        np.maximum.at(last, at, np.clip(col + MARGIN_CELLS + 1, 0, cols - 1))
    used = np.flatnonzero(last >= 0)
    if not used.size:  # The whole ray lies off the grid: one cell says where that is.
        used, first[0], last[0] = np.zeros(1, dtype=np.intp), 0, 0
    span = np.arange(used[0], used[-1] + 1)
    skipped = last[span] < 0
    first[span[skipped]] = last[span[skipped]] = 0
    return StripPart(
        north_max_m=grid.north_max_m, east_min_m=grid.east_min_m, gsd_m=grid.gsd_m, first_row=int(span[0]),
        first_cols=[int(first[r]) for r in span],
        alt_amsl_m=[
            [float(h) if np.isfinite(h) else None for h in grid.alt_amsl_grid_m[r, first[r] : last[r] + 1]]
            for r in span
        ],
    )  # fmt: skip
