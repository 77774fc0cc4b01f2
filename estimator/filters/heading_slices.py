"""Point-mass filter over north, east and a few headings, for when the heading is open.

Given the heading, everything is as in `PointMassFilter`; so there is one for each heading, with a probability. A wrong
heading then fails by itself: the odometry carries its density another way, and pictures fit it less.
"""

from __future__ import annotations

import cv2
import numpy as np

from estimator.filters.point_mass import Moments, PointMassConfig, PointMassFilter
from estimator.types import Float

NEGLIGIBLE = 1e-6
"""Probability under which a heading is left as it is: its density would be blurred and multiplied for nothing."""


class HeadingSlices:
    """Density over north, east and heading, with the probability that the vehicle is elsewhere altogether.

    ``headings_rad`` (k,), evenly spaced, are what the predicted heading may be off by, ``probabilities`` (k,) theirs,
    and ``slices`` the densities given them.
    """

    def __init__(
        self, mean_ne_m: Float, cov: Float, headings_rad: Float, config: PointMassConfig | None = None
    ) -> None:
        """A Gaussian of mean (2,) and no turn, of covariance (3, 3) over north, east in metres and heading in radians.

        Raises
        ------
        ValueError
            Fewer than two headings, or a heading that is certain.
        """
        if len(headings_rad) < 2 or not cov[2, 2] > 0.0:
            message = "slices need at least two headings, and a heading that is not certain"
            raise ValueError(message)
        self.config = config or PointMassConfig()
        self.headings_rad = np.asarray(headings_rad, dtype=np.float64)
        self.lost_probability = 0.0
        prior = np.exp(-0.5 * self.headings_rad**2 / cov[2, 2])
        self.probabilities: Float = prior / prior.sum()
        by_heading = cov[:2, 2] / cov[2, 2]
        given = cov[:2, :2] - np.outer(by_heading, cov[:2, 2])
        self.slices = [
            PointMassFilter(mean_ne_m + by_heading * heading, given, self.config) for heading in self.headings_rad
        ]

    @property
    def cell_m(self) -> float:
        """Cell size of the likeliest heading's grid."""
        return self._best().cell_m

    def _best(self) -> PointMassFilter:
        return self.slices[int(np.argmax(self.probabilities))]

    def predict(self, displacement_ne_m: Float, cov_ne_m2: Float) -> None:
        """Move by an odometry displacement (2,) of covariance (2, 2), turned with each heading."""
        for heading, density in zip(self.headings_rad, self.slices, strict=True):
            cos, sin = np.cos(heading), np.sin(heading)
            density.predict(np.array([[cos, -sin], [sin, cos]]) @ displacement_ne_m, cov_ne_m2)

    def update(self, likelihoods: list[Float], north_max_m: float, east_min_m: float, cell_m: float) -> None:
        """Multiply by likelihoods (rows, cols) for each heading, of mean one over all of them, on one grid."""
        evidence = np.array(
            [
                density.update(_on_cells(values, cell_m, density.cell_m), north_max_m, east_min_m)
                if probability > NEGLIGIBLE
                else float(values.min())
                for probability, density, values in zip(self.probabilities, self.slices, likelihoods, strict=True)
            ]
        )
        joint = self.probabilities * evidence
        lost = self.lost_probability + (1.0 - self.lost_probability) * self.config.lost_leak
        self.lost_probability = float(lost / (lost + (1.0 - lost) * joint.sum()))
        self.probabilities = joint / joint.sum()

    def moments(self) -> Moments:
        """Mean (3,) and covariance (3, 3) over north, east in metres and heading in radians."""
        each = [density.moments() for density in self.slices]
        means = np.array([[*m.mean_ne_m, heading] for m, heading in zip(each, self.headings_rad, strict=True)])
        mean = self.probabilities @ means
        offset = means - mean
        cov = np.einsum("k,ki,kj->ij", self.probabilities, offset, offset)
        cov[:2, :2] += np.einsum("k,kij->ij", self.probabilities, np.array([m.cov_ne_m2 for m in each]))
        step = float(self.headings_rad[1] - self.headings_rad[0])
        cov[2, 2] += step**2 / 12.0
        return Moments(mean, cov)

    def marginal(self) -> PointMassFilter:
        """The density over north and east, whatever the heading."""
        used = [(p, s) for p, s in zip(self.probabilities, self.slices, strict=True) if p > NEGLIGIBLE]
        cell_m = max(s.cell_m for _, s in used)
        axes = [s.axes() for _, s in used]
        north_max, east_min = max(n[0] for n, _ in axes), min(e[0] for _, e in axes)
        rows = int(np.ceil((north_max - min(n[-1] for n, _ in axes)) / cell_m)) + 1
        cols = int(np.ceil((max(e[-1] for _, e in axes) - east_min) / cell_m)) + 1
        total = np.zeros((rows, cols))
        for p, s in used:
            ratio = cell_m / s.cell_m
            matrix = np.array(
                [
                    [ratio, 0.0, (east_min - s.east_min_m) / s.cell_m],
                    [0.0, ratio, (s.north_max_m - north_max) / s.cell_m],
                ]
            )
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            total += p * ratio**2 * cv2.warpAffine(s.density, matrix, (cols, rows), flags=flags)
        together = PointMassFilter(np.zeros(2), np.eye(2), self.config)
        together.density, together.cell_m = total / total.sum(), cell_m
        together.north_max_m, together.east_min_m = float(north_max), float(east_min)
        return together

    def mode_ne_m(self) -> Float:
        """The most likely place (2,), north and east."""
        return self.marginal().mode_ne_m()

    def unimodality(self) -> float:
        """Share of the density that belongs to the mode of the highest cell, over all headings."""
        return self.marginal().unimodality()


def _on_cells(values: Float, from_m: float, to_m: float) -> Float:
    """A likelihood (rows, cols) on cells of another size, its first cell where it was."""
    if from_m == to_m:
        return values
    ratio = to_m / from_m
    size = (max(1, round((values.shape[1] - 1) / ratio)) + 1, max(1, round((values.shape[0] - 1) / ratio)) + 1)
    matrix = np.array([[ratio, 0.0, 0.0], [0.0, ratio, 0.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(values, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))
