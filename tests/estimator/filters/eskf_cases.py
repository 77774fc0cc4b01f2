"""A filter of every group of states, for tests."""

import numpy as np

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.nominal import STATE_GROUPS, Clone, Layout, Nominal, PadPlace
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.rotation import q_from_euler

EARTH = EarthModel.at(np.deg2rad(47.0), 300.0)
FULL = Layout.of(STATE_GROUPS)
QUIET = ProcessNoise(
    accelerometer_m_s2_rt_s=0.0,
    gyroscope_rad_rt_s=0.0,
    accelerometer_bias_m_s2_rt_s=0.0,
    gyroscope_bias_rad_s_rt_s=0.0,
    barometer_bias_m_rt_s=0.0,
    boresight_rad_rt_s=0.0,
    attitude_bias_std_rad=(0.0, 0.0, 0.0),
    ground_bias_std_m=(0.0, 0.0),
    gnss_bias_std_m=0.0,
)


def nominal_state() -> Nominal:
    return Nominal(
        motion=Motion(np.array([30.0, -12.0, -90.0]), np.array([11.0, -6.0, 0.7]), q_from_euler(0.2, -0.15, 1.1)),
        accelerometer_bias_m_s2=np.array([0.05, -0.03, 0.08]),
        gyroscope_bias_rad_s=np.array([0.002, -0.001, 0.003]),
        barometer_bias_m=4.0,
        boresight_rad=np.array([0.004, -0.006, 0.002]),
        attitude_bias_rad=np.array([0.01, 0.005, -0.02]),
        ground_biases_m=np.array([0.8, -0.5]),
        map_bias_ne_m=np.array([0.3, -0.4]),
        map_region_ne_m=np.array([-0.6, 0.9]),
        map_offset_ne_m=np.array([7.0, -2.0]),
        gnss_bias_ne_m=np.array([-0.7, 0.5]),
        clone=Clone(np.array([25.0, -9.0, -89.0]), q_from_euler(0.1, -1.4, 0.9)),
        keyframe=Clone(np.array([14.0, -2.0, -88.0]), q_from_euler(0.0, -1.5, 0.8)),
        structure_m=np.array([0.4, -1.5, 2.0]),
        pad=PadPlace(np.array([28.0, -15.0, -75.0]), q_from_euler(0.03, -0.02, 2.1)),
    )


def quiet_filter(P: np.ndarray, nominal: Nominal | None = None, noise: ProcessNoise = QUIET) -> ErrorStateFilter:
    eskf = ErrorStateFilter(nominal or nominal_state(), P.copy(), FULL, EARTH, noise)
    if noise is QUIET:
        eskf.map_bias_std_m = 0.0
    return eskf
