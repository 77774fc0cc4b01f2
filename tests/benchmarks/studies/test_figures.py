"""Figures against what is known of Gaussians and of plain geometry."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.studies.figures import drift, drift_figures, innovation_figures, navigation_figures, pooled, scored

COV = np.array([[4.0, 1.5], [1.5, 2.0]])


def test_errors_drawn_from_the_stated_covariance_are_consistent() -> None:
    rng = np.random.default_rng(5)
    error = rng.multivariate_normal(np.zeros(2), COV, 40_000)
    figures = navigation_figures(
        [scored(error, np.tile(COV, (len(error), 1, 1)), np.ones(len(error)), np.zeros(len(error)))]
    )

    # three standard errors of 40000 draws
    assert_allclose(figures["nees_per_dof"], 1.0, atol=0.015)
    assert_allclose([figures["inside_50"], figures["inside_90"], figures["inside_95"]], [0.5, 0.9, 0.95], atol=0.008)
    assert_allclose(figures["rms_m"], np.sqrt(np.trace(COV)), rtol=0.01)
    # of two-dimensional Gaussians exp(-12.5) lie beyond five sigma: none or one of these
    assert figures["wrong"] <= 1 / 40_000


def test_a_stated_sigma_six_times_too_small_is_told() -> None:
    error = np.array([[6.0, 0.0], [0.0, 0.1]])
    figures = navigation_figures([scored(error, np.tile(np.eye(2), (2, 1, 1)), np.ones(2), np.zeros(2))])

    assert figures["wrong"] == 0.5
    assert_allclose(figures["nees_per_dof"], (36.0 + 0.01) / 4.0)


def test_a_covariance_without_extent_counts_as_wrong() -> None:
    figures = navigation_figures([scored(np.ones((1, 2)), np.zeros((1, 2, 2)), np.ones(1), np.zeros(1))])

    assert figures["wrong"] == 1.0
    assert figures["inside_95"] == 0.0


def test_available_is_declared_valid_and_near() -> None:
    error = np.array([[9.9, 0.0], [10.1, 0.0], [1.0, 0.0], [1.0, 1.0]])
    figures = navigation_figures(
        [scored(error, np.tile(np.eye(2), (4, 1, 1)), np.array([1.0, 1.0, 0.0, 1.0]), np.zeros(4))]
    )

    assert figures["availability"] == 0.5
    assert figures["declared_valid"] == 0.75


def test_a_wrong_scale_drifts_by_its_share_and_a_wrong_heading_not_at_all() -> None:
    angle = np.radians(3.0)
    true = np.stack((np.linspace(0.0, 900.0, 901), np.zeros(901)), axis=-1)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    walked = 1.02 * true @ turn.T
    lengths = (100.0, 800.0, 5000.0)
    found = drift(true, walked - true, np.full(901, angle), lengths)
    unaware = drift(true, true @ turn.T - true, np.zeros(901), lengths)

    assert_allclose(found[100.0], 0.02, rtol=1e-9)
    assert_allclose(found[800.0], 0.02, rtol=1e-9)
    # a heading that turns within the segment does count: by its chord
    assert_allclose(unaware[100.0], 2.0 * np.sin(angle / 2.0), rtol=1e-9)
    assert len(found[100.0]) == 80
    figures = drift_figures([found])
    assert_allclose(figures["drift"], 0.02)
    assert "drift_5000_m" not in figures


def test_heading_is_scored_once_there_was_time_to_find_it() -> None:
    heading = np.radians(np.array([10.0, 8.0, 3.0, -3.0]))
    figures = navigation_figures([scored(np.zeros((4, 2)), np.tile(np.eye(2), (4, 1, 1)), np.ones(4), heading)])

    assert_allclose(figures["heading_rms_deg"], 3.0)


def test_figures_of_seeds_are_averaged_with_their_standard_error() -> None:
    assert pooled([{"a": 1.0}, {"a": 3.0}]) == {"a": 2.0, "a_se": pytest.approx(1.0)}
    assert pooled([{"a": 1.0}]) == {"a": 1.0}
    assert pooled([{"b": 0.0}, {"a": 2.0, "b": 1.0}])["a"] == 2.0


def test_nothing_to_score_is_an_error() -> None:
    with pytest.raises(ValueError, match="no replay"):
        navigation_figures([])


def test_valid_and_by_vision_are_told_apart() -> None:
    error = np.array([[1.0, 0.0], [0.0, 12.0], [2.0, 0.0], [0.0, 1.0]])
    covariances = np.tile(np.eye(2), (4, 1, 1))
    by_vision = np.array([1.0, 1.0, 0.0, 1.0])
    figures = navigation_figures([scored(error, covariances, np.array([1.0, 1.0, 1.0, 0.0]), np.zeros(4), by_vision)])
    assert figures["declared_valid"] == pytest.approx(0.75)
    assert figures["availability"] == pytest.approx(0.5)
    assert figures["by_vision"] == pytest.approx(0.75)


def test_innovations_are_pooled_by_how_many_numbers_they_hold() -> None:
    runs = [
        {"fix": {"numbers": 10, "nis_per_dof": 1.0}, "barometer": {"numbers": 60, "nis_per_dof": 0.5}},
        {"fix": {"numbers": 30, "nis_per_dof": 2.0}},
    ]

    figures = innovation_figures(runs)

    assert figures["nis_per_dof_of"] == {"barometer": 0.5, "fix": 1.75}
    assert figures["nis_per_dof"] == pytest.approx(1.0)
    assert figures["nis_of_fixes"] == 1.75
    assert innovation_figures([]) == {}
