"""A pinhole camera with Brown-Conrady distortion, and how it is mounted.

Camera frame: x right, y down in the picture, z along the optical axis. Pixel (0, 0) is the centre of the top-left
pixel. The distortion is OpenCV's five-parameter model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.rotation import Float, matrix_from_euler

_FIXED_POINT_STEPS: Final = 2
_NEWTON_STEPS: Final = 40
_UNDISTORT_TOLERANCE: Final = 1e-12
_SHORTEST_STEP: Final = 1e-3

GIMBAL_FROM_CAMERA: Final[Float] = np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
"""Gimbal x is the optical axis (camera z), y is right (camera x), z is down in the picture (camera y)."""
GIMBAL_FROM_CAMERA.flags.writeable = False


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsic parameters in pixels, and distortion (k1, k2, p1, p2, k3).

    ``max_radius`` is the distance from the axis, in undistorted normalised coordinates, where the radial polynomial
    stops growing; beyond it the model would fold the world back into the picture, so there is no image there.
    Infinite when it grows everywhere.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    max_radius: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.width_px <= 0 or self.height_px <= 0:
            message = f"a picture needs a positive size, not {self.width_px} x {self.height_px} pixels"
            raise ValueError(message)
        if not (0.0 < self.fx_px < math.inf and 0.0 < self.fy_px < math.inf):
            message = f"focal lengths must be positive and finite, not {self.fx_px}, {self.fy_px} pixels"
            raise ValueError(message)
        coefficients = [float(value) for value in self.distortion]
        if len(coefficients) != 5:
            message = f"distortion has five coefficients k1, k2, p1, p2, k3; {len(coefficients)} were given"
            raise ValueError(message)
        k1, k2, p1, p2, k3 = coefficients
        if not all(math.isfinite(value) for value in (self.cx_px, self.cy_px, *coefficients)):
            message = f"principal point and distortion must be finite: {self.cx_px}, {self.cy_px}, {coefficients}"
            raise ValueError(message)
        object.__setattr__(self, "distortion", (k1, k2, p1, p2, k3))
        object.__setattr__(self, "max_radius", _radius_of_growth(k1, k2, k3))

    @classmethod
    def from_hfov(cls, width_px: int, height_px: int, hfov_rad: float) -> Self:
        """An ideal camera with square pixels whose picture is ``hfov_rad`` wide, edge to edge."""
        if not 0.0 < hfov_rad < math.pi:
            message = f"a horizontal field of view lies between 0 and pi rad, not {hfov_rad}"
            raise ValueError(message)
        focal_px = 0.5 * width_px / math.tan(0.5 * hfov_rad)
        return cls(width_px, height_px, focal_px, focal_px, 0.5 * (width_px - 1), 0.5 * (height_px - 1))

    @property
    def matrix(self) -> Float:
        """The camera matrix K (3, 3)."""
        return np.array(((self.fx_px, 0.0, self.cx_px), (0.0, self.fy_px, self.cy_px), (0.0, 0.0, 1.0)))

    def project(self, points_camera_m: Float) -> Float:
        """Pixels (..., 2) of points (..., 3) in the camera frame; NaN behind the camera and beyond the lens."""
        points = np.asarray(points_camera_m, dtype=np.float64)
        depth = points[..., 2:]
        xy = points[..., :2] / np.where(depth > 0.0, depth, np.nan)
        return self.distort(xy) * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px)

    def rays(self, uv_px: Float) -> Float:
        """Unit vectors (..., 3) in the camera frame towards what the pixels (..., 2) show."""
        xy = self.undistort(uv_px)
        rays: Float = np.concatenate((xy, np.ones((*xy.shape[:-1], 1))), axis=-1)
        # A NaN coordinate makes the whole ray NaN through the length.
        rays /= np.sqrt(np.sum(rays * rays, axis=-1, keepdims=True))
        return rays

    def distort(self, xy: Float) -> Float:
        """Distorted normalised coordinates (..., 2) of ideal ones; NaN where the lens has no image."""
        points = np.asarray(xy, dtype=np.float64)
        if not any(self.distortion):
            return points.copy()
        distorted, growth = self._distort(points)
        r2 = np.sum(points * points, axis=-1)
        return np.where((self._seen(r2) & (_determinant(growth) > 0.0))[..., np.newaxis], distorted, np.nan)

    def undistort(self, uv_px: Float) -> Float:
        """Ideal normalised coordinates (..., 2) of pixels (..., 2), good to 1e-9; NaN where there are none.

        Two rounds of the usual fixed-point iteration, then Newton's with steps cut so that the misfit falls and the
        point stays on the near side of the fold.
        """
        uv = np.asarray(uv_px, dtype=np.float64)
        target = (uv - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px)
        if not any(self.distortion):
            return target
        flat = target.reshape(-1, 2)
        return self._undistort(flat).reshape(target.shape)

    def contains(self, uv_px: Float) -> NDArray[np.bool_]:
        """Whether pixels (..., 2) lie in the picture, its outermost half pixels included; False for NaN."""
        uv = np.asarray(uv_px, dtype=np.float64)
        u, v = uv[..., 0], uv[..., 1]
        inside: NDArray[np.bool_] = (u >= -0.5) & (u < self.width_px - 0.5) & (v >= -0.5) & (v < self.height_px - 0.5)
        return inside

    def scaled(self, factor: float) -> Self:
        """The camera of the same picture resized by ``factor``.

        The size is rounded to whole pixels and the intrinsics follow the rounded size, as resizing a picture does.
        """
        if not 0.0 < factor < math.inf:
            message = f"a picture is scaled by a positive, finite factor, not {factor}"
            raise ValueError(message)
        width_px, height_px = max(1, round(self.width_px * factor)), max(1, round(self.height_px * factor))
        across, down = width_px / self.width_px, height_px / self.height_px
        return type(self)(
            width_px,
            height_px,
            self.fx_px * across,
            self.fy_px * down,
            # Pixel centres are whole numbers, so the picture's edge, at -0.5, is what stays fixed.
            (self.cx_px + 0.5) * across - 0.5,
            (self.cy_px + 0.5) * down - 0.5,
            self.distortion,
        )

    def _seen(self, r2: Float) -> NDArray[np.bool_]:
        """Whether squared radii lie inside the radius of growth."""
        seen: NDArray[np.bool_] = r2 < self.max_radius * self.max_radius
        return seen

    def _distort(self, xy: Float) -> tuple[Float, tuple[Float, Float, Float]]:
        """Distorted coordinates and the entries (xx, xy, yy) of the symmetric Jacobian, without limits."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        # d(radial)/dx = slope * x, and likewise for y.
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3)))
        distorted = np.stack(
            (
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ),
            axis=-1,
        )
        growth = (
            radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y,
            radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        )
        return distorted, growth

    def _undistort(self, target: Float) -> Float:
        """Ideal coordinates (n, 2) of distorted ones (n, 2)."""
        k1, k2, _, _, k3 = self.distortion
        xy = self._inside(target)
        for _ in range(_FIXED_POINT_STEPS):
            r2 = np.sum(xy * xy, axis=-1, keepdims=True)
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            shift = self._distort(xy)[0] - xy * radial
            xy = self._inside((target - shift) / np.maximum(radial, 0.1))

        result = np.full_like(target, np.nan)
        todo = np.flatnonzero(np.all(np.isfinite(target), axis=-1))
        xy, target = xy[todo], target[todo]
        for _ in range(_NEWTON_STEPS):
            if not todo.size:
                break
            distorted, growth = self._distort(xy)
            misfit = target - distorted
            step = _solve(growth, misfit)
            xy_next = self._careful_step(xy, step, misfit, target)
            done = np.sqrt(np.sum(step * step, axis=-1)) < _UNDISTORT_TOLERANCE
            kept = done & self._seen(np.sum(xy_next * xy_next, axis=-1)) & (_determinant(growth) > 0.0)
            result[todo[kept]] = xy_next[kept]
            todo, xy, target = todo[~done], xy_next[~done], target[~done]
        return result

    def _inside(self, xy: Float) -> Float:
        """Points pulled radially to inside the radius of growth."""
        if math.isinf(self.max_radius):
            return xy
        radius = np.sqrt(np.sum(xy * xy, axis=-1, keepdims=True))
        limit = 0.98 * self.max_radius
        return np.where(radius > limit, xy * (limit / np.where(radius > 0.0, radius, 1.0)), xy)

    def _careful_step(self, xy: Float, step: Float, misfit: Float, target: Float) -> Float:
        """Points moved by the largest of step, step/2, step/4, ... that lowers the misfit and stays before the fold."""
        before = np.sum(misfit * misfit, axis=-1)
        fraction = np.ones(len(xy))
        moved = xy + step
        while True:
            distorted, _ = self._distort(moved)
            after = np.sum((target - distorted) ** 2, axis=-1)
            # Rounding alone decides at the solution, so misfits below the tolerance count as good.
            good = self._seen(np.sum(moved * moved, axis=-1)) & ((after < before) | (after < _UNDISTORT_TOLERANCE**2))
            again = ~good & (fraction > _SHORTEST_STEP)
            if not np.any(again):
                return moved
            fraction = np.where(again, 0.5 * fraction, fraction)
            moved = xy + fraction[:, np.newaxis] * step


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """How a camera sits on the vehicle: Euler angles (z-y-x) of the gimbal frame relative to the body.

    Pitch -90 degrees looks straight down, the top of the picture forward. ``lever_arm_frd_m`` (3,) leads from the
    vehicle's reference point to the camera, in body forward-right-down.
    """

    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    lever_arm_frd_m: Float = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        lever_arm = np.array(self.lever_arm_frd_m, dtype=np.float64)
        if lever_arm.shape != (3,):
            message = f"a lever arm has three components, forward, right, down; its shape here is {lever_arm.shape}"
            raise ValueError(message)
        if not np.all(np.isfinite((*lever_arm, self.roll_rad, self.pitch_rad, self.yaw_rad))):
            message = "a camera mount's angles and lever arm must be finite"
            raise ValueError(message)
        lever_arm.flags.writeable = False
        object.__setattr__(self, "lever_arm_frd_m", lever_arm)

    @property
    def body_from_gimbal(self) -> Float:
        """Rotation (3, 3) from the gimbal frame (x along the optical axis) to the body."""
        return matrix_from_euler(self.roll_rad, self.pitch_rad, self.yaw_rad)

    @property
    def body_from_camera(self) -> Float:
        """Rotation (3, 3) from the camera frame (z along the optical axis) to the body."""
        body_from_camera: Float = self.body_from_gimbal @ GIMBAL_FROM_CAMERA
        return body_from_camera


def _radius_of_growth(k1: float, k2: float, k3: float) -> float:
    """The smallest radius where r (1 + k1 r^2 + k2 r^4 + k3 r^6) has zero slope, else infinity."""
    squares = np.roots((7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0))
    real = squares[np.abs(squares.imag) < 1e-9 * np.abs(squares)].real
    return math.sqrt(float(np.min(real[real > 0.0], initial=np.inf)))


def _determinant(growth: tuple[Float, Float, Float]) -> Float:
    """Determinants (...) of symmetric matrices given as their entries xx, xy, yy."""
    xx, xy, yy = growth
    return xx * yy - xy * xy


def _solve(growth: tuple[Float, Float, Float], misfit: Float) -> Float:
    """Solutions (n, 2) of symmetric 2 x 2 systems; singular ones get a tiny pivot and so a step to be cut."""
    xx, xy, yy = growth
    determinant = _determinant(growth)
    determinant = np.where(np.abs(determinant) < 1e-12, 1e-12, determinant)
    a, b = misfit[..., 0], misfit[..., 1]
    return np.stack((yy * a - xy * b, xx * b - xy * a), axis=-1) / determinant[..., np.newaxis]
