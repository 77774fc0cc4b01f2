"""A pinhole camera with Brown-Conrady distortion, and how it is mounted.

Camera frame: x right, y down in the picture, z along the optical axis. Pixel (0, 0) is the centre of the top-left
pixel. The distortion is OpenCV's five-parameter model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator.geometry.earth import Float
from estimator.geometry.rotation import matrix_from_euler

# Newton's method squares the error, so a step of this length leaves one far below 1e-12.
_UNDISTORT_TOLERANCE: Final = 1e-10
_FAST_STEPS: Final = 6
_CAREFUL_STEPS: Final = 100
_SHORTEST_FRACTION: Final = 1e-6
_START_WITHIN: Final = 0.95

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

    def project(self, points_camera_m: ArrayLike) -> Float:
        """Pixels (..., 2) of points (..., 3) in the camera frame; NaN behind the camera and beyond the lens."""
        points = np.asarray(points_camera_m, dtype=np.float64)
        depth = points[..., 2:]
        xy = points[..., :2] / np.where(depth > 0.0, depth, np.nan)
        return self.distort(xy) * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px)

    def rays(self, uv_px: ArrayLike) -> Float:
        """Unit vectors (..., 3) in the camera frame towards what the pixels (..., 2) show."""
        xy = self.undistort(uv_px)
        rays: Float = np.concatenate((xy, np.ones((*xy.shape[:-1], 1))), axis=-1)
        # A NaN coordinate makes the whole ray NaN through the length.
        rays /= np.sqrt(np.sum(rays * rays, axis=-1, keepdims=True))
        return rays

    def distort(self, xy: ArrayLike) -> Float:
        """Distorted normalised coordinates (..., 2) of ideal ones; NaN where the lens has no image."""
        points = np.asarray(xy, dtype=np.float64)
        if not any(self.distortion):
            return points.copy()
        x, y = points[..., 0], points[..., 1]
        x_distorted, y_distorted, growth = self._distort(x, y)
        return _masked(x_distorted, y_distorted, self._seen(x, y, growth))

    def undistort(self, uv_px: ArrayLike) -> Float:
        """Ideal normalised coordinates (..., 2) of pixels (..., 2), good to 1e-9; NaN where there are none.

        A fixed-point step and Newton's method settle nearly all pixels of a usual lens; for the rest the steps are
        cut so that the misfit falls and the point stays on the near side of the fold.
        """
        uv = np.asarray(uv_px, dtype=np.float64)
        target = (uv - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px)
        if not any(self.distortion):
            return target
        flat = target.reshape(-1, 2)
        xy = self._undistort_fast(flat[:, 0], flat[:, 1])
        left = np.isnan(xy[:, 0]) & np.all(np.isfinite(flat), axis=-1)
        if np.any(left):
            xy[left] = self._undistort_carefully(flat[left, 0], flat[left, 1])
        return xy.reshape(target.shape)

    def contains(self, uv_px: ArrayLike) -> NDArray[np.bool_]:
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

    def _distort(self, x: Float, y: Float) -> tuple[Float, Float, Growth]:
        """Distorted coordinates (n,) and their Jacobian, without limits."""
        k1, k2, p1, p2, k3 = self.distortion
        xx, yy = x * x, y * y
        r2 = xx + yy
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        # d(radial)/dx = slope * x, and likewise for y.
        slope = 2.0 * k1 + r2 * (4.0 * k2 + r2 * (6.0 * k3))
        slope_xy = slope * x * y
        x_distorted = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * xx)
        y_distorted = y * radial + p1 * (r2 + 2.0 * yy) + 2.0 * p2 * x * y
        growth = Growth(
            radial + slope * xx + 2.0 * p1 * y + 6.0 * p2 * x,
            slope_xy + 2.0 * p1 * x + 2.0 * p2 * y,
            radial + slope * yy + 6.0 * p1 * y + 2.0 * p2 * x,
        )
        return x_distorted, y_distorted, growth

    def _seen(self, x: Float, y: Float, growth: Growth) -> NDArray[np.bool_]:
        """Whether ideal points (n,) lie where the lens' model grows."""
        seen: NDArray[np.bool_] = (x * x + y * y < self.max_radius * self.max_radius) & (growth.determinant > 0.0)
        return seen

    def _undistort_fast(self, x_target: Float, y_target: Float) -> Float:
        """Ideal coordinates (n, 2) by a fixed-point step and Newton's method; NaN where that did not settle."""
        x_start, y_start, _ = self._distort(x_target, y_target)
        x, y = self._inside(2.0 * x_target - x_start, 2.0 * y_target - y_start)
        for _ in range(_FAST_STEPS):
            x_distorted, y_distorted, growth = self._distort(x, y)
            x_step, y_step = growth.solve(x_target - x_distorted, y_target - y_distorted)
            x, y = x + x_step, y + y_step
            settled = x_step * x_step + y_step * y_step < _UNDISTORT_TOLERANCE**2
            if np.all(settled):
                break
        return _masked(x, y, settled & self._seen(x, y, growth))

    def _undistort_carefully(self, x_target: Float, y_target: Float) -> Float:
        """Ideal coordinates (n, 2) by Newton's method, each step halved until the misfit falls before the fold."""
        x, y = self._inside(0.5 * x_target, 0.5 * y_target)
        x_distorted, y_distorted, growth = self._distort(x, y)
        x_miss, y_miss = x_target - x_distorted, y_target - y_distorted
        fraction = np.ones_like(x)
        settled = np.zeros(x.shape, dtype=np.bool_)
        for _ in range(_CAREFUL_STEPS):
            x_step, y_step = growth.solve(x_miss, y_miss)
            x_next, y_next = x + fraction * x_step, y + fraction * y_step
            x_distorted, y_distorted, growth_next = self._distort(x_next, y_next)
            x_miss_next, y_miss_next = x_target - x_distorted, y_target - y_distorted
            before, after = x_miss**2 + y_miss**2, x_miss_next**2 + y_miss_next**2
            # At the solution rounding alone decides which misfit is less.
            better = self._seen(x_next, y_next, growth_next) & ((after < before) | (after < _UNDISTORT_TOLERANCE**2))
            settled |= better & (fraction == 1.0) & (x_step**2 + y_step**2 < _UNDISTORT_TOLERANCE**2)
            if np.all(settled | (fraction < _SHORTEST_FRACTION)):
                break
            fraction = np.where(better, 1.0, 0.5 * fraction)
            x, y = np.where(better, x_next, x), np.where(better, y_next, y)
            x_miss, y_miss = np.where(better, x_miss_next, x_miss), np.where(better, y_miss_next, y_miss)
            growth = growth_next.where(better, growth)
        return _masked(x, y, settled)

    def _inside(self, x: Float, y: Float) -> tuple[Float, Float]:
        """Points (n,) pulled towards the axis to inside the radius of growth."""
        if math.isinf(self.max_radius):
            return x, y
        limit = _START_WITHIN * self.max_radius
        shrink = limit / np.maximum(np.hypot(x, y), limit)
        return x * shrink, y * shrink


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """Jacobian of the distortion: the entries (n,) of a symmetric matrix."""

    xx: Float
    xy: Float
    yy: Float

    @property
    def determinant(self) -> Float:
        """Change of area (n,); not positive where the picture folds over."""
        return self.xx * self.yy - self.xy * self.xy

    def solve(self, a: Float, b: Float) -> tuple[Float, Float]:
        """Steps (n,) that change the distorted coordinates by (a, b); huge where the matrix is singular."""
        determinant = self.determinant
        determinant = np.where(np.abs(determinant) < 1e-12, 1e-12, determinant)
        return (self.yy * a - self.xy * b) / determinant, (self.xx * b - self.xy * a) / determinant

    def where(self, condition: NDArray[np.bool_], other: Growth) -> Growth:
        """These entries where the condition holds, the other's elsewhere."""
        return Growth(
            np.where(condition, self.xx, other.xx),
            np.where(condition, self.xy, other.xy),
            np.where(condition, self.yy, other.yy),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """How a camera sits on the vehicle: Euler angles (z-y-x) of the gimbal frame relative to the body.

    Pitch -90 degrees, the default, looks straight down, the top of the picture forward. ``lever_arm_frd_m`` (3,)
    leads from the vehicle's reference point to the camera, in body forward-right-down.
    """

    roll_rad: float = 0.0
    pitch_rad: float = -math.pi / 2
    yaw_rad: float = 0.0
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
    # In 1 / r^2 the polynomial's leading coefficient is 1, whichever of the k are zero or next to it.
    inverse = np.roots((1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3))
    real = inverse[np.abs(inverse.imag) < 1e-9 * np.abs(inverse)].real
    largest = float(np.max(real, initial=0.0))
    return 1.0 / math.sqrt(largest) if largest > 0.0 else math.inf


def _masked(x: Float, y: Float, keep: NDArray[np.bool_]) -> Float:
    """Points (n, 2), NaN where not kept."""
    return np.stack((np.where(keep, x, np.nan), np.where(keep, y, np.nan)), axis=-1)
