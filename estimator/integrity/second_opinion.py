"""A second opinion on the place: what all pictures since satellites say together, beside the inertial filter.

The filter holds one place, and a picture that it has believed narrows the search of the next. Here a density over where
the vehicle is from the estimate lives on: each picture multiplies its whole likelihood into it, nothing is cut to one
peak, and a little always stays everywhere. Where filter and density part it has been the density that was right
(ADR 0017).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.types import Float


@dataclass(frozen=True, slots=True)
class SecondOpinionConfig:
    """Grid, growth, and when it contradicts.

    The grid reaches ``half_extent_m`` to all sides of the estimate in cells of ``cell_m``. Odometry strays by
    ``drift_share`` of the way, alike over ``drift_alike_m``. A picture that tells nothing old leaves ``leak`` of the
    probability to anywhere on the grid. ``common_std_m`` is what all pictures err by alike: the map's own error, and
    the lever of the attitude's.
    """

    half_extent_m: float = 40.0
    cell_m: float = 1.0
    drift_share: float = 0.02
    drift_alike_m: float = 50.0
    leak: float = 1e-3
    common_std_m: float = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Opinion:
    """Where the vehicle is from the estimate: mean (2,) north and east in metres, and covariance (2, 2)."""

    displacement_ne_m: Float
    cov_ne_m2: Float

    @property
    def size_m(self) -> float:
        """Its length."""
        return float(np.hypot(*self.displacement_ne_m))

    @property
    def sigmas(self) -> float:
        """How many of its own sigmas the estimate lies off."""
        d = self.displacement_ne_m
        return float(np.sqrt(d @ np.linalg.solve(self.cov_ne_m2, d)))


class SecondOpinion:
    """The density. It begins as sure as the estimate is when the first picture comes."""

    def __init__(self, config: SecondOpinionConfig | None = None) -> None:
        self.config = config or SecondOpinionConfig()
        steps = int(self.config.half_extent_m / self.config.cell_m)
        self._axis_m = self.config.cell_m * np.arange(-steps, steps + 1, dtype=np.float64)
        self._density: Float | None = None

    @property
    def begun(self) -> bool:
        """Whether there is one."""
        return self._density is not None

    def forget(self) -> None:
        """Begin anew with the next ``begin``: the estimate comes from elsewhere now."""
        self._density = None

    def begin(self, cov_ne_m2: Float) -> None:
        """Begin at the estimate, of covariance (2, 2)."""
        cov = cov_ne_m2 + np.eye(2) * self.config.common_std_m**2
        offset = np.stack(np.meshgrid(-self._axis_m, self._axis_m, indexing="ij"), axis=-1)
        density = np.exp(-0.5 * np.einsum("...i,ij,...j->...", offset, np.linalg.inv(cov), offset))
        self._density = density / density.sum()

    def see(self, likelihood: Float, north_max_m: float, east_min_m: float, fresh: float, way_m: float) -> None:
        """Multiply a picture in, after a way of ``way_m`` since the last; without effect before ``begin``.

        ``likelihood`` (rows, cols) is of displacements from the estimate on a grid of ``cell_m`` whose first entry lies
        at (``north_max_m``, ``east_min_m``); beyond it counts as its minimum. ``fresh`` is the share that earlier
        pictures have not said.
        """
        if self._density is None:
            return
        config, density = self.config, self._density
        std_cells = config.drift_share * np.sqrt(config.drift_alike_m * way_m) / config.cell_m
        if std_cells > 0.05:
            density = _blurred(density, std_cells)
        leak = config.leak * fresh
        density = (1.0 - leak) * density / density.sum() + leak / density.size
        first = ((north_max_m - self._axis_m[-1]) / config.cell_m, (self._axis_m[0] - east_min_m) / config.cell_m)
        density = density * np.maximum(_shifted(likelihood, *first, density.shape), 1e-9)
        self._density = density / density.sum()

    def corrected(self, moved_ne_m: Float) -> None:
        """The estimate has been moved by so much (2,) without the vehicle."""
        if self._density is None:
            return
        cell_m = self.config.cell_m
        density = _shifted(self._density, -moved_ne_m[0] / cell_m, moved_ne_m[1] / cell_m, self._density.shape)
        self._density = density / density.sum()

    def opinion(self) -> Opinion | None:
        """What it comes to, ``common_std_m`` included; None before ``begin``."""
        if self._density is None:
            return None
        by_row, by_col = self._density.sum(axis=1), self._density.sum(axis=0)
        north, east = -self._axis_m, self._axis_m
        mean = np.array([by_row @ north, by_col @ east])
        dn, de = north - mean[0], east - mean[1]
        cross = float(dn @ self._density @ de)
        cov = np.array([[by_row @ dn**2, cross], [cross, by_col @ de**2]])
        return Opinion(mean, cov + np.eye(2) * self.config.common_std_m**2)


def _blurred(density: Float, std_cells: float) -> Float:
    blurred = cv2.GaussianBlur(density, (0, 0), std_cells, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, dtype=np.float64)


def _shifted(values: Float, first_row: float, first_col: float, shape: tuple[int, ...]) -> Float:
    """``shape`` values of a grid from a place in cells of it on, between cells linearly; beyond it its minimum."""
    matrix = np.array([[1.0, 0.0, first_col], [0.0, 1.0, first_row]])
    shifted = cv2.warpAffine(
        values, matrix, (shape[1], shape[0]), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT, borderValue=float(values.min()),
    )  # fmt: skip
    return np.asarray(shifted, dtype=np.float64)
