"""The nominal state carried on past the filter's horizon, with the samples that wait and then without."""

from __future__ import annotations

from dataclasses import dataclass, replace

from estimator.filters.nominal import Nominal
from estimator.filters.strapdown import EarthModel, propagate
from estimator.types import InertialSample


@dataclass(frozen=True, slots=True, eq=False)
class Ahead:
    """A nominal state carried on past the filter's horizon."""

    nominal: Nominal
    t_us: int

    def by_inertial(self, sample: InertialSample, t_us: int, earth: EarthModel) -> Ahead:
        """On to ``t_us`` by one reading."""
        rate = sample.rate_body_rad_s - self.nominal.gyroscope_bias_rad_s
        force = sample.specific_force_body_m_s2 - self.nominal.accelerometer_bias_m_s2
        motion = propagate(self.nominal.motion, rate, force, (t_us - self.t_us) / 1e6, earth)
        return Ahead(replace(self.nominal, motion=motion), t_us)

    def coasting(self, t_us: int) -> Ahead:
        """On to ``t_us`` at the velocity and attitude there are."""
        motion = self.nominal.motion
        pos = motion.pos_ned_m + motion.vel_ned_m_s * ((t_us - self.t_us) / 1e6)
        return Ahead(replace(self.nominal, motion=replace(motion, pos_ned_m=pos)), t_us)
