import numpy as np
from numpy.testing import assert_allclose

from estimator.geometry.rotation import matrix_from_q
from estimator.measurements.gnss import (
    HORIZONTAL_VELOCITY_STD_M_S,
    LAG_S,
    UNKNOWN_ACCELERATION_M_S2,
    position,
    velocity,
)
from estimator.navigator_config import NavigatorConfig
from estimator.types import GnssSample
from tests.estimator.measurements.filters import general_filter, numeric_jacobian

FIX = np.array([33.0, -14.0, -88.0])


def test_position_jacobian_agrees_with_finite_differences() -> None:
    std_m, alike = np.array([1.5, 1.5, 3.0]), np.array([10.0, 10.0, 0.5])
    innovation = position(general_filter(), FIX, std_m, alike)

    assert_allclose(innovation.H, -numeric_jacobian(lambda eskf: position(eskf, FIX, std_m, alike).z), atol=1e-6)
    assert_allclose(innovation.z, [3.0, -2.0, 2.0])
    assert innovation.R_one is not None
    assert_allclose(np.diag(innovation.R_one), [2.25, 2.25, 9.0])
    assert_allclose(np.diag(innovation.R), [22.5, 22.5, 9.0])


def test_a_receiver_that_errs_alike_for_a_minute_does_not_make_sure() -> None:
    """
    Fifty fixes within a minute, all 0.9 m off by what is slow of the receiver, from a start of 1.5 m.

    Taken for white they would leave 0.2 m; the slow error, 1.2 m, stays in the place, and the filter says so.
    """
    eskf = general_filter()
    true = eskf.nominal.motion.pos_ned_m.copy()
    noise = NavigatorConfig().gnss_noise(GnssSample(0, 0.0, 0.0, 0.0, np.zeros(3), 1.0, 2.0, 9))
    part, slow = eskf.layout.slices["position"], eskf.layout.slices["gnss_bias"]
    eskf.P[part, :], eskf.P[:, part], eskf.P[slow, :], eskf.P[:, slow] = 0.0, 0.0, 0.0, 0.0
    eskf.P[part, part], eskf.P[slow, slow] = 2.25 * np.eye(3), 1.44 * np.eye(2)
    for _ in range(50):
        measured = position(eskf, true + np.array([0.9, 0.0, 0.0]), *noise)
        eskf.update(measured.z, measured.H, measured.R, what="gnss", R_one=measured.R_one)

    std_m = float(np.sqrt(eskf.cov("position")[0, 0]))
    assert 0.8 < std_m < 1.5
    assert abs(eskf.nominal.motion.pos_ned_m[0] - true[0]) < 2.0 * std_m


def test_velocity_jacobian_agrees_with_finite_differences() -> None:
    reading = np.array([12.0, -6.5, 0.2])

    def z(eskf) -> np.ndarray:
        innovation = velocity(eskf, reading)
        assert innovation is not None
        return innovation.z

    innovation = velocity(general_filter(), reading)

    assert innovation is not None
    assert_allclose(innovation.H, -numeric_jacobian(z), atol=1e-6)
    assert_allclose(innovation.z, [1.0, -0.5, -0.5])


def test_unknown_velocity_components_are_left_out() -> None:
    eskf = general_filter()
    innovation = velocity(eskf, np.array([12.0, np.nan, np.nan]))

    assert innovation is not None
    assert_allclose(innovation.z, [1.0])
    assert innovation.H.shape == (1, eskf.layout.size)
    assert_allclose(innovation.R, [[HORIZONTAL_VELOCITY_STD_M_S**2 + (LAG_S * UNKNOWN_ACCELERATION_M_S2) ** 2]])
    assert velocity(eskf, np.full(3, np.nan)) is None


def test_a_velocity_counts_less_the_more_the_aircraft_accelerates() -> None:
    """Of 4 m/s^2 a lag of 0.2 s leaves 0.8 m/s unknown; at rest the accelerometer reads gravity alone."""
    eskf = general_filter()
    body_from_ned = matrix_from_q(eskf.nominal.motion.q_ned_from_body).T
    gravity = np.array([0.0, 0.0, eskf.earth.gravity_m_s2])

    def std_m_s(acceleration_ned_m_s2: np.ndarray) -> float:
        force = body_from_ned @ (acceleration_ned_m_s2 - gravity) + eskf.nominal.accelerometer_bias_m_s2
        innovation = velocity(eskf, np.array([12.0, -6.5, np.nan]), force)
        assert innovation is not None
        return float(np.sqrt(innovation.R[0, 0]))

    assert_allclose(std_m_s(np.zeros(3)), HORIZONTAL_VELOCITY_STD_M_S)
    assert_allclose(std_m_s(np.array([0.0, 4.0, 0.0])), np.hypot(HORIZONTAL_VELOCITY_STD_M_S, LAG_S * 4.0))
