"""The autopilot's attitude, heading included, as a measurement with a slowly varying error."""

from __future__ import annotations

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.history import rotation_between
from estimator.measurements.innovation import Innovation
from estimator.types import Float


def reported_attitude(eskf: ErrorStateFilter, q_ned_from_body: Float, std_rad: float) -> Innovation:
    """Innovation of an attitude quaternion; the slow part of its error is a state, ``std_rad`` the rest."""
    z = rotation_between(eskf.nominal.motion.q_ned_from_body, q_ned_from_body) - eskf.nominal.attitude_bias_rad
    H = eskf.layout.jacobian(3, attitude=np.eye(3), attitude_bias=np.eye(3))
    return Innovation(z, H, np.eye(3) * std_rad**2)
