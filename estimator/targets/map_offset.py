"""How far the whole reference image is displaced, from places on it whose coordinates were surveyed.

Conte's thesis (2009, section 7.5) found a satellite image three metres off by one measured truck, and took that out by
hand; its conclusion names a calibration of the reference as a condition of the method. The displacement is the mean of
surveyed minus found, weighed by what each point is good to, with points that do not fit held down by Student's t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.types import Float

MIN_POINTS = 2
NU = 4.0
ITERATIONS = 50
CHANGE_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class MapOffset:
    """To be added to every position read off the image: north and east (2,) in metres, with covariance (2, 2).

    ``weights`` (n,) are what each point was believed. ``misfit`` is the square root of the weighted mean square of the
    points' normalised residuals: near 1 where they scatter as they claim. Where it is more, the covariance has been
    widened by it; the image is then distorted, too, or points are worse than stated.
    """

    offset_ne_m: Float
    cov_ne_m2: Float
    weights: Float
    misfit: float


def map_offset(surveyed_minus_found_ne_m: Float, cov_ne_m2: Float) -> MapOffset:
    """The displacement by points' differences (n, 2) with their covariances (n, 2, 2).

    Raises
    ------
    ValueError
        There are fewer than two points (one says nothing of how well points fit), a number is not finite, or a
        covariance is not positive definite.
    """
    d, cov = np.asarray(surveyed_minus_found_ne_m, dtype=np.float64), np.asarray(cov_ne_m2, dtype=np.float64)
    if len(d) < MIN_POINTS or d.shape != (len(d), 2) or cov.shape != (len(d), 2, 2):
        message = f"at least {MIN_POINTS} points with two numbers each are needed, and a covariance for each"
        raise ValueError(message)
    if not (np.isfinite(d).all() and np.isfinite(cov).all() and np.linalg.eigvalsh(cov).min() > 0.0):
        message = "differences must be finite, covariances positive definite"
        raise ValueError(message)
    information = np.linalg.inv(cov)
    offset, weights = np.median(d, axis=0), np.ones(len(d))
    for _ in range(ITERATIONS):
        residual = d - offset
        d2 = np.einsum("ni,nij,nj->n", residual, information, residual)
        weights = np.minimum((NU + 2.0) / (NU + d2), 1.0)
        total = np.einsum("n,nij->ij", weights, information)
        before, offset = offset, np.linalg.solve(total, np.einsum("n,nij,nj->i", weights, information, d))
        if float(np.linalg.norm(offset - before)) < CHANGE_M:
            break
    free = 2.0 * max(float(weights.sum()) - 1.0, 0.5)
    misfit = float(np.sqrt((weights * d2).sum() / free))
    found = np.asarray(np.linalg.inv(total), dtype=np.float64) * max(misfit, 1.0) ** 2
    return MapOffset(offset, found, weights, misfit)
