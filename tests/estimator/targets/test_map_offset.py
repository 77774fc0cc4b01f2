import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.targets.map_offset import map_offset

TRUE = np.array([-1.4, 3.2])


def _points(rng: np.random.Generator, count: int, std_m: float) -> np.ndarray:
    return np.asarray(TRUE + std_m * rng.normal(size=(count, 2)))


def test_points_of_one_quality_give_their_mean_and_the_surveyors_sigma() -> None:
    rng = np.random.default_rng(1)
    cov = np.tile(0.25 * np.eye(2), (25, 1, 1))
    errors, nees = [], []
    for _ in range(300):
        found = map_offset(_points(rng, 25, 0.5), cov)
        error = found.offset_ne_m - TRUE
        errors.append(error)
        nees.append(error @ np.linalg.solve(found.cov_ne_m2, error))

    assert np.std(errors) == pytest.approx(0.1, rel=0.1)
    assert 0.85 < np.mean(np.array(nees) < 4.605) < 0.97


def test_better_points_count_more() -> None:
    d = np.array([[0.0, 0.0], [1.0, 1.0]])
    found = map_offset(d, np.array([np.eye(2), 3.0 * np.eye(2)]))

    assert_allclose(found.offset_ne_m, [0.25, 0.25], atol=0.02)


def test_a_point_that_was_mistaken_for_another_is_held_down() -> None:
    rng = np.random.default_rng(2)
    d = _points(rng, 12, 0.4)
    d[3] += [40.0, -25.0]
    found = map_offset(d, np.tile(0.16 * np.eye(2), (12, 1, 1)))

    assert np.linalg.norm(found.offset_ne_m - TRUE) < 0.4
    assert found.weights[3] < 0.01


def test_points_that_scatter_more_than_they_claim_are_less_sure() -> None:
    d = _points(np.random.default_rng(3), 20, 2.0)
    found = map_offset(d, np.tile(0.25 * np.eye(2), (20, 1, 1)))

    assert found.misfit > 1.5
    assert np.sqrt(found.cov_ne_m2[0, 0]) > 0.25


@pytest.mark.parametrize(
    ("d", "cov"),
    [
        (np.zeros((1, 2)), np.eye(2)[None]),
        (np.array([[0.0, np.nan], [0.0, 0.0]]), np.tile(np.eye(2), (2, 1, 1))),
        (np.zeros((2, 2)), np.zeros((2, 2, 2))),
    ],
)
def test_what_says_nothing_is_refused(d: np.ndarray, cov: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"points|finite"):
        map_offset(d, cov)
