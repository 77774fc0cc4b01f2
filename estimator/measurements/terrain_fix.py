"""A registered picture as measurements of position, heading and height.

The matched ground point lies where the camera's position and its attitude together put it, so the attitude's lever arm,
height times tilt, stands in the Jacobian and not in the noise (the cure for Conte 2009, section 5.8.5, where the filter
diverges with height).
"""

from __future__ import annotations

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.measurements.camera_attitude import CameraAttitude
from estimator.measurements.innovation import Innovation
from estimator.odometry.planar import rotation_jacobian
from estimator.types import Float


def apparent_position_jacobian(
    eskf: ErrorStateFilter, camera: CameraAttitude, centre_ned_m: Float, camera_pos_ned_m: Float
) -> Float:
    """Jacobian (2, n) of the ground point seen at ``centre_ned_m`` (3,), as displaced by errors of the state."""
    to_centre = centre_ned_m - camera_pos_ned_m
    slope = to_centre[:2] / to_centre[2]
    by_rotation = rotation_jacobian(slope[None], to_centre[2:])
    return eskf.layout.jacobian(
        2,
        position=np.array([[1.0, 0.0, -slope[0]], [0.0, 1.0, -slope[1]]]),
        attitude=by_rotation @ camera.by_attitude,
        boresight=by_rotation @ camera.by_boresight,
    )


def heading(eskf: ErrorStateFilter, camera: CameraAttitude, correction_rad: float, std_rad: float) -> Innovation:
    """Innovation of the turn about the vertical that the best hypothesis applied."""
    H = eskf.layout.jacobian(1, attitude=camera.by_attitude[2:], boresight=camera.by_boresight[2:])
    return Innovation(np.array([correction_rad]), H, np.array([[std_rad**2]]))


def height(eskf: ErrorStateFilter, height_m: float, scale: float, std: float) -> Innovation:
    """Innovation of the height above the ground, as a share of it."""
    H = eskf.layout.jacobian(1, position=np.array([[0.0, 0.0, -1.0 / height_m]]))
    return Innovation(np.array([scale]), H, np.array([[std**2]]))
