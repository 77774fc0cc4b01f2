"""Pointing a pan-tilt camera so that the pad stays in the middle of the picture. Pure.

Angles are those of gimbal protocol v2: pitch up from the horizon, yaw to the right of the vehicle's nose; the gimbal
keeps pitch and roll against the horizon itself, the yaw goes with the vehicle. Pitch may pass -90 degrees, where the
picture then looks backwards: straight above the pad there is no yaw to be had, and a gimbal that only points forward
would whirl around there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.types import Float


@dataclass(frozen=True, slots=True)
class PanTiltConfig:
    """What the gimbal can do. ``side_rad``: so far may the pad be beside the plane of tilt before the yaw turns."""

    pitch_min_rad: float = math.radians(-135.0)
    pitch_max_rad: float = math.radians(30.0)
    yaw_max_rad: float = math.pi
    rate_rad_s: float = math.radians(60.0)
    side_rad: float = math.radians(4.0)

    def __post_init__(self) -> None:
        if not self.pitch_min_rad < self.pitch_max_rad:
            message = f"pitch runs from {self.pitch_min_rad} to {self.pitch_max_rad} rad: the first must be less"
            raise ValueError(message)
        if not (self.yaw_max_rad > 0.0 and self.rate_rad_s > 0.0 and self.side_rad >= 0.0):
            message = "yaw_max_rad and rate_rad_s must be positive, side_rad not negative"
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class GimbalAngles:
    """Pitch from the horizon, yaw from the vehicle's nose."""

    pitch_rad: float
    yaw_rad: float


def line_of_sight(angles: GimbalAngles, heading_rad: float) -> Float:
    """The optical axis (3,) NED of angles on a vehicle with a heading."""
    level, yaw = math.cos(angles.pitch_rad), heading_rad + angles.yaw_rad
    return np.array((level * math.cos(yaw), level * math.sin(yaw), -math.sin(angles.pitch_rad)))


class PanTilt:
    """Follows a target from step to step within the gimbal's limits and rate."""

    def __init__(self, config: PanTiltConfig | None = None, start: GimbalAngles | None = None) -> None:
        self.config = config or PanTiltConfig()
        self.angles = start or GimbalAngles(-math.pi / 2, 0.0)
        self._t_us: int | None = None

    def step(self, t_us: int, heading_rad: float, target_ned_m: Float | None) -> GimbalAngles:
        """Angles to command at ``t_us``; ``target_ned_m`` (3,) leads from the lens to the target, None holds them."""
        dt_s = 0.0 if self._t_us is None else max(t_us - self._t_us, 0) / 1e6
        self._t_us = t_us
        # What is nearer than a centimetre has no direction.
        if target_ned_m is None or not float(np.linalg.norm(target_ned_m)) > 0.01:
            return self.angles
        goal = self._goal(_about_down(np.asarray(target_ned_m, np.float64), -heading_rad))
        # The yaw of a camera that looks down moves the picture little: each axis has the rate for itself.
        reach = self.config.rate_rad_s * dt_s
        pitch = self.angles.pitch_rad + min(max(goal.pitch_rad - self.angles.pitch_rad, -reach), reach)
        yaw = self.angles.yaw_rad + min(max(goal.yaw_rad - self.angles.yaw_rad, -reach), reach)
        self.angles = GimbalAngles(pitch, yaw)
        return self.angles

    def _goal(self, target: Float) -> GimbalAngles:
        """Where to point for a target (3,) in axes of the vehicle's heading."""
        forward, right, down = _about_down(target, -self.angles.yaw_rad)
        side = math.atan2(right, math.hypot(forward, down))
        here = GimbalAngles(-math.atan2(down, forward), self.angles.yaw_rad)
        if abs(side) <= self.config.side_rad and here == self._limited(here.pitch_rad, here.yaw_rad):
            return here
        yaw = math.atan2(target[1], target[0])
        pitch = -math.atan2(target[2], math.hypot(target[0], target[1]))
        # The same line of sight over the other side of straight down.
        over = self._limited(-math.pi - pitch, (yaw + 2.0 * math.pi) % (2.0 * math.pi) - math.pi)
        ahead = self._limited(pitch, yaw)
        reaches = [angles for angles in (ahead, over) if self._misses(angles, target) < 1e-6] or [ahead]
        return min(reaches, key=lambda a: abs(a.yaw_rad - self.angles.yaw_rad))

    def _limited(self, pitch_rad: float, yaw_rad: float) -> GimbalAngles:
        config = self.config
        return GimbalAngles(
            min(max(pitch_rad, config.pitch_min_rad), config.pitch_max_rad),
            min(max(yaw_rad, -config.yaw_max_rad), config.yaw_max_rad),
        )

    @staticmethod
    def _misses(angles: GimbalAngles, target: Float) -> float:
        return 1.0 - float(line_of_sight(angles, 0.0) @ target) / float(np.linalg.norm(target))


def _about_down(vector: Float, angle_rad: float) -> Float:
    """A vector (3,) turned about down."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array((c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]))
