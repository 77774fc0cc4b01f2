"""Numbers of a calibration by maximum likelihood, and how good a calibration is on registrations of known truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr
from scipy.stats import rankdata

from benchmarks.likelihood.samples import Sample
from estimator.registration.acceptance import fit_weights
from estimator.registration.calibration import Calibration
from estimator.registration.likelihood import MAX_OUTLIER, LikelihoodCalibration, likelihood, log_matched
from estimator.registration.verify import OutlierWeights
from estimator.types import Float

WRONG_PLACE_SHARE = 0.1
"""Share of matches at wrong places that the outlier probability is for; there are as many here as right ones."""
REGIONS = (0.5, 0.9, 0.95)
CELL_M = 0.5
MIN_FLOOR = 0.002
BINS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Quality:
    """How good a calibration is.

    ``nats`` is the mean log likelihood of the true displacement over that of a uniform density, ``inside`` the share of
    truths in the smallest regions of 50, 90 and 95 % of the probability. Of the outlier probability: ``log_loss``,
    ``auc`` (1 where every wrong match ranks over every right one), ``auc_right_places`` of right places alone, and
    ``stated`` against ``found`` in ten bins of equal weight; ``reliability`` is their mean distance.
    """

    nats: float
    inside: tuple[float, ...]
    log_loss: float
    auc: float
    auc_right_places: float
    stated: Float
    found: Float
    reliability: float


def fit(
    samples: Sequence[Sample], start: Calibration, version: str, fitted_on: dict[str, str | int],
    keep_likelihood: bool = False,
) -> Calibration:  # fmt: skip
    """A calibration of right and wrong places; with ``keep_likelihood`` the outlier probability alone is new.

    Raises
    ------
    ValueError
        There are no right or no wrong matches to tell apart.
    """
    outlier = fit_outlier(samples)
    if keep_likelihood:
        return Calibration(version, start.channel, fitted_on, start.likelihood, outlier)
    right = [s for s in samples if s.right_place]
    fitted = fit_likelihood(right, outlier_probabilities(right, outlier), start.likelihood)
    return Calibration(version, start.channel, fitted_on, fitted, outlier)


def fit_outlier(samples: Sequence[Sample]) -> OutlierWeights:
    """Weights of the outlier probability by penalised logistic regression."""
    wrong = np.array([s.wrong for s in samples], dtype=np.float64)
    if not 0.0 < wrong.sum() < len(wrong):
        message = f"{int(wrong.sum())} of {len(wrong)} matches are wrong: nothing to tell apart; take more pictures"
        raise ValueError(message)
    found = fit_weights(np.array([s.features for s in samples]), wrong, ridge=1.0, counts=_counts(samples))
    return OutlierWeights(float(found[0]), tuple(float(w) for w in found[1:]))


def outlier_probabilities(samples: Sequence[Sample], weights: OutlierWeights) -> Float:
    """What weights make of each sample's features (n,)."""
    log_odds = weights.bias + np.array([s.features for s in samples]) @ np.asarray(weights.weights)
    stated: Float = 1.0 / (1.0 + np.exp(-np.clip(log_odds, -30.0, 30.0)))
    return stated


def fit_likelihood(samples: Sequence[Sample], outlier: Float, start: LikelihoodCalibration) -> LikelihoodCalibration:
    """Temperature and power, the map's error, floor and doubt under which the true displacements are most likely.

    The predictive density is (1 - e) p_T + e / area, with e the floor and the doubt times the outlier probability (n,);
    p_T is evaluated at the truth alone, on the surface's own pixels.
    """

    def calibration(x: Float) -> LikelihoodCalibration:
        t, std_m, std_px, floor, doubt = np.exp(x[:5]).tolist()
        floor = min(max(floor, MIN_FLOOR), 0.5)
        return replace(
            start,
            temperature=t,
            power=float(x[5]),
            map_std_m=std_m,
            map_std_px=std_px,
            floor=floor,
            doubt=min(doubt, 1.0),
        )

    def loss(x: Float) -> float:
        tried = calibration(x)
        p = np.array([inlier_density(s, tried) for s in samples])
        e = np.minimum(tried.floor + tried.doubt * outlier, MAX_OUTLIER)
        # a weak pull towards a tenth of a metre, of a pixel, of the probability: what the data does not tell must not
        # run away
        pull = 0.01 * float((x[1:5] + 2.3) @ (x[1:5] + 2.3))
        return float(-np.log((1.0 - e) * p + e).sum() + pull)

    positive = [start.temperature, max(start.map_std_m, 0.05), max(start.map_std_px, 0.05), start.floor, 0.1]
    x0 = np.append(np.log(positive), start.power)
    found = minimize(loss, x0, method="Nelder-Mead", options={"xatol": 0.01, "fatol": 0.02, "maxfev": 450}).x
    return calibration(np.asarray(found, dtype=np.float64))


