"""From a similarity surface to a calibrated likelihood over displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.ports import Correlation
from estimator.registration.verify import Peak
from estimator.types import Float

MAX_OUTLIER = 0.98


class LikelihoodForm(StrEnum):
    """``matched`` is calibrated by the surface's own clutter; ``similarity`` takes the correlation itself as a density.

    The second is Conte 2009, section 5.8.4, with what is below zero left out, for comparison.
    """

    MATCHED = "matched"
    SIMILARITY = "similarity"


@dataclass(frozen=True, slots=True)
class LikelihoodCalibration:
    """How far to trust a similarity surface; fitted numbers come from ``calibration.calibration_of``.

    ``temperature`` scales the log likelihood of a matched filter: one if neighbouring pixels erred independently of the
    scene, less because they do not. ``power`` is that of the peak's height in it: one for a matched filter, less
    because a high peak is not as much sharper. ``map_std_m`` and ``map_std_px`` make up the standard deviation of the
    reference's own local error. The probability that the surface says nothing of the truth is ``floor`` and ``doubt``
    times the outlier probability: where the peak is wrong the truth may still be among the lesser ones.
    """

    temperature: float
    power: float
    map_std_m: float
    map_std_px: float
    floor: float
    doubt: float
    form: LikelihoodForm = LikelihoodForm.MATCHED

    def local_std_m(self, step_m: float) -> float:
        """Standard deviation of the reference's own local error, matched in steps of ``step_m``."""
        return float(np.hypot(self.map_std_m, self.map_std_px * step_m))


def log_matched(similarity: NDArray[np.floating], peak: Peak, calibration: LikelihoodCalibration) -> Float:
    """Log likelihood of similarities, up to a constant: t z0^q z, with z in deviations of the surface's clutter.

    A similarity is signal plus clutter of standard deviation s, which the surface itself shows away from its peak; with
    a signal of the peak's size c0 the log likelihood of a place is c0 c / s^2 = z0 z. Lines and repeated patterns make
    large clutter, so a peak on them says little (Pilotage methods, section 2.3, compares other forms). With q = 1 it is
    that; with q = 0 a softmax of the surface in its own deviations.
    """
    clutter = max(peak.clutter_std, 1e-6)
    height = max(peak.height / clutter, 0.0)
    # what does not stand out of its clutter says less and less, whatever the power
    sharpness = calibration.temperature * (height**calibration.power if height > 1.0 else height)
    out: Float = np.asarray(similarity, dtype=np.float64) * (sharpness / clutter)
    return out


def likelihood(
    correlation: Correlation,
    peak: Peak,
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
    p = (1 - e) normalised exp(t z0^q z), convolved with the map's error, + e / area; in the form ``similarity`` it is
    max(z, 0), normalised.
    """
    (values,) = likelihoods(correlation, [correlation.surface], peak, calibration, outlier_probability, step_m, weight)
    return values, correlation.north_max_m, correlation.east_min_m


def likelihoods(
    correlation: Correlation,
    surfaces: Sequence[NDArray[np.float32]],
    peak: Peak,
    calibration: LikelihoodCalibration,
    outlier_probability: float,
    step_m: float,
    weight: float = 1.0,
) -> list[Float]:
    """The same for several hypotheses' surfaces on one grid, of mean one over all of them together.

    ``peak`` is that of the best: one scale of clutter makes them comparable.
    """
    fine: list[Float] = [_resampled(surface, correlation.step_m / step_m) for surface in surfaces]
    if calibration.form is LikelihoodForm.SIMILARITY:
        similar: list[Float] = [np.maximum(each, 1e-6) for each in fine]
        mean = float(np.mean(similar))
        return [each / mean for each in similar]
    log_p = [log_matched(each, peak, calibration) for each in fine]
    top = max(float(each.max()) for each in log_p)
    sigma = max(calibration.local_std_m(correlation.step_m) / step_m / np.sqrt(weight), 0.3)
    p = [_blurred(np.exp(weight * (each - top)), sigma) for each in log_p]
    mean = float(np.mean(p))
    outlier = min(calibration.floor + calibration.doubt * outlier_probability, MAX_OUTLIER)
    return [(1.0 - outlier) * each / mean + outlier for each in p]


def _blurred(p: Float, sigma_cells: float) -> Float:
    blurred = cv2.GaussianBlur(p, (0, 0), sigma_cells, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blurred, dtype=np.float64)


def _resampled(surface: NDArray[np.float32], ratio: float) -> Float:
    """A surface with ``ratio`` times as many samples to a length, -1 where nothing is known."""
    rows, cols = surface.shape
    shape = (max(1, round((rows - 1) * ratio)) + 1, max(1, round((cols - 1) * ratio)) + 1)
    known = np.nan_to_num(surface, nan=-1.0).astype(np.float32)
    row_at = (np.arange(shape[0], dtype=np.float32) / np.float32(ratio))[:, None].repeat(shape[1], axis=1)
    col_at = (np.arange(shape[1], dtype=np.float32) / np.float32(ratio))[None].repeat(shape[0], axis=0)
    fine = cv2.remap(known, col_at, row_at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(fine, dtype=np.float64)
