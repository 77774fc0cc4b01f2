"""A filter in a general state, and the same with an error put in, for tests of Jacobians."""

import numpy as np

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.nominal import STATE_GROUPS, Clone, Layout, Nominal, PadPlace
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.rotation import q_from_euler

LAYOUT = Layout.of(STATE_GROUPS)
STEP = 1e-5


def general_filter() -> ErrorStateFilter:
    nominal = Nominal(
        motion=Motion(np.array([30.0, -12.0, -90.0]), np.array([11.0, -6.0, 0.7]), q_from_euler(0.2, -0.15, 1.1)),
        accelerometer_bias_m_s2=np.array([0.05, -0.03, 0.08]),
        gyroscope_bias_rad_s=np.array([0.002, -0.001, 0.003]),
        barometer_bias_m=4.0,
        boresight_rad=np.zeros(3),
        attitude_bias_rad=np.zeros(3),
        clone=Clone(np.array([25.0, -9.0, -89.0]), q_from_euler(0.1, -1.4, 0.9)),
        pad=PadPlace(np.array([28.0, -10.0, -76.0]), q_from_euler(0.03, -0.02, 2.1)),
    )
    earth = EarthModel.at(np.deg2rad(47.0), 300.0)
    return ErrorStateFilter(nominal, np.eye(LAYOUT.size), LAYOUT, earth, ProcessNoise())


def disturbed_filter(index: int, step: float) -> ErrorStateFilter:
    """The general filter whose nominal state was moved by ``step`` along one error state."""
    eskf = general_filter()
    dx = step * np.eye(LAYOUT.size)[index]
    eskf.update(dx, np.eye(LAYOUT.size), np.eye(LAYOUT.size) * 1e-18)
    return eskf


def numeric_jacobian(value) -> np.ndarray:
    """d value(filter) / d error state (m, n) by central differences; ``value`` is what the measurement would read."""
    columns = [
        (value(disturbed_filter(i, STEP)) - value(disturbed_filter(i, -STEP))) / (2.0 * STEP)
        for i in range(LAYOUT.size)
    ]
    return np.stack(columns, axis=-1)
