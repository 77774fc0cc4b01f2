"""The barometer."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.scenario import SensorSection
from simulator.sensors.barometer import Barometer


def altitude_m(pressure_pa: float) -> float:
    """Standard atmosphere, written out: 44 330 m and the exponent 1/5.255."""
    return float(44330.77 * (1 - (pressure_pa / 101325.0) ** 0.190263))


def test_weather_noise_and_resolution() -> None:
    barometer = Barometer(1, SensorSection(barometer_drift_m=0.0))
    readings = np.array([altitude_m(barometer.pressure_pa(200.0, 0.1)) for _ in range(400)])
    assert readings.mean() == pytest.approx(221.0, abs=0.1)
    # 0.15 m of noise and the rounding to 0.1 m.
    assert readings.std() == pytest.approx(0.153, abs=0.03)
    assert np.abs(readings * 10 - np.round(readings * 10)).max() < 0.12


def test_drift_stays_bounded_but_moves() -> None:
    barometer = Barometer(2, SensorSection(barometer_noise_m=0.0))
    readings = np.array([altitude_m(barometer.pressure_pa(100.0, 1.0)) for _ in range(3000)])
    assert 0.4 < readings.std() < 2.5
    assert np.abs(np.diff(readings)).max() < 0.6
