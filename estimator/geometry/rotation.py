"""Quaternions (Hamilton, [w, x, y, z]), rotation matrices, Euler angles (z-y-x) and rotation vectors.

Sola, Quaternion kinematics for the error-state Kalman filter, 2017. Single vectors take a scalar path: NumPy's
broadcasting costs ten times the arithmetic there, and the filters live on it.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike

from estimator.geometry.earth import Float


def skew(v: Float) -> Float:
    """Cross-product matrix (..., 3, 3) of vectors (..., 3): skew(a) @ b = a x b."""
    if v.ndim == 1:
        x, y, z = v
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


def q_multiply(a: Float, b: Float) -> Float:
    """Product of quaternions (..., 4): first b, then a."""
    if a.ndim == 1 and b.ndim == 1:
        aw, ax, ay, az = a.tolist()
        bw, bx, by, bz = b.tolist()
        return np.array(
            [
                aw * bw - ax * bx - ay * by - az * bz,
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
            ]
        )
    aw, av = a[..., :1], a[..., 1:]
    bw, bv = b[..., :1], b[..., 1:]
    w = aw * bw - (av * bv).sum(axis=-1, keepdims=True)
    return np.concatenate((w, aw * bv + bw * av + np.cross(av, bv)), axis=-1)


def q_conjugate(q: Float) -> Float:
    """Inverse of unit quaternions (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def q_normalise(q: Float) -> Float:
    """Unit quaternions (..., 4)."""
    if q.ndim == 1:
        out: Float = q / sqrt(float(q @ q))
        return out
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def matrix_from_q(q: Float) -> Float:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    if q.ndim == 1:
        w, x, y, z = q.tolist()
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def q_from_matrix(matrix: Float) -> Float:
    """Unit quaternions (..., 4), w not negative, of rotation matrices (..., 3, 3).

    Shepperd's choice of the largest component, so that no angle is special.
    """
    m = np.asarray(matrix, dtype=np.float64)
    trace = np.einsum("...ii->...", m)
    diagonal = np.einsum("...ii->...i", m)
    squares = np.concatenate(((1.0 + trace)[..., None], 1.0 + 2.0 * diagonal - trace[..., None]), axis=-1)
    a = m[..., 2, 1] - m[..., 1, 2]
    b = m[..., 0, 2] - m[..., 2, 0]
    c = m[..., 1, 0] - m[..., 0, 1]
    d = m[..., 1, 0] + m[..., 0, 1]
    e = m[..., 0, 2] + m[..., 2, 0]
    f = m[..., 2, 1] + m[..., 1, 2]
    candidates = np.stack(
        [
            np.stack((squares[..., 0], a, b, c), axis=-1),
            np.stack((a, squares[..., 1], d, e), axis=-1),
            np.stack((b, d, squares[..., 2], f), axis=-1),
            np.stack((c, e, f, squares[..., 3]), axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.nan_to_num(squares), axis=-1)
    q = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., :1] < 0.0, -q, q))


def matrix_from_euler(roll_rad: ArrayLike, pitch_rad: ArrayLike, yaw_rad: ArrayLike) -> Float:
    """Rotation (..., 3, 3) from body to NED: yaw about down, then pitch, then roll."""
    return matrix_from_q(q_from_euler(roll_rad, pitch_rad, yaw_rad))


def q_from_euler(roll_rad: ArrayLike, pitch_rad: ArrayLike, yaw_rad: ArrayLike) -> Float:
    """Quaternion (..., 4) NED from body of roll, pitch and yaw."""
    half = [0.5 * np.asarray(x, dtype=np.float64) for x in (roll_rad, pitch_rad, yaw_rad)]
    (cr, cp, cy), (sr, sp, sy) = [np.cos(x) for x in half], [np.sin(x) for x in half]
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
    """Roll, pitch and yaw (radians) of quaternions (..., 4) NED from body."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=np.float64), -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw


def q_from_rotvec(v: Float) -> Float:
    """Quaternion (..., 4) of rotation vectors (..., 3)."""
    if v.ndim == 1:
        x, y, z = v.tolist()
        angle = sqrt(x * x + y * y + z * z)
        # the series keeps full precision where sin(x)/x would lose it
        scale = sin(0.5 * angle) / angle if angle > 1e-6 else 0.5 - angle * angle / 48.0
        return np.array([cos(0.5 * angle), x * scale, y * scale, z * scale])
    angles = np.linalg.norm(v, axis=-1, keepdims=True)
    scale = 0.5 * np.sinc(angles / (2.0 * np.pi))
    return np.concatenate((np.cos(0.5 * angles), v * scale), axis=-1)


def rotvec_from_q(q: Float) -> Float:
    """Rotation vectors (..., 3), not longer than pi, of quaternions (..., 4)."""
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    scale = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-12), 2.0)
    out: Float = q[..., 1:] * scale
    return out


def q_slerp(a: Float, b: Float, t: float) -> Float:
    """Quaternion (4,) at share ``t`` of the shorter way from a to b; beyond [0, 1] it goes on at the same rate."""
    return q_normalise(q_multiply(q_from_rotvec(t * rotvec_from_q(q_multiply(b, q_conjugate(a)))), a))


def wrap_pi(angle_rad: ArrayLike) -> Float:
    """Angles in [-pi, pi)."""
    out: Float = (np.asarray(angle_rad, dtype=np.float64) + np.pi) % (2.0 * np.pi) - np.pi
    return out
