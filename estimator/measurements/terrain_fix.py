"""A registered picture as measurements of position, attitude and height.

The matched ground point lies where the camera's position and its attitude together put it, so the attitude's lever arm,
height times tilt, stands in the Jacobian and not in the noise (the cure for Conte 2009, section 5.8.5, where the filter
diverges with height). Two more errors look like the camera's: where the reference imagery is displaced, and where what
is seen lies above or below the ground model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.ground import ground_point_by_pose
from estimator.measurements.camera_attitude import CameraAttitude
from estimator.measurements.innovation import Innovation
from estimator.registration.refine import Refinement
from estimator.types import Float

MIN_INFORMATION = 1e-9


def apparent_pose(eskf: ErrorStateFilter, camera_pos_ned_m: Float) -> Float:
    """Camera position (3,) at which the map as it is would show the picture: displaced with it, above what is seen."""
    north, east = eskf.nominal.map_displacement_ne_m
    pos: Float = camera_pos_ned_m + np.array([north, east, -eskf.nominal.ground_bias_m])
    return pos


def apparent_pose_jacobian(eskf: ErrorStateFilter, camera: CameraAttitude) -> Float:
    """Jacobian (6, n) of the apparent pose: position NED, then the rotation about the NED axes."""
    position, turn = np.eye(6)[:, :3], np.eye(6)[:, 3:]
    return eskf.layout.jacobian(
        6,
        position=position,
        map_bias=position[:, :2],
        map_region=position[:, :2],
        map_offset=position[:, :2],
        ground_bias=-position[:, [2, 2]],
        attitude=turn @ camera.by_attitude,
        boresight=turn @ camera.by_boresight,
    )


def centre_by_pose(centre_ned_m: Float, camera_pos_ned_m: Float) -> Float:
    """Derivative (2, 6) of the ground point seen at ``centre_ned_m`` (3,) by the camera's pose."""
    to_centre = centre_ned_m - camera_pos_ned_m
    return ground_point_by_pose(to_centre[:2] / to_centre[2], to_centre[2])


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """How much of a refinement's own noise counts in an update, as factors on standard deviations.

    ``centre`` is for where the picture's middle lies (what the map's local displacement does not already explain),
    ``shape`` for what turns, tilts and scales it.
    """

    centre: float
    shape: float

    def counted(self, information: Float) -> Float:
        """An information matrix (6, 6) of displacement (2), height and rotation (3) as far as it counts."""
        weight = np.diag([1.0 / self.centre] * 2 + [1.0 / self.shape] * 4)
        counted: Float = weight @ information @ weight
        return counted


def pose(
    refinement: Refinement, T: Float, centre_ned_m: Float, camera_pos_ned_m: Float, noise: PoseNoise, own: PoseNoise
) -> Innovation | None:
    """Innovation of the camera's pose, along the directions in which the picture says anything; None if none.

    ``T`` (6, n) is ``apparent_pose_jacobian``. ``own`` is the noise of one picture, ``noise`` what it counts by beside
    its neighbours. The pose is written as displacement of the picture's middle (2), height (1) and rotation (3): these
    are what the two kinds of noise belong to, while position and tilt share theirs.
    """
    height_m = float(centre_ned_m[2] - camera_pos_ned_m[2])
    Y = np.zeros((6, 6))
    Y[:2] = centre_by_pose(centre_ned_m, camera_pos_ned_m) / height_m
    Y[2, 2] = 1.0 / height_m
    Y[3:, 3:] = np.eye(3)
    back = np.linalg.inv(Y)
    told = back.T @ refinement.information @ back
    information = noise.counted(told)
    eigenvalues, axes = np.linalg.eigh(information)
    known = eigenvalues > max(MIN_INFORMATION * float(eigenvalues[-1]), 1.0)
    if not known.any():
        return None
    axes = axes[:, known]
    directions = axes.T @ Y
    R_one = np.linalg.inv(axes.T @ own.counted(told) @ axes)
    return Innovation(directions @ refinement.best, directions @ T, np.diag(1.0 / eigenvalues[known]), R_one)


def heading(
    eskf: ErrorStateFilter, camera: CameraAttitude, correction_rad: float, std_rad: float, weight: float
) -> Innovation:
    """Innovation of the turn about the vertical that the best hypothesis applied, of which a ``weight`` counts."""
    H = eskf.layout.jacobian(1, attitude=camera.by_attitude[2:], boresight=camera.by_boresight[2:])
    R_one = np.array([[std_rad**2]])
    return Innovation(np.array([correction_rad]), H, R_one / weight, R_one)


def height(eskf: ErrorStateFilter, height_m: float, scale: float, std: float, weight: float) -> Innovation:
    """Innovation of the height above what is seen, as a share of it; a ``weight`` of it counts."""
    H = eskf.layout.jacobian(
        1, position=np.array([[0.0, 0.0, -1.0 / height_m]]), ground_bias=np.array([[1.0, 1.0]]) / height_m
    )
    R_one = np.array([[std**2]])
    return Innovation(np.array([scale]), H, R_one / weight, R_one)
