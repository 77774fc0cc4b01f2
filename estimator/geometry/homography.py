"""Homographies of a level ground plane and between pictures of it.

Hartley and Zisserman, Multiple View Geometry, 2nd edition, sections 8.1 and 13.1. Pixels are ideal (undistorted).
"""

from __future__ import annotations

import numpy as np

from estimator.geometry.camera import Camera
from estimator.geometry.earth import Float


def ground_homography(
    camera: Camera, ned_from_camera: Float, camera_pos_ned_m: Float, ground_down_m: float
) -> Float:
    """Homography (3, 3) from (north, east, 1) on a level plane to the undistorted pixel."""
    camera_from_ned = ned_from_camera.T
    offset = np.array([0.0, 0.0, ground_down_m]) - camera_pos_ned_m
    out: Float = camera.matrix @ np.column_stack(
        (camera_from_ned[:, 0], camera_from_ned[:, 1], camera_from_ned @ offset)
    )
    return out


def rotation_homography(camera: Camera, second_from_first: Float) -> Float:
    """Homography (3, 3) between undistorted pictures from one place, for a rotation (3, 3) of camera axes."""
    out: Float = camera.matrix @ second_from_first @ np.linalg.inv(camera.matrix)
    return out


def frame_to_frame_homography(
    camera: Camera, second_from_first: Float, translation_second_m: Float, normal_first: Float, distance_first_m: float
) -> Float:
    """Homography (3, 3) from the first undistorted picture to the second, of points with n . X = d in the first frame.

    X2 = R X1 + t gives H = K (R + t n^T / d) K^-1.
    """
    motion = second_from_first + np.outer(translation_second_m, normal_first) / distance_first_m
    out: Float = camera.matrix @ motion @ np.linalg.inv(camera.matrix)
    return out
