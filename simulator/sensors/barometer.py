"""Static pressure: today's weather, slow drift, noise, 0.1 m resolution."""

from __future__ import annotations

from estimator.geometry.earth import isa_pressure_pa
from simulator.random_streams import rng_for
from simulator.scenario import SensorSection
from simulator.vehicles.gauss_markov import GaussMarkov

_RESOLUTION_M = 0.1
_DRIFT_TIME_S = 400.0


class Barometer:
    """Reads pressure; its altitude is off by the weather, which does not stay the same."""

    def __init__(self, seed: int, sensors: SensorSection) -> None:
        self._rng, self._sensors = rng_for(seed, "barometer"), sensors
        self._drift = GaussMarkov(rng_for(seed, "weather"), sensors.barometer_drift_m, _DRIFT_TIME_S, 1)

    def pressure_pa(self, alt_amsl_m: float, dt_s: float) -> float:
        """One reading, ``dt_s`` after the one before."""
        drift_m = float(self._drift.step(dt_s)[0])
        noise_m = self._sensors.barometer_noise_m * float(self._rng.standard_normal())
        altitude_m = alt_amsl_m + self._sensors.weather_offset_m + drift_m + noise_m
        return float(isa_pressure_pa(round(altitude_m / _RESOLUTION_M) * _RESOLUTION_M))
