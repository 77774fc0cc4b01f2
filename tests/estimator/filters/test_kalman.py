import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.kalman import Correction, correct


def _problem(seed: int, states: int, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root, noise_root = rng.normal(size=(states, states)), rng.normal(size=(rows, rows))
    P, R = root @ root.T + 0.1 * np.eye(states), noise_root @ noise_root.T + 0.1 * np.eye(rows)
    return P, rng.normal(size=rows), rng.normal(size=(rows, states)), R


def test_scalar_matches_the_weighted_mean() -> None:
    """Prior variance 4, measurement 3 of variance 1: the mean moves by 3 * 4/5, the variance falls to 4/5."""
    correction = correct(np.array([[4.0]]), np.array([3.0]), np.array([[1.0]]), np.array([[1.0]]))

    assert correction is not None
    assert_allclose(correction.dx, [2.4])
    assert_allclose(correction.P, [[0.8]])
    assert correction.nis == pytest.approx(9.0 / 5.0)


@pytest.mark.parametrize(("states", "rows"), [(1, 1), (4, 2), (12, 3), (28, 2)])
def test_agrees_with_the_information_form(states: int, rows: int) -> None:
    """P+^-1 = P^-1 + H' R^-1 H and P+^-1 dx = H' R^-1 z, another road to the same posterior."""
    P, z, H, R = _problem(states, states, rows)

    correction = correct(P, z, H, R)

    assert correction is not None
    by_noise = np.linalg.solve(R, np.column_stack((H, z)))
    information = np.linalg.inv(P) + H.T @ by_noise[:, :-1]
    assert_allclose(np.linalg.inv(correction.P), information, rtol=1e-6, atol=1e-6)
    assert_allclose(correction.dx, np.linalg.solve(information, H.T @ by_noise[:, -1]), rtol=1e-6, atol=1e-9)
    assert correction.nis == pytest.approx(float(z @ np.linalg.solve(H @ P @ H.T + R, z)))


def test_two_independent_measurements_equal_one_stacked() -> None:
    P, z, H, _ = _problem(3, 5, 2)
    R = np.diag([0.5, 2.0])

    together = correct(P, z, H, R)
    first = correct(P, z[:1], H[:1], R[:1, :1])
    assert together is not None
    assert first is not None
    second = correct(first.P, z[1:] - H[1:] @ first.dx, H[1:], R[1:, 1:])

    assert second is not None
    assert_allclose(first.dx + second.dx, together.dx, rtol=1e-9)
    assert_allclose(second.P, together.P, rtol=1e-9, atol=1e-12)


def test_gate_refuses_only_what_is_beyond_it() -> None:
    P, H, R = np.eye(2), np.eye(2), np.eye(2)
    z = np.array([3.0, 1.0])  # squared innovation (9 + 1) / 2 = 5

    assert correct(P, z, H, R, gate=4.99) is None
    assert correct(P, z, H, R, gate=5.01) is not None


def test_covariance_stays_a_covariance_over_many_precise_updates() -> None:
    """Variances 14 orders apart: the short form (I - K H) P loses symmetry and sign here, Joseph's does not."""
    rng = np.random.default_rng(7)
    P = np.diag(10.0 ** rng.uniform(-8.0, 6.0, size=15))
    for _ in range(2000):
        H = rng.normal(size=(2, 15))
        correction = correct(P, rng.normal(size=2), H, np.eye(2) * 1e-6)
        assert correction is not None
        P = correction.P

    assert_allclose(P, P.T, atol=0.0)
    # rounding of a sum of order one, not a negative direction
    assert np.linalg.eigvalsh(P).min() > -1e-13


def test_squared_innovation_is_chi_square() -> None:
    """Innovations drawn from the model itself: the mean of nis is the number of rows."""
    P, _, H, R = _problem(11, 6, 3)
    rng = np.random.default_rng(12)
    z = rng.multivariate_normal(np.zeros(3), H @ P @ H.T + R, size=4000)

    values = [_nis(correct(P, row, H, R)) for row in z]

    # standard deviation of the mean: sqrt(2 * 3 / 4000) = 0.039
    assert np.mean(values) == pytest.approx(3.0, abs=0.16)


def test_indefinite_innovation_covariance_raises() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        correct(np.diag([1.0, -4.0]), np.zeros(2), np.eye(2), np.eye(2))


def test_inputs_are_left_alone() -> None:
    P, z, H, R = _problem(5, 4, 2)
    before = [a.copy() for a in (P, z, H, R)]

    correct(P, z, H, R)

    for array, kept in zip((P, z, H, R), before, strict=True):
        assert_allclose(array, kept, atol=0.0)


def _nis(correction: Correction | None) -> float:
    assert correction is not None
    return correction.nis
