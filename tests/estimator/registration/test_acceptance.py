from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from estimator.registration.acceptance import AcceptanceWeights, features, fit_weights, outlier_probability
from estimator.registration.confirm import Evidence

MIDDLING = Evidence(0.2, 5.5, 4.2, 0.2, 4.5, 4.0, 1.0, 0, 8000)


def test_everything_that_speaks_for_a_place_makes_it_likelier() -> None:
    weights = AcceptanceWeights()
    at = outlier_probability(MIDDLING, weights)

    assert outlier_probability(replace(MIDDLING, height=9.0), weights) < at
    assert outlier_probability(replace(MIDDLING, rival=5.4), weights) > at
    assert outlier_probability(replace(MIDDLING, pairs=40), weights) < at
    assert outlier_probability(replace(MIDDLING, second_height=7.0), weights) < at
    assert 0.0 < at < 1.0


def test_nothing_is_accepted_on_noise() -> None:
    # the highest of some thousand places of pure clutter stands about four deviations high, and so does its rival
    assert outlier_probability(Evidence(0.05, 4.0, 3.9, 0.1, 2.0, 3.9, 1.0, 0, 8000), AcceptanceWeights()) > 0.9


def test_the_fit_finds_the_probabilities_that_labels_were_drawn_with() -> None:
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(4000, 5)) * [2.0, 1.0, 0.2, 1.0, 1.0] + [6.0, 1.0, 0.3, 1.0, 1.5]
    true = np.array([4.0, -0.8, -1.0, 2.0, -0.5, 0.3])
    p = 1.0 / (1.0 + np.exp(-(true[0] + rows @ true[1:])))
    wrong = (rng.uniform(size=len(p)) < p).astype(float)

    fitted = fit_weights(rows, wrong)

    again = 1.0 / (1.0 + np.exp(-(fitted[0] + rows @ fitted[1:])))
    assert_allclose(again, p, atol=0.08)  # three standard errors of six coefficients from 4000 draws


def test_features_are_bounded() -> None:
    wild = Evidence(1.0, 500.0, -500.0, 1.0, 500.0, -500.0, 90.0, 10_000, 1)

    assert np.isfinite(features(wild)).all()
    assert features(wild).max() <= 12.0
