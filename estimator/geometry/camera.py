"""Pinhole camera with Brown-Conrady distortion, and its mount.

OpenCV's model: x' = x (1 + k1 r2 + k2 r4 + k3 r6) + 2 p1 x y + p2 (r2 + 2 x2), likewise y'; pixel = f x' + c.
Pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from estimator.geometry.earth import Float
from estimator.geometry.rotation import matrix_from_euler

GIMBAL_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""The gimbal frame has x along the optical axis, y right and z down in the picture; the camera is right-down-forward."""

_MAX_ITERATIONS = 30


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsic parameters in pixels; ``distortion`` is (k1, k2, p1, p2, k3)."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    _max_r2: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1 or not (self.fx_px > 0.0 and self.fy_px > 0.0):
            message = f"camera of {self.width_px} x {self.height_px} px with focal length {self.fx_px}, {self.fy_px} px"
            raise ValueError(message)
        object.__setattr__(self, "_max_r2", _monotonic_r2(self.distortion))

    @classmethod
    def from_hfov(cls, width_px: int, height_px: int, hfov_rad: float) -> Camera:
        """A camera without distortion of a horizontal field of view, its centre in the middle of the picture."""
        focal = 0.5 * width_px / float(np.tan(0.5 * hfov_rad))
        return cls(width_px, height_px, focal, focal, 0.5 * (width_px - 1), 0.5 * (height_px - 1))

    @property
    def matrix(self) -> Float:
        """Intrinsic matrix (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    def distort(self, xy: ArrayLike) -> Float:
        """Distorted normalised coordinates (..., 2) of ideal ones; NaN beyond the radius where the lens folds back."""
        xy = np.asarray(xy, dtype=np.float64)
        x, y = xy[..., 0], xy[..., 1]
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        if np.isfinite(self._max_r2):
            radial = np.where(r2 <= self._max_r2, radial, np.nan)
        xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        return np.stack((xd, yd), axis=-1)

    def project(self, points_camera_m: ArrayLike) -> Float:
        """Pixels (..., 2) of points (..., 3) in the camera frame; NaN behind the camera and beyond the lens."""
        points = np.asarray(points_camera_m, dtype=np.float64)
        depth = points[..., 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = np.where(depth > 1e-9, points[..., :2] / depth, np.nan)
        return self.distort(xy) * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px)

    def undistort(self, uv_px: ArrayLike) -> Float:
        """Ideal normalised coordinates (..., 2) of pixels; NaN where the lens model has no inverse.

        Newton's method on the distortion; its fixed-point cousin diverges at the rim of wide lenses.
        """
        uv = np.asarray(uv_px, dtype=np.float64)
        target = (uv - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px)
        if not any(self.distortion):
            return target
        xy = target.copy()
        for _ in range(_MAX_ITERATIONS):
            step = self._newton_step(xy, target)
            xy = xy - step
            if not np.nanmax(np.abs(step), initial=0.0) > 1e-13:
                break
        error = np.abs(self.distort(xy) - target).max(axis=-1, keepdims=True)
        return np.where(error < 1e-9, xy, np.nan)

    def _newton_step(self, xy: Float, target: Float) -> Float:
        x, y = xy[..., 0], xy[..., 1]
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        growth = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))
        a = radial + growth * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        b = growth * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        d = radial + growth * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        ex = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - target[..., 0]
        ey = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - target[..., 1]
        determinant = a * d - b * b
        determinant = np.where(np.abs(determinant) > 1e-9, determinant, np.nan)
        return np.stack(((d * ex - b * ey) / determinant, (a * ey - b * ex) / determinant), axis=-1)

    def rays(self, uv_px: ArrayLike) -> Float:
        """Unit rays (..., 3) in the camera frame of pixels (..., 2)."""
        xy = self.undistort(uv_px)
        rays = np.concatenate((xy, np.ones((*xy.shape[:-1], 1))), axis=-1)
        out: Float = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return out

    def contains(self, uv_px: ArrayLike) -> np.ndarray:
        """Whether pixels (..., 2) lie in the picture."""
        uv = np.asarray(uv_px, dtype=np.float64)
        inside = (uv >= -0.5) & (uv < (self.width_px - 0.5, self.height_px - 0.5))
        return np.asarray(inside.all(axis=-1))

    def scaled(self, factor: float) -> Camera:
        """The camera of a picture resized by ``factor``; sizes are rounded, and focal lengths follow the rounding."""
        width, height = max(1, round(self.width_px * factor)), max(1, round(self.height_px * factor))
        sx, sy = width / self.width_px, height / self.height_px
        return Camera(
            width, height, self.fx_px * sx, self.fy_px * sy, (self.cx_px + 0.5) * sx - 0.5,
            (self.cy_px + 0.5) * sy - 0.5, self.distortion,
        )  # fmt: skip


def _monotonic_r2(distortion: tuple[float, float, float, float, float]) -> float:
    """Squared ideal radius up to which the radial distortion grows, infinity if it always does."""
    k1, k2, _, _, k3 = distortion
    # derivative of r (1 + k1 r2 + k2 r4 + k3 r6) by r, a polynomial in r2
    roots = np.roots(np.trim_zeros([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0], "f"))
    real = roots[np.abs(roots.imag) < 1e-9].real
    positive = real[real > 0.0]
    return float(positive.min()) if positive.size else float("inf")


def _no_lever_arm() -> Float:
    return np.zeros(3)


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """How the gimbal frame sits on the body: Euler angles (z-y-x) in radians, and the lever arm (3,) in body FRD."""

    roll_rad: float = 0.0
    pitch_rad: float = -np.pi / 2.0
    yaw_rad: float = 0.0
    lever_arm_frd_m: Float = field(default_factory=_no_lever_arm)

    @property
    def body_from_gimbal(self) -> Float:
        """Rotation (3, 3)."""
        return matrix_from_euler(self.roll_rad, self.pitch_rad, self.yaw_rad)

    @property
    def body_from_camera(self) -> Float:
        """Rotation (3, 3)."""
        out: Float = self.body_from_gimbal @ GIMBAL_FROM_CAMERA
        return out
