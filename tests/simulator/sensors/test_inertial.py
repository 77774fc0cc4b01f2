"""Inertial sensors against table 5.1 of Conte (2009)."""

from __future__ import annotations

import numpy as np

from simulator.scenario import SensorSection
from simulator.sensors.inertial import InertialUnit

RATE = np.array([0.05, -0.02, 0.1])
FORCE = np.array([0.3, -0.4, -9.7])


def mean_of(unit: InertialUnit, samples: int) -> tuple[np.ndarray, np.ndarray]:
    for _ in range(samples):
        unit.sample(RATE, FORCE, 0.005)
    return unit.report()


def test_mean_is_truth_plus_bias_within_the_table() -> None:
    for seed in range(5):
        unit = InertialUnit(seed, SensorSection())
        rate, force = mean_of(unit, 4000)
        assert np.abs(rate - RATE).max() < np.radians(0.1) + 3e-4
        assert np.abs(force - FORCE).max() < 13e-3 * 9.81 + 5e-3
        np.testing.assert_allclose(rate - RATE, unit.gyro_bias_rad_s, atol=3e-4)
        np.testing.assert_allclose(force - FORCE, unit.accelerometer_bias_m_s2, atol=5e-3)


def test_single_readings_come_in_steps_of_the_resolution() -> None:
    unit = InertialUnit(3, SensorSection())
    rate, force = mean_of(unit, 1)
    for values, step in ((rate, np.radians(0.1)), (force, 9.81e-3)):
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-9)


def test_report_starts_a_new_mean() -> None:
    unit = InertialUnit(3, SensorSection(gyro_noise_rad_s=0.0, gyro_walk_rad_s_sqrt_s=0.0))
    mean_of(unit, 4)
    unit.sample(RATE + 1.0, FORCE, 0.005)
    assert unit.report()[0][0] > 1.0
