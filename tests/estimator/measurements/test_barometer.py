import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.measurements.barometer import pressure_altitude
from tests.estimator.measurements.filters import general_filter, numeric_jacobian


def test_jacobian_agrees_with_finite_differences() -> None:
    """The innovation falls as the expected reading rises: H is minus its derivative."""
    innovation = pressure_altitude(general_filter(), 400.0, 300.0, 0.5)

    numeric = -numeric_jacobian(lambda eskf: pressure_altitude(eskf, 400.0, 300.0, 0.5).z)
    assert_allclose(innovation.H, numeric, atol=1e-6)


def test_reading_above_the_expected_is_positive() -> None:
    """Origin at 300 m, 90 m above it, zero off by 4 m: 394 m are expected."""
    innovation = pressure_altitude(general_filter(), 397.0, 300.0, 0.5)

    assert innovation.z[0] == pytest.approx(3.0)
    assert_allclose(innovation.R, [[0.25]])


def test_update_moves_up_when_the_reading_is_high() -> None:
    eskf = general_filter()
    innovation = pressure_altitude(eskf, 404.0, 300.0, 0.5)

    eskf.update(innovation.z, innovation.H, innovation.R)

    assert eskf.nominal.motion.pos_ned_m[2] < -90.0
    assert np.isclose(pressure_altitude(eskf, 404.0, 300.0, 0.5).z[0], 10.0 * 0.25 / 2.25)
