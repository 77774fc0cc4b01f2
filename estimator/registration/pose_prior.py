"""What is known of a camera's pose before its picture is compared with a map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.geometry.camera import GIMBAL_FROM_CAMERA
from estimator.geometry.rotation import matrix_from_euler
from estimator.registration.alignment import CameraPose
from estimator.types import Float

STRAIGHT_DOWN_RAD = math.radians(15.0)
"""Off the vertical less than this, the picture's top gives the heading rather than the optical axis."""


@dataclass(frozen=True, slots=True, eq=False)
class PosePrior:
    """A guess of a camera's pose.

    ``pos_ne_m`` (2,) is where the camera is thought to be, with standard deviation ``std_m`` on each axis (infinite:
    any place within ``radius_m`` is as likely), and it is certainly within ``radius_m``. ``down_m`` is its NED down
    with ``down_std_m``. ``heading_rad`` is where the picture's top (looking down) or the optical axis (oblique)
    points, with ``heading_std_rad``; infinite where it is unknown. ``pitch_rad`` and ``roll_rad`` are those of the
    gimbal frame (pitch -pi/2 looks straight down), with ``tilt_std_rad`` on each axis.
    """

    pos_ne_m: Float
    radius_m: float
    std_m: float
    down_m: float
    down_std_m: float
    heading_rad: float = 0.0
    heading_std_rad: float = math.inf
    pitch_rad: float = -math.pi / 2
    roll_rad: float = 0.0
    tilt_std_rad: float = math.radians(7.0)

    def __post_init__(self) -> None:
        known = (*self.pos_ne_m, self.down_m, self.heading_rad, self.pitch_rad, self.roll_rad)
        if not all(map(math.isfinite, known)):
            message = "position, down, heading, pitch and roll of a pose prior must be finite"
            raise ValueError(message)
        spreads = (self.std_m, self.down_std_m, self.heading_std_rad, self.tilt_std_rad)
        if not (0.0 < self.radius_m < math.inf and all(spread > 0.0 for spread in spreads)):
            message = "radius and standard deviations of a pose prior must be positive"
            raise ValueError(message)

    @property
    def has_heading(self) -> bool:
        """Whether anything is known of the heading."""
        return self.heading_std_rad < math.radians(60.0)

    def ned_from_camera(self, turn_rad: float = 0.0) -> Float:
        """Rotation (3, 3) of the camera, turned about the vertical."""
        turned = matrix_from_euler(0.0, 0.0, turn_rad)
        level: Float = matrix_from_euler(self.roll_rad, self.pitch_rad, self.heading_rad) @ GIMBAL_FROM_CAMERA
        return np.asarray(turned @ level, dtype=np.float64)

    def pose(self, turn_rad: float = 0.0) -> CameraPose:
        """The pose in the middle of the prior, turned about the vertical."""
        return CameraPose(np.array([*self.pos_ne_m, self.down_m]), self.ned_from_camera(turn_rad))

    def log_density(self, pos_ne_m: Float) -> Float:
        """Log of the prior density (...) at positions (..., 2), up to a constant; minus infinity beyond the radius."""
        distance_m = np.linalg.norm(np.asarray(pos_ne_m) - self.pos_ne_m, axis=-1)
        inside = np.where(distance_m <= self.radius_m, 0.0, -np.inf)
        return np.asarray(inside - 0.5 * (distance_m / self.std_m) ** 2, dtype=np.float64)

    def covariance(self) -> Float:
        """Covariance (6, 6) of the pose error once a place was found: position NED, then rotation about NED axes.

        Horizontal position and heading are left as open as a candidate is: to tens of metres and degrees.
        """
        turn = math.radians(8.0)
        return np.diag([20.0**2, 20.0**2, self.down_std_m**2, self.tilt_std_rad**2, self.tilt_std_rad**2, turn**2])


def heading_of(ned_from_camera: Float) -> float:
    """Where the picture's top points (camera looking down), or the optical axis (oblique), radians from north."""
    axis, top = ned_from_camera[:, 2], -ned_from_camera[:, 1]
    towards = top if axis[2] > math.cos(STRAIGHT_DOWN_RAD) else axis
    return float(np.arctan2(towards[1], towards[0]) % (2.0 * np.pi))
