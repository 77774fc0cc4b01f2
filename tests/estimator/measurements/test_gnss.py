import numpy as np
from numpy.testing import assert_allclose

from estimator.measurements.gnss import HORIZONTAL_VELOCITY_STD_M_S, position, velocity
from tests.estimator.measurements.filters import general_filter, numeric_jacobian

FIX = np.array([33.0, -14.0, -88.0])


def test_position_jacobian_agrees_with_finite_differences() -> None:
    innovation = position(general_filter(), FIX, 1.5, 3.0)

    assert_allclose(innovation.H, -numeric_jacobian(lambda eskf: position(eskf, FIX, 1.5, 3.0).z), atol=1e-6)
    assert_allclose(innovation.z, [3.0, -2.0, 2.0])
    assert_allclose(np.diag(innovation.R), [2.25, 2.25, 9.0])


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
    assert_allclose(innovation.R, [[HORIZONTAL_VELOCITY_STD_M_S**2]])
    assert velocity(eskf, np.full(3, np.nan)) is None
