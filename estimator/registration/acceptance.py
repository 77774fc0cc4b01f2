"""Is the place right? One outlier probability from everything that a trial of a candidate showed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.registration.confirm import Evidence
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class AcceptanceWeights:
    """Logistic regression from evidence to the log odds of a wrong place; versioned because answers depend on it.

    Fitted by ``python -m benchmarks.locate --fit`` on the tuning halves and on priors that lead elsewhere; but for
    ``pairs``, which is set by hand, as no wrong place there had more than a few. ``accept_below`` is the outlier
    probability under which an answer is given.
    """

    version: str = "locate/2"
    bias: float = 8.1
    margin: float = -0.91
    agreement: float = -6.5
    second_height: float = -1.65
    second_margin: float = -0.72
    pairs: float = -0.5
    strain: float = 0.3
    accept_below: float = 0.12


FEATURES = ("margin", "agreement", "second_height", "second_margin", "pairs", "strain")


def features(evidence: Evidence) -> Float:
    """What the regression sees (6,): margins over the rival, the second channel's height, agreement, pairs, strain.

    Counts enter by their logarithm, and what is beyond doubt is clipped: a hundred pairs are no surer than fifty.
    """
    return np.array(
        [
            np.clip(evidence.height - evidence.rival, -3.0, 6.0),
            evidence.agreement,
            np.clip(evidence.second_height, 0.0, 12.0),
            np.clip(evidence.second_height - evidence.second_rival, -3.0, 6.0),
            np.log1p(min(evidence.pairs, 60)),
            np.clip(evidence.strain, 0.0, 5.0),
        ]
    )


def outlier_probability(evidence: Evidence, weights: AcceptanceWeights) -> float:
    """Probability that the place is wrong."""
    w = np.array([getattr(weights, name) for name in FEATURES])
    log_odds = weights.bias + float(w @ features(evidence))
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -30.0, 30.0))))


def fit_weights(rows: Float, wrong: Float, ridge: float = 0.3, counts: Float | None = None) -> Float:
    """Bias and weights (k + 1,) by penalised logistic regression on feature rows (n, k) and labels (n,), one for wrong.

    Newton's method on standardised features; the ridge keeps separable data from running to infinity. ``counts`` (n,)
    says how often each row counts, once unless given.
    """
    counts = np.ones(len(rows)) if counts is None else counts
    mean, std = rows.mean(axis=0), np.maximum(rows.std(axis=0), 1e-6)
    A = np.concatenate((np.ones((len(rows), 1)), (rows - mean) / std), axis=1)
    penalty = ridge * np.diag([0.0, *np.ones(rows.shape[1])])
    w = np.zeros(A.shape[1])
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-np.clip(A @ w, -30.0, 30.0)))
        H = A.T @ (A * (counts * p * (1.0 - p))[:, None]) + penalty + 1e-9 * np.eye(len(w))
        w = w - np.linalg.solve(H, A.T @ (counts * (p - wrong)) + penalty @ w)
    slopes = w[1:] / std
    return np.concatenate(([w[0] - slopes @ mean], slopes))
