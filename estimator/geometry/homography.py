"""Homographies of level ground and of turning cameras.

All act on homogeneous pixels of undistorted pictures: those of an ideal camera with the same matrix K.
"""

from __future__ import annotations

import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.earth import Float


def ground_homography(camera: Camera, ned_from_camera: Float, camera_pos_ned_m: Float, ground_down_m: float) -> Float:
    """The map (3, 3) from (north, east, 1) on the level ground to undistorted homogeneous pixels.

    The third component of the result is the depth along the optical axis in metres, so it is positive for what the
    camera can see.
    """
    camera_from_ned = np.asarray(ned_from_camera, dtype=np.float64).T
    below = np.array((0.0, 0.0, ground_down_m)) - camera_pos_ned_m
    columns = np.column_stack((camera_from_ned[:, 0], camera_from_ned[:, 1], camera_from_ned @ below))
    homography: Float = camera.matrix @ columns
    return homography


def frame_to_frame_homography(
    camera: Camera, second_from_first: Float, translation_m: Float, normal_first: Float, distance_m: float
) -> Float:
    """The map (3, 3) of a plane's undistorted pixels from a first picture to a second: K (R + t n^T / d) K^-1.

    Parameters
    ----------
    second_from_first, translation_m
        R (3, 3) and t (3,) with x_second = R x_first + t.
    normal_first, distance_m
        Unit normal n (3,) in the first camera's frame, pointing away from the camera, and the distance d of the plane
        along it: n . x_first = d on the plane.
    """
    if not distance_m > 0.0:
        message = f"the plane must lie ahead of the first camera; its distance along the normal is {distance_m} m"
        raise ValueError(message)
    plane = np.asarray(second_from_first, dtype=np.float64) + np.outer(translation_m, normal_first) / distance_m
    return _in_pixels(camera, plane)


def rotation_homography(camera: Camera, second_from_first: Float) -> Float:
    """The map (3, 3) of undistorted pixels when the camera only turns, or the scene is far: K R K^-1."""
    return _in_pixels(camera, np.asarray(second_from_first, dtype=np.float64))


def _in_pixels(camera: Camera, matrix: Float) -> Float:
    k_inverse = np.array(
        (
            (1.0 / camera.fx_px, 0.0, -camera.cx_px / camera.fx_px),
            (0.0, 1.0 / camera.fy_px, -camera.cy_px / camera.fy_px),
            (0.0, 0.0, 1.0),
        )
    )
    homography: Float = camera.matrix @ matrix @ k_inverse
    return homography
