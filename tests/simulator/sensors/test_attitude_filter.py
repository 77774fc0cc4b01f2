"""The attitude that the autopilot believes in."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simulator.scenario import SensorSection
from simulator.sensors.attitude_filter import AttitudeFilter

TRUTH = Rotation.from_euler("ZYX", [130.0, -8.0, 5.0], degrees=True)


def error_deg(q_believed: np.ndarray) -> np.ndarray:
    """Rotation error about north, east, down."""
    error = Rotation.from_quat(q_believed, scalar_first=True) * TRUTH.inv()
    return np.degrees(error.as_rotvec())


def test_error_sizes_over_seeds_and_slowness() -> None:
    q_truth = TRUTH.as_quat(scalar_first=True)
    filters = [AttitudeFilter(seed, SensorSection()) for seed in range(150)]
    errors = np.array([error_deg(f.step(q_truth, 0.04)) for f in filters])
    tilt = np.hypot(errors[:, 0], errors[:, 1])
    # 150 draws: known to 6 %.
    assert np.sqrt(np.mean(tilt**2)) == pytest.approx(0.5, rel=0.2)
    assert errors[:, 2].std() == pytest.approx(1.5, rel=0.2)
    soon = np.array([error_deg(f.step(q_truth, 0.04)) for f in filters])
    assert np.abs(soon - errors).max() < 0.25
