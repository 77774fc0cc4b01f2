import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import expm

from estimator.geometry.rotation import (
    euler_from_q,
    matrix_from_euler,
    matrix_from_q,
    q_conjugate,
    q_from_euler,
    q_from_matrix,
    q_from_rotvec,
    q_multiply,
    q_normalise,
    q_slerp,
    rotvec_from_q,
    skew,
    wrap_pi,
)
from tests.authorities.stored import stored
from tests.estimator.geometry.strategies import attitudes, vectors

ROTATIONS = stored("rotation_scipy")["rotations"]
angles = st.floats(-math.pi, math.pi)


def assert_same_rotation(found: np.ndarray, expected: np.ndarray, atol: float = 1e-14) -> None:
    """q and -q are one rotation."""
    sign = np.sign(np.sum(found * expected, axis=-1, keepdims=True))
    assert_allclose(found * sign, expected, rtol=0.0, atol=atol)


def _column(key: str, rows: list[dict[str, Any]] = ROTATIONS) -> np.ndarray:
    return np.array([row[key] for row in rows])


def test_matrices_agree_with_scipy() -> None:
    assert_allclose(matrix_from_q(_column("q_wxyz")), _column("matrix"), rtol=0.0, atol=1e-14)


def test_quaternions_of_matrices_agree_with_scipy() -> None:
    found = q_from_matrix(_column("matrix"))

    assert np.all(found[:, 0] >= 0.0)
    assert_same_rotation(found, _column("q_wxyz"))


def test_rotation_vectors_agree_with_scipy() -> None:
    found = rotvec_from_q(_column("q_wxyz"))
    expected = _column("rotvec")

    # A half turn about an axis is the half turn about its opposite.
    half = np.abs(np.linalg.norm(expected, axis=-1) - math.pi) < 1e-9
    assert half.sum() == 3
    assert_allclose(found[~half], expected[~half], rtol=0.0, atol=1e-13)
    assert_allclose(np.abs(found[half]), np.abs(expected[half]), rtol=0.0, atol=1e-13)
    assert_same_rotation(q_from_rotvec(expected), _column("q_wxyz"))


def test_euler_angles_agree_with_scipy() -> None:
    rows = [row for row in ROTATIONS if row["roll_deg"] is not None]
    euler = [np.radians(_column(key, rows)) for key in ("roll_deg", "pitch_deg", "yaw_deg")]

    assert_same_rotation(q_from_euler(*euler), _column("q_wxyz", rows))
    assert_allclose(matrix_from_euler(*euler), _column("matrix", rows), rtol=0.0, atol=1e-14)
    # Roll and yaw lose digits with the cosine of the pitch, here down to 0.017.
    assert_allclose(euler_from_q(_column("q_wxyz", rows)), euler, rtol=0.0, atol=1e-13)


def test_products_agree_with_scipy() -> None:
    rows = stored("rotation_scipy")["products"]

    assert_same_rotation(q_multiply(_column("a_wxyz", rows), _column("b_wxyz", rows)), _column("ab_wxyz", rows))


def test_slerp_agrees_with_scipy() -> None:
    rows = stored("rotation_scipy")["slerp"]

    found = q_slerp(_column("a_wxyz", rows), _column("b_wxyz", rows), _column("t", rows))
    assert_same_rotation(found, _column("q_wxyz", rows), atol=1e-13)
    assert_same_rotation(
        q_slerp(np.array(rows[1]["a_wxyz"]), np.array(rows[1]["b_wxyz"]), rows[1]["t"]), np.array(rows[1]["q_wxyz"])
    )


@pytest.mark.parametrize("function", [matrix_from_q, q_conjugate, q_normalise, rotvec_from_q, q_from_matrix])
def test_one_and_many_agree(function: Any) -> None:
    many = _column("matrix" if function is q_from_matrix else "q_wxyz")

    assert_allclose(function(many), [function(one) for one in many], rtol=0.0, atol=1e-15)


def test_one_and_many_agree_for_pairs_and_vectors() -> None:
    q, v = _column("q_wxyz"), _column("rotvec")
    v = np.concatenate((v, 1e-6 * v, 0.0 * v[:1]))

    assert_allclose(q_multiply(q, q[::-1]), [q_multiply(a, b) for a, b in zip(q, q[::-1], strict=True)], atol=1e-15)
    assert_allclose(q_multiply(q[0], q), [q_multiply(q[0], b) for b in q], atol=1e-15)
    assert_allclose(q_from_rotvec(v), [q_from_rotvec(one) for one in v], rtol=0.0, atol=1e-15)
    assert_allclose(skew(v), [skew(one) for one in v], atol=0.0)


@given(attitudes(), vectors())
def test_rotating_there_and_back(q_ned_from_body: np.ndarray, v_body: np.ndarray) -> None:
    ned_from_body = matrix_from_q(q_ned_from_body)

    assert_allclose(ned_from_body.T @ (ned_from_body @ v_body), v_body, rtol=0.0, atol=1e-11)
    assert_allclose(matrix_from_q(q_conjugate(q_ned_from_body)), ned_from_body.T, rtol=0.0, atol=1e-15)


@given(attitudes(), attitudes())
def test_product_of_quaternions_is_product_of_matrices(a: np.ndarray, b: np.ndarray) -> None:
    assert_allclose(matrix_from_q(q_multiply(a, b)), matrix_from_q(a) @ matrix_from_q(b), rtol=0.0, atol=1e-14)


@given(attitudes())
def test_quaternion_of_a_matrix_there_and_back(q: np.ndarray) -> None:
    assert_allclose(matrix_from_q(q_from_matrix(matrix_from_q(q))), matrix_from_q(q), rtol=0.0, atol=1e-14)


