"""Rotations: Hamilton quaternions [w, x, y, z], matrices, Euler angles and rotation vectors.

A quaternion ``q_a_from_b`` and the matrix ``a_from_b`` turn coordinates in b into coordinates in a. Euler angles are
roll, pitch, yaw of the body in the z-y-x order of aviation. A rotation vector is the axis times the angle in radians.
Everything is vectorised over leading axes; NaN in gives NaN out.

Filters call some of these on single vectors thousands of times a second, where an array expression costs ten times the
arithmetic; those functions have a path of plain floats.
"""

from __future__ import annotations

import math
from typing import Final, overload

import numpy as np
from numpy.typing import ArrayLike

from estimator.geometry.earth import Float

# Below this angle the series of sin(x)/x is exact to rounding with two terms.
_SMALL_RAD: Final = 1e-4
# Cosine of the pitch below which roll and yaw turn about one axis, as far as rounding lets us tell.
_LOCKED_COS_PITCH: Final = 1e-8


Quaternion = tuple[float, float, float, float]


def quaternion_product(a: Quaternion, b: Quaternion) -> Quaternion:
    """``q_multiply`` of two quaternions in plain numbers, for code that builds no arrays on its way."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def quaternion_exponential(x_rad: float, y_rad: float, z_rad: float) -> Quaternion:
    """``q_from_rotvec`` in plain numbers."""
    angle = math.sqrt(x_rad * x_rad + y_rad * y_rad + z_rad * z_rad)
    if angle < _SMALL_RAD:
        scale = 0.5 - angle * angle / 48.0
        return 1.0 - angle * angle / 8.0, scale * x_rad, scale * y_rad, scale * z_rad
    if not math.isfinite(angle):
        return math.nan, math.nan, math.nan, math.nan
    scale = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), scale * x_rad, scale * y_rad, scale * z_rad


def q_multiply(a: Float, b: Float) -> Float:
    """Hamilton product (..., 4): the rotation ``b`` followed by ``a``, q_a_from_c = q_a_from_b * q_b_from_c."""
    if a.ndim == 1 and b.ndim == 1:
        return np.array(quaternion_product(tuple(a.tolist()), tuple(b.tolist())))
    w0, x0, y0, z0 = _components(a)
    w1, x1, y1, z1 = _components(b)
    return np.stack(
        (
            w0 * w1 - x0 * x1 - y0 * y1 - z0 * z1,
            w0 * x1 + x0 * w1 + y0 * z1 - z0 * y1,
            w0 * y1 - x0 * z1 + y0 * w1 + z0 * x1,
            w0 * z1 + x0 * y1 - y0 * x1 + z0 * w1,
        ),
        axis=-1,
    )


def q_conjugate(q: Float) -> Float:
    """The inverse of a unit quaternion (..., 4)."""
    conjugate = -q
    conjugate[..., 0] = q[..., 0]
    return conjugate


def q_normalise(q: Float) -> Float:
    """The quaternion (..., 4) scaled to unit length, sign kept; NaN for a zero quaternion."""
    if q.ndim == 1:
        w, x, y, z = q.tolist()
        length = math.sqrt(w * w + x * x + y * y + z * z)
        return q / length if length > 0.0 else np.full(4, np.nan)
    lengths = np.sqrt(np.sum(q * q, axis=-1, keepdims=True))
    return q / np.where(lengths > 0.0, lengths, np.nan)


def matrix_from_q(q: Float) -> Float:
    """Rotation matrix (..., 3, 3) of a unit quaternion (..., 4)."""
    if q.ndim == 1:
        w, x, y, z = q.tolist()
        xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
        xy, xz, yz = 2.0 * x * y, 2.0 * x * z, 2.0 * y * z
        wx, wy, wz = 2.0 * w * x, 2.0 * w * y, 2.0 * w * z
        return np.array(
            (
                (1.0 - yy - zz, xy - wz, xz + wy),
                (xy + wz, 1.0 - xx - zz, yz - wx),
                (xz - wy, yz + wx, 1.0 - xx - yy),
            )
        )
    w_, x_, y_, z_ = _components(q)
    matrix = np.empty((*q.shape[:-1], 3, 3))
    matrix[..., 0, 0] = 1.0 - 2.0 * (y_ * y_ + z_ * z_)
    matrix[..., 0, 1] = 2.0 * (x_ * y_ - w_ * z_)
    matrix[..., 0, 2] = 2.0 * (x_ * z_ + w_ * y_)
    matrix[..., 1, 0] = 2.0 * (x_ * y_ + w_ * z_)
    matrix[..., 1, 1] = 1.0 - 2.0 * (x_ * x_ + z_ * z_)
    matrix[..., 1, 2] = 2.0 * (y_ * z_ - w_ * x_)
    matrix[..., 2, 0] = 2.0 * (x_ * z_ - w_ * y_)
    matrix[..., 2, 1] = 2.0 * (y_ * z_ + w_ * x_)
    matrix[..., 2, 2] = 1.0 - 2.0 * (x_ * x_ + y_ * y_)
    return matrix


def q_from_matrix(matrix: Float) -> Float:
    """Unit quaternion (..., 4) with w >= 0 of a rotation matrix (..., 3, 3).

    Shepperd's method (J. Guidance and Control 1, 1978): of four equal expressions the best conditioned is taken.
    """
    m = np.asarray(matrix, dtype=np.float64)
    m00, m11, m22 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, xw = m[..., 2, 1] - m[..., 1, 2], m[..., 2, 1] + m[..., 1, 2]
    wy, yw = m[..., 0, 2] - m[..., 2, 0], m[..., 0, 2] + m[..., 2, 0]
    wz, zw = m[..., 1, 0] - m[..., 0, 1], m[..., 1, 0] + m[..., 0, 1]
    # Row i is 4 q_i q; its own entry is 4 q_i^2, so the row with the largest diagonal is the safest to normalise.
    rows = np.stack(
        (
            np.stack((1.0 + m00 + m11 + m22, wx, wy, wz), axis=-1),
            np.stack((wx, 1.0 + m00 - m11 - m22, zw, yw), axis=-1),
            np.stack((wy, zw, 1.0 - m00 + m11 - m22, xw), axis=-1),
            np.stack((wz, yw, xw, 1.0 - m00 - m11 + m22), axis=-1),
        ),
        axis=-2,
    )
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(rows, best[..., np.newaxis, np.newaxis], axis=-2)[..., 0, :]
    return q_normalise(np.where(row[..., :1] < 0.0, -row, row))


def q_from_euler(roll_rad: ArrayLike, pitch_rad: ArrayLike, yaw_rad: ArrayLike) -> Float:
    """Quaternion (..., 4) ned_from_body of roll, pitch and yaw; the inputs broadcast."""
    half_roll = 0.5 * np.asarray(roll_rad, dtype=np.float64)
    half_pitch = 0.5 * np.asarray(pitch_rad, dtype=np.float64)
    half_yaw = 0.5 * np.asarray(yaw_rad, dtype=np.float64)
    cr, sr = np.cos(half_roll), np.sin(half_roll)
    cp, sp = np.cos(half_pitch), np.sin(half_pitch)
    cy, sy = np.cos(half_yaw), np.sin(half_yaw)
    return np.stack(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ),
        axis=-1,
    )


def euler_from_q(q: Float) -> tuple[Float, Float, Float]:
    """Roll, pitch and yaw (...) of a unit quaternion (..., 4); pitch in [-pi/2, pi/2].

    Straight up or down, where roll and yaw turn about the same axis, roll is 0 and yaw takes the whole turn.
    """
    w, x, y, z = _components(np.asarray(q, dtype=np.float64))
    # Sums of squares rather than 1 - 2 (...): a cosine near 0 then keeps its digits.
    m00, m10, m20 = w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    m01, m11 = 2.0 * (x * y - w * z), w * w - x * x + y * y - z * z
    m21, m22 = 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z
    cos_pitch = np.hypot(m00, m10)
    locked = cos_pitch < _LOCKED_COS_PITCH
    roll = np.where(locked, 0.0, np.arctan2(m21, m22))
    pitch = np.arctan2(-m20, cos_pitch)
    yaw = np.where(locked, np.arctan2(-m01, m11), np.arctan2(m10, m00))
    return roll, pitch, yaw


def matrix_from_euler(roll_rad: ArrayLike, pitch_rad: ArrayLike, yaw_rad: ArrayLike) -> Float:
    """Rotation matrix (..., 3, 3) ned_from_body of roll, pitch and yaw; the inputs broadcast."""
    return matrix_from_q(q_from_euler(roll_rad, pitch_rad, yaw_rad))


def q_from_rotvec(v: Float) -> Float:
    """Unit quaternion (..., 4) of a rotation vector (..., 3): the exponential map."""
    if v.ndim == 1:
        return np.array(quaternion_exponential(*v.tolist()))
    angles = np.sqrt(np.sum(v * v, axis=-1, keepdims=True))
    small = angles < _SMALL_RAD
    safe = np.where(small, 1.0, angles)
    scales = np.where(small, 0.5 - angles * angles / 48.0, np.sin(0.5 * safe) / safe)
    return np.concatenate((np.cos(0.5 * angles), scales * v), axis=-1)


def rotvec_from_q(q: Float) -> Float:
    """Rotation vector (..., 3), at most pi long, of a unit quaternion (..., 4): the logarithmic map."""
    if q.ndim == 1:
        return _rotvec_from_one_q(q)
    # q and -q are the same rotation; w >= 0 is the short way.
    quaternion = np.where(q[..., :1] < 0.0, -q, q)
    w, vector = quaternion[..., :1], quaternion[..., 1:]
    sine = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    small = sine < _SMALL_RAD
    safe = np.where(small, 1.0, sine)
    # Series of 2 atan(s / w) / s about s = 0.
    near = 2.0 / np.where(small, w, 1.0) * (1.0 - sine * sine / (3.0 * np.where(small, w * w, 1.0)))
    rotvec: Float = vector * np.where(small, near, 2.0 * np.arctan2(sine, w) / safe)
    return rotvec


def _rotvec_from_one_q(q: Float) -> Float:
    w, x, y, z = q.tolist()
    sine = math.sqrt(x * x + y * y + z * z)
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    if sine < _SMALL_RAD:
        scale = 2.0 / w * (1.0 - sine * sine / (3.0 * w * w)) if w > 0.0 else math.nan
    else:
        scale = 2.0 * math.atan2(sine, w) / sine
    return np.array((scale * x, scale * y, scale * z))


def skew(v: Float) -> Float:
    """Cross-product matrix (..., 3, 3): ``skew(v) @ u`` is v x u."""
    if v.ndim == 1:
        x, y, z = v.tolist()
        return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    matrix = np.zeros((*v.shape[:-1], 3, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -v[..., 2], v[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = v[..., 2], -v[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -v[..., 1], v[..., 0]
    return matrix


def q_slerp(a: Float, b: Float, t: float | Float) -> Float:
    """Rotation (..., 4) a fraction ``t`` (...) of the short way from ``a`` to ``b``; extrapolates outside [0, 1]."""
    turn = rotvec_from_q(q_multiply(q_conjugate(a), b))
    return q_multiply(a, q_from_rotvec(np.asarray(t, dtype=np.float64)[..., np.newaxis] * turn))


@overload
def wrap_pi(x: float) -> float: ...
@overload
def wrap_pi(x: Float) -> Float: ...
def wrap_pi(x: float | Float) -> float | Float:
    """The same angle in (-pi, pi]."""
    if isinstance(x, float):
        return x - math.tau * math.ceil((x - math.pi) / math.tau) if math.isfinite(x) else math.nan
    wrapped: Float = x - math.tau * np.ceil((x - math.pi) / math.tau)
    return wrapped


def _components(q: Float) -> tuple[Float, Float, Float, Float]:
    return q[..., 0], q[..., 1], q[..., 2], q[..., 3]
