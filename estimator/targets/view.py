"""Where in a picture a target should appear, how large, which way round, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.types import Float

STEP_M = 0.5
PICTURE_UPRIGHT: Float = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""``px_per_m`` of a picture with north up at a pixel a metre: taken where the camera's motion is not known."""
PICTURE_UPRIGHT.flags.writeable = False


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedView:
    """What navigation and the target's own motion say of its place in a picture.

    Attributes
    ----------
    uv_px, cov_px2
        Pixel (2,) of the target's centre, which may lie outside the picture, and its covariance (2, 2).
    px_per_m
        (2, 2): how the pixel moves as the point moves north and east on level ground.
    picture_from_ground
        (3, 3): homography from north and east of the place, metres, to pixels; None takes ``px_per_m`` all over.
    rate_std_px_s
        How fast the true pixel may run away from the expected one: the target's velocity error, seen.
    course_rad, course_std_rad
        The target's heading (clockwise from north) and its standard deviation; NaN where nothing is known of it.
    vel_ne_m_s
        The target's velocity (2,) over ground.
    moving
        Whether it is known to move, or known to stand, so that its surroundings must be the same as well; else None.
    """

    uv_px: Float
    cov_px2: Float
    px_per_m: Float
    rate_std_px_s: float = 0.0
    course_rad: float = float("nan")
    course_std_rad: float = float("nan")
    vel_ne_m_s: Float = field(default_factory=lambda: np.zeros(2))
    moving: bool | None = None
    picture_from_ground: Float | None = None

    def __post_init__(self) -> None:
        if self.uv_px.shape != (2,) or self.cov_px2.shape != (2, 2) or self.px_per_m.shape != (2, 2):
            message = "an expected view needs a pixel (2,), its covariance (2, 2) and pixels per metre (2, 2)"
            raise ValueError(message)
        numbers = (*self.uv_px, *self.cov_px2.ravel(), *self.px_per_m.ravel(), self.rate_std_px_s)
        if not np.isfinite(numbers).all() or self.rate_std_px_s < 0.0:
            message = "an expected view must be finite and its rate not negative"
            raise ValueError(message)
        if abs(float(np.linalg.det(self.px_per_m))) < 1e-9 or float(np.linalg.eigvalsh(self.cov_px2)[0]) < -1e-9:
            message = "an expected view needs a covariance that is one, and ground that is not seen edge on"
            raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What is known of a target's motion over ground: velocity (2,), covariance (2, 2), course, whether it moves."""

    vel_ne_m_s: Float
    cov_vel_ne_m2_s2: Float
    course_rad: float = float("nan")
    course_std_rad: float = float("nan")
    moving: bool | None = None


def expected_view(
    pos_ned_m: Float, ned_from_camera: Float, camera: Camera, place_ned_m: Float, cov_place_ne_m2: Float,
    motion: Motion | None = None,
) -> ExpectedView:  # fmt: skip
    """The view of a target at ``place_ned_m`` (3,) from a camera at ``pos_ned_m`` (3,) with ``ned_from_camera`` (3, 3).

    ``cov_place_ne_m2`` (2, 2) is of where the target appears to be to this camera: with the error of the camera's pose
    where the target's place does not share it.

    Raises
    ------
    GeometryError
        The place lies behind the camera, beyond the lens' model, or is seen edge on.
    """
    steps = np.zeros((5, 3))
    steps[1, 0], steps[2, 0], steps[3, 1], steps[4, 1] = STEP_M, -STEP_M, STEP_M, -STEP_M
    uv = camera.project((place_ned_m + steps - pos_ned_m) @ ned_from_camera)
    if not np.isfinite(uv).all():
        message = "the target lies behind the camera or outside what its lens can show"
        raise GeometryError(message)
    px_per_m = np.stack((uv[1] - uv[2], uv[3] - uv[4]), axis=-1) / (2.0 * STEP_M)
    if abs(float(np.linalg.det(px_per_m))) < 1e-6:
        message = "the ground at the target is seen edge on"
        raise GeometryError(message)
    cov = px_per_m @ cov_place_ne_m2 @ px_per_m.T
    whole = _homography(pos_ned_m, ned_from_camera, camera, place_ned_m)
    if motion is None:
        return ExpectedView(uv[0], cov, px_per_m, picture_from_ground=whole)
    rate = float(np.sqrt(np.linalg.eigvalsh(px_per_m @ motion.cov_vel_ne_m2_s2 @ px_per_m.T)[-1]))
    return ExpectedView(
        uv[0],
        cov,
        px_per_m,
        rate,
        motion.course_rad,
        motion.course_std_rad,
        motion.vel_ne_m_s,
        motion.moving,
        whole,
    )


def _homography(pos_ned_m: Float, ned_from_camera: Float, camera: Camera, place_ned_m: Float) -> Float | None:
    """From north and east of the place on level ground to pixels, exact at four points about it; None where one is not
    seen. What the lens bends between them is left out."""
    half_m = 0.2 * float(np.linalg.norm(place_ned_m - pos_ned_m))
    corners = half_m * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
    points = place_ned_m + np.column_stack((corners, np.zeros(4)))
    uv = camera.project((points - pos_ned_m) @ ned_from_camera)
    if not np.isfinite(uv).all():
        return None
    return np.asarray(cv2.getPerspectiveTransform(corners.astype(np.float32), uv.astype(np.float32)), np.float64)
