"""A pan-tilt gimbal: turns where it is told, keeps level with the horizon, and knows itself nearly right."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.geometry.camera import GIMBAL_FROM_CAMERA
from estimator.geometry.rotation import matrix_from_euler, q_from_euler
from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.vehicles.gauss_markov import GaussMarkov

PITCH_MIN_RAD, PITCH_MAX_RAD = math.radians(-135.0), math.radians(30.0)
YAW_MAX_RAD = math.pi
_RATE_RAD_S = math.radians(90.0)
_STIFFNESS_PER_S = 8.0
# Of its own inertial unit against the horizon, how the lens sits in it, and what the stabilisation leaves over.
_TILT_STD_RAD, _TILT_TIME_S = math.radians(0.15), 60.0
_MISFIT_STD_RAD = math.radians(0.4)
_SHAKE_STD_RAD, _SHAKE_TIME_S = math.radians(0.03), 0.2


@dataclass(frozen=True, slots=True, eq=False)
class GimbalReport:
    """What it says of itself: attitude (4,) with the yaw from the vehicle's nose, and how fast it turns (3,)."""

    q_level_from_gimbal: Float
    rate_rad_s: Float


class PanTiltGimbal:
    """One gimbal; angles are pitch up from the horizon and yaw to the right of the vehicle's nose."""

    def __init__(self, seed: int, pitch_rad: float, yaw_rad: float) -> None:
        rng = rng_for(seed, "gimbal")
        self._angles = np.array((pitch_rad, yaw_rad))
        self._goal = self._angles.copy()
        self._yaw_from_north = False
        self._rate = np.zeros(2)
        self._misfit_rad = _MISFIT_STD_RAD * rng.standard_normal(3)
        self._tilt = GaussMarkov(rng_for(seed, "gimbal", "tilt"), _TILT_STD_RAD, _TILT_TIME_S, 2)
        self._shake = GaussMarkov(rng_for(seed, "gimbal", "shake"), _SHAKE_STD_RAD, _SHAKE_TIME_S, 3)

    def point(self, pitch_rad: float, yaw_rad: float, *, from_north: bool = False) -> None:
        """Turn there, or as near as it can; NaN leaves an angle as it is."""
        if math.isfinite(pitch_rad):
            self._goal[0] = min(max(pitch_rad, PITCH_MIN_RAD), PITCH_MAX_RAD)
        if math.isfinite(yaw_rad):
            self._goal[1], self._yaw_from_north = yaw_rad, from_north

    def step(self, dt_s: float, heading_rad: float) -> None:
        """Turn for ``dt_s``."""
        goal = self._goal.copy()
        if self._yaw_from_north:
            goal[1] -= heading_rad
        goal[1] = (goal[1] + math.pi) % (2 * math.pi) - math.pi
        self._rate = np.clip(_STIFFNESS_PER_S * (goal - self._angles), -_RATE_RAD_S, _RATE_RAD_S)
        self._angles = self._angles + self._rate * dt_s
        self._tilt.step(dt_s)
        self._shake.step(dt_s)

    def ned_from_camera(self, heading_rad: float) -> Float:
        """Where the camera really looks, (3, 3)."""
        roll, pitch, yaw = self._shake.value + np.array((0.0, *self._angles))
        misfit = matrix_from_euler(*self._misfit_rad)
        ned_from_camera: Float = matrix_from_euler(roll, pitch, heading_rad + yaw) @ misfit @ GIMBAL_FROM_CAMERA
        return ned_from_camera

    def report(self) -> GimbalReport:
        """What it believes."""
        roll, pitch = self._tilt.value + np.array((0.0, self._angles[0]))
        return GimbalReport(
            q_from_euler(roll, pitch, float(self._angles[1])), np.array((0.0, self._rate[0], self._rate[1]))
        )
