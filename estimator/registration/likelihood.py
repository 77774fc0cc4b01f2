"""From a similarity surface to a calibrated likelihood over displacements."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.ports import Correlation
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class LikelihoodCalibration:
    """How far to trust a similarity surface; versioned because results depend on it.

    ``effective_fraction`` is the share of template pixels that count as independent samples in the generalised
    likelihood ratio p ~ (1 - C^2)^(-n/2); ``map_std_m`` the standard deviation of the reference's own local error;
    ``floor`` the smallest probability that the whole surface is wrong.
    """

    version: str = "double_angle/1"
    effective_fraction: float = 0.03
    map_std_m: float = 0.3
    map_std_px: float = 0.4
    floor: float = 0.02


def log_ratio(surface: NDArray[np.floating], samples: float) -> Float:
    """Log of the generalised likelihood ratio, -n/2 log(1 - C^2), zero for negative or unknown similarity."""
    positive = np.clip(np.nan_to_num(np.asarray(surface, dtype=np.float64), nan=0.0), 0.0, 0.999)
    out: Float = -0.5 * samples * np.log1p(-(positive**2))
    return out


def likelihood(
    correlation: Correlation,
    calibration: LikelihoodCalibration,
    outlier_probability: float,
    step_m: float,
    weight: float = 1.0,
) -> tuple[Float, float, float]:
    """Likelihood of each displacement on a grid of ``step_m``, relative to a uniform one.

    ``weight`` in (0, 1] tempers what an inlier says for its dependence on earlier pictures, not the chance that it is
    an outlier: tempering the floor too would leave a far prior without any pull.

    Returns
    -------
    values, north_max_m, east_min_m
        (rows, cols), mean one over the surface; the first entry's displacement.

    Notes
    -----
    p = (1 - e) normalised GLRT, convolved with the map's error, + e / area (methods as in the Pilotage notes, 2.3).
    """
    ratio = correlation.step_m / step_m
    rows, cols = correlation.surface.shape
    shape = (max(1, round((rows - 1) * ratio)) + 1, max(1, round((cols - 1) * ratio)) + 1)
    surface = np.nan_to_num(correlation.surface, nan=-1.0).astype(np.float32)
    row_at = (np.arange(shape[0], dtype=np.float32) / np.float32(ratio))[:, None].repeat(shape[1], axis=1)
    col_at = (np.arange(shape[1], dtype=np.float32) / np.float32(ratio))[None].repeat(shape[0], axis=0)
    fine = cv2.remap(surface, col_at, row_at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    log_p = log_ratio(np.asarray(fine, dtype=np.float32), calibration.effective_fraction * correlation.pixels)
    p = np.exp(weight * (log_p - log_p.max()))
    spread_m = float(np.hypot(calibration.map_std_m, calibration.map_std_px * correlation.step_m))
    p = cv2.GaussianBlur(p, (0, 0), max(spread_m / step_m / np.sqrt(weight), 0.3), borderType=cv2.BORDER_CONSTANT)
    p /= p.mean()
    outlier = max(outlier_probability, calibration.floor)
    values: Float = (1.0 - outlier) * p + outlier
    return values, correlation.north_max_m, correlation.east_min_m
