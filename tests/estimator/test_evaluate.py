import json

import numpy as np
import pytest

from estimator.evaluate import CHI2_95_2DOF, Spread, evaluate

IDENTITY = np.eye(2)


def test_spread_of_known_errors() -> None:
    spread = Spread.of(np.array([3.0, -4.0, 0.0, 1.0, -2.0]))

    assert spread.rms == pytest.approx(np.sqrt(30.0 / 5.0))
    assert spread.p50 == 2.0
    assert spread.largest == 4.0
    assert spread.p95 == pytest.approx(3.8)


def test_spread_of_nothing_is_an_error() -> None:
    with pytest.raises(ValueError, match="no errors"):
        Spread.of(np.empty(0))


def test_errors_are_of_the_scored_spans_only() -> None:
    t_us = np.arange(10) * 1_000_000.0
    error = np.zeros((10, 3))
    error[:3] = [300.0, 400.0, 50.0]
    error[3:6] = [3.0, 4.0, -2.0]
    error[8] = [0.0, 1.0, 0.0]

    result = evaluate(t_us, error, np.tile(IDENTITY, (10, 1, 1)), [(3_000_000, 5_000_000), (8_000_000, 8_500_000)])

    assert result is not None
    assert result.rows == 4
    assert result.horizontal_m.p50 == 5.0
    assert result.horizontal_m.largest == 5.0
    assert result.horizontal_m.rms == pytest.approx(np.sqrt((3 * 25.0 + 1.0) / 4.0))
    assert result.vertical_m.largest == 2.0
    assert result.final_horizontal_m == 1.0


def test_overlapping_spans_count_once() -> None:
    t_us = np.arange(5) * 1e6

    result = evaluate(t_us, np.ones((5, 3)), np.tile(IDENTITY, (5, 1, 1)), [(0, 3_000_000), (2_000_000, 4_000_000)])

    assert result is not None
    assert result.rows == 5


def test_gap_counts_from_the_spans_own_ends() -> None:
    """An estimate that stops early or starts late leaves a gap as much as one in the middle."""
    t_us = np.array([1.0, 2.0, 3.0]) * 1e6
    cov = np.tile(IDENTITY, (3, 1, 1))

    late_end = evaluate(t_us, np.zeros((3, 3)), cov, [(1_000_000, 9_000_000)])
    late_start = evaluate(t_us, np.zeros((3, 3)), cov, [(-4_000_000, 3_000_000)])
    silent_span = evaluate(t_us, np.zeros((3, 3)), cov, [(1_000_000, 3_000_000), (10_000_000, 30_000_000)])

    assert late_end is not None
    assert late_start is not None
    assert silent_span is not None
    assert late_end.longest_gap_s == 6.0
    assert late_start.longest_gap_s == 5.0
    assert silent_span.longest_gap_s == 20.0


def test_nothing_to_score_is_none() -> None:
    assert evaluate(np.array([1e6]), np.zeros((1, 3)), IDENTITY[None], [(5_000_000, 6_000_000)]) is None
    assert evaluate(np.array([1e6]), np.zeros((1, 3)), IDENTITY[None], []) is None


def test_consistency_of_errors_drawn_from_their_covariance() -> None:
    rng = np.random.default_rng(8)
    cov = np.array([[9.0, 4.0], [4.0, 3.0]])
    count = 20_000
    error = np.column_stack((rng.multivariate_normal([0.0, 0.0], cov, size=count), np.zeros(count)))
    t_us = np.arange(count) * 1e4

    result = evaluate(t_us, error, np.tile(cov, (count, 1, 1)), [(0, 10**12)])
    boastful = evaluate(t_us, error, np.tile(cov / 4.0, (count, 1, 1)), [(0, 10**12)])

    assert result is not None
    assert boastful is not None
    # deviations of the means: 2 / sqrt(20000) = 0.014 and 0.0015
    assert result.nees_2d_mean == pytest.approx(2.0, abs=0.07)
    assert result.inside_95_ellipse == pytest.approx(0.95, abs=0.008)
    assert boastful.nees_2d_mean == pytest.approx(8.0, abs=0.28)
    assert boastful.inside_95_ellipse == pytest.approx(1.0 - np.exp(-CHI2_95_2DOF / 8.0), abs=0.016)


def test_report_is_plain_json() -> None:
    result = evaluate(np.array([1e6, 2e6]), np.ones((2, 3)), np.tile(IDENTITY, (2, 1, 1)), [(0, 3_000_000)])

    assert result is not None
    assert json.loads(json.dumps(result.as_dict()))["horizontal_m"]["p50"] == pytest.approx(np.sqrt(2.0))
