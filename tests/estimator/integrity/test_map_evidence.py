"""A sequential test: it decides on ground that differs, errs as seldom as it says, and can be turned round."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.integrity.map_evidence import MapEvidence, MapEvidenceConfig

ALIKE_M = 40.0


def flown(probabilities: np.ndarray, step_m: float, evidence: MapEvidence | None = None) -> MapEvidence:
    evidence = evidence or MapEvidence()
    for k, probability in enumerate(probabilities):
        evidence.add(float(probability), np.array([step_m * k, 0.0]), ALIKE_M)
    return evidence


def test_bad_matches_over_fresh_ground_speak_against_the_map() -> None:
    assert flown(np.full(40, 0.8), 10.0).against


def test_in_a_hover_no_number_of_bad_matches_decides() -> None:
    hover = flown(np.full(1000, 0.8), 0.0)

    assert not hover.against
    # the first counts once
    assert hover.log_odds == pytest.approx(np.log(0.8 / 0.2))


def test_matches_that_say_nothing_decide_nothing() -> None:
    assert flown(np.full(200, 0.5), 50.0).log_odds == 0.0


def test_a_long_good_flight_does_not_delay_the_discovery() -> None:
    after_good = flown(np.full(500, 0.05), 10.0)
    assert after_good.log_odds == -MapEvidenceConfig().limit_log_odds

    again = flown(np.full(80, 0.85), 10.0, after_good)

    assert again.against


def test_good_matches_bring_the_map_back() -> None:
    evidence = flown(np.full(80, 0.85), 10.0)
    assert evidence.against

    # halfway back it still stands: undone is undone
    halfway = MapEvidence()
    halfway.against, halfway.log_odds = True, 2.0
    halfway.add(0.5, np.zeros(2), ALIKE_M)
    assert halfway.against
    assert not flown(np.full(80, 0.05), 10.0, evidence).against


def test_one_certain_picture_is_bounded_and_nonsense_is_survived() -> None:
    evidence = flown(np.array([1.0]), 0.0)
    assert evidence.log_odds == MapEvidenceConfig().picture_log_odds
    assert np.isfinite(flown(np.array([0.0, 1.0, 0.0]), 100.0).log_odds)


def test_of_right_maps_it_condemns_no_more_than_it_says() -> None:
    """Independent pictures whose probabilities are calibrated: Wald bounds the error by exp(-3), a twentieth."""
    rng = np.random.default_rng(8)
    condemned = 0
    for _ in range(400):
        evidence = MapEvidence()
        # log odds of +-1: a right map shows the minus with probability 1 / (1 + e^-1)
        signs = np.where(rng.random(60) < 1.0 / (1.0 + np.exp(-1.0)), -1.0, 1.0)
        for k, sign in enumerate(signs):
            evidence.add(1.0 / (1.0 + np.exp(-sign)), np.array([1e4 * k, 0.0]), ALIKE_M)
            if evidence.against:
                condemned += 1
                break
    assert condemned / 400 < 0.05
