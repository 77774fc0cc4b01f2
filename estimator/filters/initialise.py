"""First estimate: wait for attitude, position and height, and say how sure each is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.filters.eskf import ProcessNoise
from estimator.filters.nominal import Layout, Nominal
from estimator.filters.strapdown import Motion
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_rotvec, q_multiply
from estimator.types import AttitudeSample, BarometerSample, Float, GnssSample, HomeSample, Sample

# an older fix is of another place
FIX_SERVES_US = 2_000_000


@dataclass(frozen=True, slots=True)
class InitialGuess:
    """What to assume before the first measurements.

    ``lat_rad`` and ``lon_rad`` give a position to start from where no satellite fix comes within ``patience_s``; home
    serves where they are None. Standard deviations are of the first estimate; the camera's is ``boresight_std_rad`` for
    one fixed to the body and ``gimbal_error_std_rad`` for one whose gimbal reports its attitude. By
    ``attitude_error_rad``, about the NED axes, the first attitude is made wrong, to study how that is recovered from.
    """

    lat_rad: float | None = None
    lon_rad: float | None = None
    position_std_m: float = 40.0
    patience_s: float = 3.0
    attitude_std_rad: tuple[float, float, float] = (0.02, 0.02, 0.05)
    attitude_error_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accelerometer_bias_std_m_s2: float = 0.15
    gyroscope_bias_std_rad_s: float = 0.005
    boresight_std_rad: float = 0.01
    gimbal_error_std_rad: float = 0.02
    unknown_height_std_m: float = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class FirstEstimate:
    """Position, velocity and attitude at the start with their standard deviations (3,)."""

    motion: Motion
    position_std_m: Float
    velocity_std_m_s: Float
    barometer_bias_m: float
    barometer_bias_std_m: float
    by_satellites: bool = False


class InitialConditions:
    """Collects samples until the filter can start."""

    def __init__(self, guess: InitialGuess, frame: LocalFrame) -> None:
        self._guess = guess
        self._frame = frame
        self._attitude: AttitudeSample | None = None
        self._gnss: GnssSample | None = None
        self._home: HomeSample | None = None
        self._barometer: list[float] = []
        self._first_t_us: int | None = None
        self._newest_t_us = 0

    def offer(self, sample: Sample) -> None:
        """Take a sample."""
        if self._first_t_us is None:
            self._first_t_us = sample.t_us
        self._newest_t_us = max(self._newest_t_us, sample.t_us)
        match sample:
            case AttitudeSample():
                self._attitude = sample
            case GnssSample():
                self._gnss = sample
            case HomeSample():
                self._home = sample
            case BarometerSample():
                self._barometer.append(sample.pressure_alt_m)
                del self._barometer[:-10]
            case _:
                pass

    def missing(self) -> str:
        """What is waited for: all that has not come, or the patience with satellites where the rest has."""
        lacking = []
        if self._attitude is None:
            lacking.append("the vehicle's attitude")
        if not self._barometer:
            lacking.append("a reading of its barometer")
        has_place = self._home is not None or (self._guess.lat_rad is not None and self._guess.lon_rad is not None)
        if not has_place and not self._has_fresh_fix(self._newest_t_us):
            lacking.append("a first position (satellite fix, home, or a position given in the configuration)")
        if not lacking:
            return f"a satellite fix, or {self._guess.patience_s:g} s without one to start from the given position"
        return " and ".join(lacking)

    def lacks_only_place(self, t_us: int) -> bool:
        """Whether attitude and barometer are there, the patience is over, and no position has come at all."""
        if self._attitude is None or not self._barometer or self._first_t_us is None:
            return False
        given = self._home is not None or (self._guess.lat_rad is not None and self._guess.lon_rad is not None)
        waited = t_us - self._first_t_us >= self._guess.patience_s * 1e6
        return waited and not given and not self._has_fresh_fix(t_us)

    def _has_fresh_fix(self, t_us: int) -> bool:
        return self._gnss is not None and t_us - self._gnss.t_us < FIX_SERVES_US

    def ready(self, t_us: int) -> FirstEstimate | None:
        """The first estimate as soon as it can be made."""
        if self._attitude is None or self._first_t_us is None:
            return None
        if self._gnss is not None and self._has_fresh_fix(t_us):
            return self._from_gnss(self._gnss, self._attitude) if self._barometer else None
        if t_us - self._first_t_us < self._guess.patience_s * 1e6 or not self._barometer:
            return None
        return self._from_guess(self._attitude)

    def _from_gnss(self, fix: GnssSample, attitude: AttitudeSample) -> FirstEstimate:
        pos = self._frame.ned_from_geodetic(fix.lat_rad, fix.lon_rad, fix.alt_amsl_m)
        known = np.isfinite(fix.vel_ned_m_s)
        vel = np.where(known, fix.vel_ned_m_s, 0.0)
        horizontal, vertical = max(fix.std_horizontal_m, 1.5), max(fix.std_vertical_m, 2.5)
        return FirstEstimate(
            Motion(pos, vel, attitude.q_ned_from_body),
            np.array([horizontal, horizontal, vertical]),
            np.where(known, 0.7, np.array([8.0, 8.0, 2.0])),
            float(np.mean(self._barometer)) - fix.alt_amsl_m,
            vertical,
            by_satellites=True,
        )

    def _from_guess(self, attitude: AttitudeSample) -> FirstEstimate | None:
        lat, lon, home = self._guess.lat_rad, self._guess.lon_rad, self._home
        if lat is None or lon is None:
            if home is None:
                return None
            lat, lon = home.lat_rad, home.lon_rad
        # without a satellite height the standard atmosphere gives it to a few tens of metres
        alt = float(np.mean(self._barometer))
        pos = self._frame.ned_from_geodetic(lat, lon, alt)
        std, height_std = self._guess.position_std_m, self._guess.unknown_height_std_m
        return FirstEstimate(
            Motion(pos, np.zeros(3), attitude.q_ned_from_body),
            np.array([std, std, height_std]), np.array([8.0, 8.0, 2.0]), 0.0, height_std,
        )  # fmt: skip


def aligned(first: FirstEstimate, layout: Layout, guess: InitialGuess, noise: ProcessNoise) -> tuple[Nominal, Float]:
    """Nominal state and covariance (n, n) from the first estimate."""
    motion = first.motion
    if any(guess.attitude_error_rad):
        q_wrong = q_multiply(q_from_rotvec(np.array(guess.attitude_error_rad)), motion.q_ned_from_body)
        motion = Motion(motion.pos_ned_m, motion.vel_ned_m_s, q_wrong)
    nominal = Nominal(motion, np.zeros(3), np.zeros(3), first.barometer_bias_m, np.zeros(3), np.zeros(3))
    std = np.zeros(layout.size)
    first_std: dict[str, Any] = {
        "position": first.position_std_m,
        "velocity": first.velocity_std_m_s,
        "attitude": guess.attitude_std_rad,
        "accelerometer_bias": guess.accelerometer_bias_std_m_s2,
        "gyroscope_bias": guess.gyroscope_bias_std_rad_s,
        "barometer_bias": first.barometer_bias_std_m,
        "boresight": guess.boresight_std_rad,
        "attitude_bias": noise.attitude_bias_std_rad,
        "ground_bias": noise.ground_bias_std_m,
        "map_bias": 1.0,
        "gnss_bias": noise.gnss_bias_std_m,
    }
    for name, value in first_std.items():
        if layout.has(name):
            std[layout.slices[name]] = value
    P = np.diag(std**2)
    _correlate(P, layout, "position", 2, "barometer_bias", 0, sign=1.0)
    if first.by_satellites and layout.has("gnss_bias"):
        for axis in range(2):
            # the slow part of what the place is off by: minus its variance, and not more than all of it
            shared = min(noise.gnss_bias_std_m / float(first.position_std_m[axis]), 1.0)
            _correlate(P, layout, "position", axis, "gnss_bias", axis, sign=-shared)
    if layout.has("attitude_bias"):
        for axis in range(3):
            _correlate(P, layout, "attitude", axis, "attitude_bias", axis, sign=-1.0)
    return nominal, P


def _correlate(P: Float, layout: Layout, group: str, i: int, other: str, j: int, sign: float) -> None:
    """Tie two errors that come from one measurement: what is wrong in the one is wrong in the other."""
    if not layout.has(group) or not layout.has(other):
        return
    a, b = layout.slices[group].start + i, layout.slices[other].start + j
    covariance = sign * 0.98 * float(np.sqrt(P[a, a] * P[b, b]))
    P[a, b] = P[b, a] = covariance
