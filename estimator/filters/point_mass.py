"""Point-mass filter: the horizontal position as a density on a grid that moves with the vehicle.

Conte 2009, section 5.8, equations 5.29 to 5.31: the grid is moved by the odometry, the density is only blurred.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Mean (2,) north, east and covariance (2, 2) of a density; with a heading (3,) and (3, 3)."""

    mean_ne_m: Float
    cov_ne_m2: Float


@dataclass(frozen=True, slots=True, eq=False)
class InformationIncrement:
    """What one update added, as a measurement: position north, east (2,) with covariance (2, 2), or with a heading."""

    position_ne_m: Float
    cov_ne_m2: Float


@dataclass(frozen=True, slots=True)
class PointMassConfig:
    """Cell size, extent and the rates of the hypotheses that the grid does not hold."""

    cell_m: float = 0.5
    max_cells: int = 401
    extent_sigmas: float = 5.0
    min_half_extent_m: float = 12.0
    lost_leak: float = 1e-3


class PointMassFilter:
    """Density over north and east, with the probability that the vehicle is elsewhere altogether.

    The grid's first cell lies at (``north_max_m``, ``east_min_m``), rows to the south, columns to the east.
    """

    def __init__(self, mean_ne_m: Float, cov_ne_m2: Float, config: PointMassConfig | None = None) -> None:
        self.config = config or PointMassConfig()
        self.lost_probability = 0.0
        self._place_gaussian(mean_ne_m, cov_ne_m2)

    def _place_gaussian(self, mean_ne_m: Float, cov_ne_m2: Float) -> None:
        std = np.sqrt(np.diag(cov_ne_m2))
        half = np.maximum(self.config.extent_sigmas * std, self.config.min_half_extent_m)
        self.cell_m = max(self.config.cell_m, float(2.0 * half.max() / self.config.max_cells))
        rows, cols = (2 * np.ceil(half / self.cell_m) + 1).astype(int)
        self.north_max_m = float(mean_ne_m[0] + 0.5 * (rows - 1) * self.cell_m)
        self.east_min_m = float(mean_ne_m[1] - 0.5 * (cols - 1) * self.cell_m)
        self.density = np.ones((rows, cols))
        offset = np.stack(np.meshgrid(*self.axes(), indexing="ij"), axis=-1) - mean_ne_m
        exponent = np.einsum("...i,ij,...j->...", offset, np.linalg.inv(cov_ne_m2), offset)
        self.density = np.exp(-0.5 * exponent)
        self.density /= self.density.sum()

    def axes(self) -> tuple[Float, Float]:
        """North of the rows (rows,) and east of the columns (cols,)."""
        rows, cols = self.density.shape
        north = self.north_max_m - self.cell_m * np.arange(rows, dtype=np.float64)
        east = self.east_min_m + self.cell_m * np.arange(cols, dtype=np.float64)
        return north, east

    def predict(self, displacement_ne_m: Float, cov_ne_m2: Float) -> None:
        """Move by an odometry displacement (2,) of covariance (2, 2)."""
        self.north_max_m += float(displacement_ne_m[0])
        self.east_min_m += float(displacement_ne_m[1])
        std = np.sqrt(np.maximum(np.diag(cov_ne_m2), 0.0)) / self.cell_m
        # a blur narrower than a third of a cell would only lose mass to rounding: it is saved up by the caller's next
        pad = int(np.ceil(3.0 * std.max()))
        if pad > 0:
            self._grow(min(pad, 20))
        if std.max() > 0.05:
            self.density = cv2.GaussianBlur(
                self.density, (0, 0), sigmaX=max(float(std[1]), 0.05), sigmaY=max(float(std[0]), 0.05),
                borderType=cv2.BORDER_CONSTANT,
            )  # fmt: skip
        self.density /= self.density.sum()
        self._trim()

    def _grow(self, cells: int) -> None:
        self.density = np.pad(self.density, cells)
        self.north_max_m += cells * self.cell_m
        self.east_min_m -= cells * self.cell_m

    def _trim(self) -> None:
        """Drop empty borders; coarsen when the grid is larger than it may be."""
        keep_rows = np.flatnonzero(self.density.sum(axis=1) > 1e-7)
        keep_cols = np.flatnonzero(self.density.sum(axis=0) > 1e-7)
        low_r, high_r, low_c, high_c = keep_rows[0], keep_rows[-1] + 1, keep_cols[0], keep_cols[-1] + 1
        self.density = self.density[low_r:high_r, low_c:high_c]
        self.north_max_m -= low_r * self.cell_m
        self.east_min_m += low_c * self.cell_m
        self.density = self.density / self.density.sum()
        if max(self.density.shape) > self.config.max_cells:
            moments = self.moments()
            self._resample(moments, 2.0 * self.cell_m)

    def _resample(self, moments: Moments, cell_m: float) -> None:
        std = np.sqrt(np.diag(moments.cov_ne_m2))
        half = np.maximum(self.config.extent_sigmas * std, self.config.min_half_extent_m)
        rows, cols = np.minimum((2 * np.ceil(half / cell_m) + 1).astype(int), self.config.max_cells)
        north_max = float(moments.mean_ne_m[0] + 0.5 * (rows - 1) * cell_m)
        east_min = float(moments.mean_ne_m[1] - 0.5 * (cols - 1) * cell_m)
        ratio = cell_m / self.cell_m
        matrix = np.array(
            [
                [ratio, 0.0, (east_min - self.east_min_m) / self.cell_m],
                [0.0, ratio, (self.north_max_m - north_max) / self.cell_m],
            ]
        )
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        density = cv2.warpAffine(self.density, matrix, (int(cols), int(rows)), flags=flags)
        self.density = np.maximum(density, 0.0) / max(float(density.sum()), 1e-300)
        self.north_max_m, self.east_min_m, self.cell_m = north_max, east_min, cell_m

    def update(self, likelihood: Float, north_max_m: float, east_min_m: float) -> float:
        """Multiply by a likelihood (rows, cols) of mean one on its own grid of the same cell size.

        Outside its grid it counts as its minimum. Returns the evidence: its mean under the density before.
        """
        rows, cols = self.density.shape
        matrix = np.array(
            [
                [1.0, 0.0, (self.east_min_m - east_min_m) / self.cell_m],
                [0.0, 1.0, (north_max_m - self.north_max_m) / self.cell_m],
            ]
        )
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        floor = float(likelihood.min())
        here = cv2.warpAffine(
            likelihood, matrix, (cols, rows), flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=floor
        )
        posterior = self.density * np.maximum(here, 1e-12)
        evidence = float(posterior.sum())
        lost = self.lost_probability + (1.0 - self.lost_probability) * self.config.lost_leak
        on_grid = (1.0 - lost) * evidence
        # off the grid a picture matches nothing in particular: likelihood one, the mean
        self.lost_probability = lost / (lost + on_grid)
        self.density = posterior / evidence
        return evidence

    def moments(self) -> Moments:
        """Mean and covariance of the density on the grid."""
        north, east = self.axes()
        by_row, by_col = self.density.sum(axis=1), self.density.sum(axis=0)
        mean = np.array([by_row @ north, by_col @ east])
        dn, de = north - mean[0], east - mean[1]
        cross = float(dn @ self.density @ de)
        within = self.cell_m**2 / 12.0
        cov = np.array([[by_row @ dn**2 + within, cross], [cross, by_col @ de**2 + within]])
        return Moments(mean, cov)

    def mode_ne_m(self) -> Float:
        """The most likely place (2,), north and east."""
        north, east = self.axes()
        row, col = np.unravel_index(int(np.argmax(self.density)), self.density.shape)
        return np.array([north[row], east[col]])

    def unimodality(self) -> float:
        """Share of the density that belongs to the mode of the highest cell, however elongated it is.

        The cells around the highest that exceed a twentieth of it reach 2.45 sigma of a Gaussian and, evenly weighted,
        have 1.5 times its covariance; counted is what lies within 3.7 sigma or two cells more.
        """
        north, east = self.axes()
        row, col = np.unravel_index(int(np.argmax(self.density)), self.density.shape)
        core = self.density > 0.05 * float(self.density[row, col])
        _, labels = cv2.connectedComponents(core.astype(np.uint8))
        rows, cols = np.nonzero(labels == labels[row, col])
        places = np.stack((north[rows], east[cols]), axis=-1)
        centre = places.mean(axis=0)
        offset = places - centre
        cov = offset.T @ offset / len(places) / 1.5 + np.eye(2) * (0.5 * self.cell_m) ** 2
        far = np.stack(np.meshgrid(north - centre[0], east - centre[1], indexing="ij"), axis=-1)
        distance2 = np.einsum("...i,ij,...j->...", far, np.linalg.inv(cov), far)
        return float(self.density[distance2 < 3.7**2].sum())


def information_increment(prior: Moments, posterior: Moments) -> InformationIncrement | None:
    """The measurement that takes the prior to the posterior, None where the update added no information.

    R = (P+^-1 - P-^-1)^-1, z = R (P+^-1 x+ - P-^-1 x-): handing over only the increment keeps the odometry, which both
    filters use, from counting twice. Directions without gain get a variance of 1e6 m2.
    """
    before, after = np.linalg.inv(prior.cov_ne_m2), np.linalg.inv(posterior.cov_ne_m2)
    gain, axes = np.linalg.eigh(after - before)
    if gain.max() <= 1e-6:
        return None
    vector = axes.T @ (after @ posterior.mean_ne_m - before @ prior.mean_ne_m)
    prior_along = axes.T @ posterior.mean_ne_m
    variance = np.where(gain > 1e-6, 1.0 / np.maximum(gain, 1e-6), 1e6)
    along = np.where(gain > 1e-6, vector * variance, prior_along)
    return InformationIncrement(axes @ along, axes @ np.diag(variance) @ axes.T)
