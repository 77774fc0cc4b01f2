import numpy as np
from numpy.testing import assert_allclose

from estimator.geometry.rotation import q_from_rotvec, q_multiply
from estimator.measurements.heading import reported_attitude
from tests.estimator.measurements.filters import general_filter, numeric_jacobian


def test_jacobian_agrees_with_finite_differences() -> None:
    """At the attitude reported: away from it the derivative differs by half the difference."""
    eskf = general_filter()
    q = eskf.nominal.motion.q_ned_from_body

    innovation = reported_attitude(eskf, q, 0.005)

    assert_allclose(innovation.H, -numeric_jacobian(lambda other: reported_attitude(other, q, 0.005).z), atol=1e-6)
    assert_allclose(innovation.R, np.eye(3) * 2.5e-5)


def test_innovation_is_the_turn_to_the_report() -> None:
    eskf = general_filter()
    turn = np.array([0.01, -0.02, 0.05])
    report = q_multiply(q_from_rotvec(turn), eskf.nominal.motion.q_ned_from_body)

    assert_allclose(reported_attitude(eskf, report, 0.005).z, turn, atol=1e-12)
