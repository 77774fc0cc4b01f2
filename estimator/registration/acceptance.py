"""Is the place right? One outlier probability from everything that a trial of a candidate showed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.registration.confirm import Evidence
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class AcceptanceWeights:
    """Logistic regression from evidence to the log odds of a wrong place; versioned because answers depend on it.

    ``benchmarks/locate.py --fit`` refits it; ``accept_below`` is the outlier probability under which an answer is
    given.
    """

    version: str = "locate/1"
    bias: float = 9.0
    height: float = -0.9
    margin: float = -1.2
    agreement: float = -2.0
    pairs: float = -1.0
    strain: float = 0.3
    accept_below: float = 0.05


def features(evidence: Evidence) -> Float:
    """What the regression sees (5,): height, margin over the rival, agreement, pairs of keypoints, strain.

    Counts enter by their logarithm, and what is beyond doubt is clipped: a hundred pairs are no surer than fifty.
    """
    return np.array(
        [
            np.clip(evidence.height, 0.0, 12.0),
            np.clip(evidence.height - evidence.rival, -3.0, 6.0),
            evidence.agreement,
            np.log1p(min(evidence.pairs, 60)),
            np.clip(evidence.strain, 0.0, 5.0),
        ]
    )


def outlier_probability(evidence: Evidence, weights: AcceptanceWeights) -> float:
    """Probability that the place is wrong."""
    w = np.array([weights.height, weights.margin, weights.agreement, weights.pairs, weights.strain])
    log_odds = weights.bias + float(w @ features(evidence))
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -30.0, 30.0))))


def fit_weights(rows: Float, wrong: Float, ridge: float = 0.3) -> Float:
    """Bias and weights (6,) by penalised logistic regression on feature rows (n, 5) and labels (n,), one for wrong.

    Newton's method on standardised features; the ridge keeps separable data from running to infinity.
    """
    mean, std = rows.mean(axis=0), np.maximum(rows.std(axis=0), 1e-6)
    A = np.concatenate((np.ones((len(rows), 1)), (rows - mean) / std), axis=1)
    penalty = ridge * np.diag([0.0, *np.ones(rows.shape[1])])
    w = np.zeros(A.shape[1])
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-np.clip(A @ w, -30.0, 30.0)))
        H = A.T @ (A * (p * (1.0 - p))[:, None]) + penalty + 1e-9 * np.eye(len(w))
        w = w - np.linalg.solve(H, A.T @ (p - wrong) + penalty @ w)
    slopes = w[1:] / std
    return np.concatenate(([w[0] - slopes @ mean], slopes))