@given(vectors(1.8))
def test_rotation_vector_there_and_back(v: np.ndarray) -> None:
    """Vectors shorter than pi come back; 1.8 sqrt(3) is 3.12."""
    assert_allclose(rotvec_from_q(q_from_rotvec(v)), v, rtol=0.0, atol=1e-13)
    assert_allclose(rotvec_from_q(-q_from_rotvec(v)), v, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("length", [0.0, 1e-300, 1e-12, 1e-8, 0.99e-4, 1.01e-4, 1e-2, 1.0, 3.0, 6.0])
def test_exponential_is_that_of_the_cross_product_matrix(length: float) -> None:
    """Also on both sides of where the series takes over."""
    v = length * np.array((0.6, -0.48, 0.64))

    assert_allclose(matrix_from_q(q_from_rotvec(v)), expm(skew(v)), rtol=0.0, atol=3e-15)
    if 0.0 < length < 3.0:
        assert_allclose(rotvec_from_q(q_from_rotvec(v)), v, rtol=1e-14)
        assert_allclose(rotvec_from_q(q_from_rotvec(v[np.newaxis]))[0], v, rtol=1e-14)


@given(vectors(), vectors())
def test_skew_is_the_cross_product(v: np.ndarray, u: np.ndarray) -> None:
    assert_allclose(skew(v) @ u, np.cross(v, u), rtol=0.0, atol=1e-9)


@given(angles, st.floats(-math.pi / 2, math.pi / 2), angles)
def test_euler_angles_give_the_rotation_back(roll: float, pitch: float, yaw: float) -> None:
    """Also at the poles, where the angles themselves are not unique."""
    q = q_from_euler(roll, pitch, yaw)
    roll_found, pitch_found, yaw_found = euler_from_q(q)

    # Roll and yaw are taken together within 1e-8 of the pole.
    assert_allclose(matrix_from_euler(roll_found, pitch_found, yaw_found), matrix_from_q(q), rtol=0.0, atol=3e-8)
    assert_allclose(pitch_found, pitch, rtol=0.0, atol=1e-13 + (3e-8 if abs(pitch) > 1.57 else 0.0))


@pytest.mark.parametrize("pitch", [-math.pi / 2, math.pi / 2])
def test_straight_down_all_turn_is_yaw(pitch: float) -> None:
    roll, pitch_found, yaw = euler_from_q(q_from_euler(0.0, pitch, 0.7))

    assert roll == 0.0
    assert_allclose((pitch_found, yaw), (pitch, 0.7), rtol=0.0, atol=1e-12)


def test_signs_of_aviation() -> None:
    """Roll to the right lowers the right wing, pitch lifts the nose, yaw turns it east."""
    nose, right = np.array((1.0, 0.0, 0.0)), np.array((0.0, 1.0, 0.0))

    assert (matrix_from_euler(0.1, 0.0, 0.0) @ right)[2] > 0.0
    assert (matrix_from_euler(0.0, 0.1, 0.0) @ nose)[2] < 0.0
    assert (matrix_from_euler(0.0, 0.0, 0.1) @ nose)[1] > 0.0


@given(attitudes(), attitudes())
def test_slerp_meets_its_ends_the_short_way(a: np.ndarray, b: np.ndarray) -> None:
    assert_same_rotation(q_slerp(a, b, 0.0), a, atol=1e-12)
    assert_same_rotation(q_slerp(a, b, 1.0), b, atol=1e-12)
    turn = np.linalg.norm(rotvec_from_q(q_multiply(q_conjugate(a), b)))
    half = np.linalg.norm(rotvec_from_q(q_multiply(q_conjugate(a), q_slerp(a, -b, 0.5))))
    assert half == pytest.approx(0.5 * turn, abs=1e-12)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angle_is_the_same_angle(x: float) -> None:
    wrapped = wrap_pi(x)

    assert -math.pi - 1e-11 < wrapped <= math.pi
    assert_allclose((math.sin(wrapped), math.cos(wrapped)), (math.sin(x), math.cos(x)), rtol=0.0, atol=1e-11)
    assert_allclose(wrap_pi(np.array([x])), [wrapped], atol=0.0)


def test_wrapping_at_the_cut() -> None:
    assert wrap_pi(math.pi) == math.pi
    assert wrap_pi(-math.pi) == math.pi
    assert wrap_pi(3.0) == 3.0
    assert math.isnan(wrap_pi(math.inf))


def test_normalise_keeps_the_sign_and_refuses_zero() -> None:
    assert_allclose(q_normalise(np.array((-2.0, 0.0, 0.0, 0.0))), (-1.0, 0.0, 0.0, 0.0))
    assert np.all(np.isnan(q_normalise(np.zeros(4))))
    assert np.all(np.isnan(q_normalise(np.zeros((2, 4)))))


@pytest.mark.parametrize(
    ("function", "size"),
    [(matrix_from_q, 4), (q_normalise, 4), (rotvec_from_q, 4), (q_from_rotvec, 3), (euler_from_q, 4)],
)
def test_nan_in_nan_out(function: Any, size: int) -> None:
    one = np.full(size, np.nan)
    many = np.stack((one, np.eye(size)[0]))

    assert np.all(np.isnan(function(one)))
    found = np.array(function(many))
    assert np.all(np.isfinite(found[:, 1] if function is euler_from_q else found[1]))


def test_arguments_are_left_alone() -> None:
    q = np.array((0.0, -3.0, 0.0, 4.0))
    for function in (q_conjugate, q_normalise, rotvec_from_q, euler_from_q, matrix_from_q):
        function(q)

    assert_allclose(q, (0.0, -3.0, 0.0, 4.0), atol=0.0)
