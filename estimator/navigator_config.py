"""How the navigator works, all in one place."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from estimator.filters.eskf import ProcessNoise
from estimator.filters.initialise import InitialGuess
from estimator.measurements.global_fix import GlobalFixConfig
from estimator.measurements.map_fix import MapFixConfig
from estimator.measurements.pad_tracking import PadConfig
from estimator.measurements.picture_to_picture import OdometryConfig
from estimator.measurements.self_watch import SelfWatchConfig
from estimator.measurements.video_clock import VideoClockConfig
from estimator.registration.alignment import MatcherConfig
from estimator.types import Float, GnssSample

GROUPS = (
    "position", "velocity", "attitude", "accelerometer_bias", "gyroscope_bias", "barometer_bias", "boresight",
    "attitude_bias", "ground_bias", "map_bias", "map_region", "map_offset", "gnss_bias", "clone_position",
    "clone_rotation", "keyframe_position", "keyframe_rotation", "structure",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class NavigatorConfig:
    """How the navigator works; the defaults suit a small aircraft with consumer sensors.

    What is slow of a satellite receiver's place is a state; heights are alike for ``gnss_height_time_s`` (ADR 0015).
    """

    groups: tuple[str, ...] = GROUPS
    noise: ProcessNoise = field(default_factory=ProcessNoise)
    initial: InitialGuess = field(default_factory=InitialGuess)
    matcher: MatcherConfig = field(default_factory=MatcherConfig)
    map_fix: MapFixConfig = field(default_factory=MapFixConfig)
    global_fix: GlobalFixConfig = field(default_factory=GlobalFixConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    video_clock: VideoClockConfig = field(default_factory=VideoClockConfig)
    watch: SelfWatchConfig = field(default_factory=SelfWatchConfig)
    pad: PadConfig = field(default_factory=PadConfig)
    find_video_offset: bool = False
    use_inertial: bool = True
    fix_interval_s: float = 0.4
    history_s: float = 120.0
    barometer_std_m: float = 0.5
    barometer_interval_s: float = 0.18
    reported_attitude_std_rad: float = 0.005
    reported_attitude_interval_s: float = 0.18
    gnss_interval_s: float = 0.9
    gnss_velocity_interval_s: float = 0.18
    gnss_min_std_m: float = 1.05
    gnss_height_time_s: float = 30.0
    min_inertial_hz: float = 18.0
    inertial_timeout_s: float = 0.5
    inertial_delay_s: float = 0.010
    lost_std_m: float = 100.0
    vision_timeout_s: float = 6.0
    vision_std_m: float = 12.0
    gnss_timeout_s: float = 2.5

    def gnss_noise(self, sample: GnssSample) -> tuple[Float, Float]:
        """Sigmas (3,) of a satellite position beside its slow error, and how many fixes in a row (3,) say it once."""
        slow_m = self.noise.gnss_bias_std_m if "gnss_bias" in self.groups else 0.0
        horizontal_m = math.sqrt(max(max(sample.std_horizontal_m, self.gnss_min_std_m) ** 2 - slow_m**2, 0.25))
        vertical_m = max(sample.std_vertical_m, 2.0 * self.gnss_min_std_m)
        alike = np.array([1.0, 1.0, 1.0 + 2.0 * self.gnss_height_time_s / self.gnss_interval_s])
        return np.array([horizontal_m, horizontal_m, vertical_m]), alike
