"""Gyroscopes and accelerometers after table 5.1 of Conte (2009).

Resolution 1 mg and 0.1 deg/s, bias up to 13 mg and 0.1 deg/s.
"""

from __future__ import annotations

import numpy as np

from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.scenario import SensorSection

_ACCELEROMETER_STEP_M_S2 = 9.81e-3
_GYRO_STEP_RAD_S = np.radians(0.1)


class InertialUnit:
    """Samples at every simulation step and reports the mean since the last report, as a low-pass filter would."""

    def __init__(self, seed: int, sensors: SensorSection) -> None:
        rng = rng_for(seed, "imu")
        self._rng, self._sensors = rng, sensors
        self.accelerometer_bias_m_s2: Float = rng.uniform(-1, 1, 3) * sensors.accelerometer_bias_max_m_s2
        self.gyro_bias_rad_s: Float = rng.uniform(-1, 1, 3) * sensors.gyro_bias_max_rad_s
        self._rate_sum, self._force_sum, self._count = np.zeros(3), np.zeros(3), 0

    def sample(self, rate_body_rad_s: Float, specific_force_body_m_s2: Float, dt_s: float) -> None:
        """Take one reading of the truth (3,), (3,)."""
        sensors, draw = self._sensors, self._rng.standard_normal((4, 3))
        root = np.sqrt(dt_s)
        self.gyro_bias_rad_s = self.gyro_bias_rad_s + sensors.gyro_walk_rad_s_sqrt_s * root * draw[0]
        walk = sensors.accelerometer_walk_m_s2_sqrt_s * root
        self.accelerometer_bias_m_s2 = self.accelerometer_bias_m_s2 + walk * draw[1]
        rate = rate_body_rad_s + self.gyro_bias_rad_s + sensors.gyro_noise_rad_s * draw[2]
        force = specific_force_body_m_s2 + self.accelerometer_bias_m_s2 + sensors.accelerometer_noise_m_s2 * draw[3]
        self._rate_sum += np.round(rate / _GYRO_STEP_RAD_S) * _GYRO_STEP_RAD_S
        self._force_sum += np.round(force / _ACCELEROMETER_STEP_M_S2) * _ACCELEROMETER_STEP_M_S2
        self._count += 1

    def report(self) -> tuple[Float, Float]:
        """Mean rate and specific force (3,) of the samples since the last report."""
        count = max(self._count, 1)
        rate, force = self._rate_sum / count, self._force_sum / count
        self._rate_sum, self._force_sum, self._count = np.zeros(3), np.zeros(3), 0
        return rate, force