def inlier_density(sample: Sample, calibration: LikelihoodCalibration) -> float:
    """p_T at the true displacement, over that of a uniform density; 0 where the truth lies beyond the surface."""
    correlation, truth = sample.correlation, sample.displacement_ne_m
    if correlation is None or truth is None:
        message = "a wrong place has no true displacement"
        raise ValueError(message)
    step = correlation.step_m
    row, col = (correlation.north_max_m - truth[0]) / step, (truth[1] - correlation.east_min_m) / step
    rows, cols = correlation.surface.shape
    if not (0.0 <= row <= rows - 1.0 and 0.0 <= col <= cols - 1.0):
        return 0.0
    surface = np.nan_to_num(correlation.surface, nan=-1.0).astype(np.float64)
    log_p = log_matched(surface - surface.max(), sample.peak, calibration)
    p = np.exp(log_p)
    spread_px = max(calibration.local_std_m(step) / step, 0.3)
    by_row, by_col = (
        np.exp(-0.5 * ((np.arange(n) - at) / spread_px) ** 2) / (np.sqrt(2.0 * np.pi) * spread_px)
        for n, at in ((rows, row), (cols, col))
    )
    # what the blur carries over the surface's rim is not there any more
    stays_row, stays_col = (
        ndtr((n - 0.5 - np.arange(n)) / spread_px) - ndtr((-0.5 - np.arange(n)) / spread_px) for n in (rows, cols)
    )
    return float((by_row @ p @ by_col) * p.size / (stays_row @ p @ stays_col))


def quality(samples: Sequence[Sample], calibration: Calibration) -> Quality:
    """A calibration on samples that it was not fitted on, through the estimator's own functions."""
    stated = outlier_probabilities(samples, calibration.outlier)
    rights = [(s, float(p)) for s, p in zip(samples, stated, strict=True) if s.right_place]
    at_truth, held = zip(*(_at_truth(s, p, calibration.likelihood) for s, p in rights), strict=True)
    wrong, counts = np.array([s.wrong for s in samples]), _counts(samples)
    right_place = np.array([s.right_place for s in samples])
    by_bin = _reliability(stated, wrong, counts)
    loss = -np.average(np.log(np.clip(np.where(wrong, stated, 1.0 - stated), 1e-9, 1.0)), weights=counts)
    return Quality(
        float(np.mean(np.log(at_truth))), tuple(float(np.mean(np.array(held) <= share)) for share in REGIONS),
        float(loss), auc(stated, wrong), auc(stated[right_place], wrong[right_place]),
        by_bin[0], by_bin[1], float(np.abs(by_bin[0] - by_bin[1]).mean()),
    )  # fmt: skip


def _at_truth(sample: Sample, outlier: float, calibration: LikelihoodCalibration) -> tuple[float, float]:
    """Likelihood at the truth over a uniform one, and the probability of all places that are more likely."""
    correlation, truth = sample.correlation, sample.displacement_ne_m
    if correlation is None or truth is None:
        message = "a wrong place has no true displacement"
        raise ValueError(message)
    values, north_max_m, east_min_m = likelihood(correlation, sample.peak, calibration, outlier, CELL_M)
    row, col = round((north_max_m - truth[0]) / CELL_M), round((truth[1] - east_min_m) / CELL_M)
    if not (0 <= row < values.shape[0] and 0 <= col < values.shape[1]):
        return float(values.min()), 1.0
    here = float(values[row, col])
    return here, float(values[values > here].sum() / values.sum())


def _counts(samples: Sequence[Sample]) -> Float:
    """What each sample counts (n,): right places one, wrong ones so that they are a share of all."""
    right = np.array([s.right_place for s in samples])
    each = WRONG_PLACE_SHARE / (1.0 - WRONG_PLACE_SHARE) * right.sum() / max(int((~right).sum()), 1)
    return np.where(right, 1.0, each)


def _reliability(stated: Float, wrong: np.ndarray, counts: Float) -> tuple[Float, Float]:
    """Mean stated probability and share of wrong matches in bins of equal weight."""
    order = np.argsort(stated, kind="stable")
    along = np.cumsum(counts[order]) / counts.sum()
    bins = [order[(along > k / BINS) & (along <= (k + 1) / BINS)] for k in range(BINS)]
    bins = [b for b in bins if len(b)]
    return (
        np.array([np.average(stated[b], weights=counts[b]) for b in bins]),
        np.array([np.average(wrong[b], weights=counts[b]) for b in bins]),
    )


def auc(stated: Float, wrong: np.ndarray) -> float:
    """Probability that a wrong match is stated a higher value than a right one; NaN without both."""
    bad = int(wrong.sum())
    good = len(wrong) - bad
    if bad == 0 or good == 0:
        return float("nan")
    return float((rankdata(stated)[wrong].sum() - bad * (bad + 1) / 2.0) / (bad * good))
