"""A linear plant around its trim, and a reference model that an output shall follow. Pure.

Kaiser's thesis (2008), chapter 3: x' = A x + B u + f, y = C x (3-1, 3-2), with as many outputs as inputs, and
x_m' = A_m x_m + B_m d, y_m = C_m x_m (3-12, 3-13) for a command d. The numbers are those of pages 32 and 33.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from scipy.linalg import expm

from estimator.geometry.checks import check_step
from estimator.types import Float

_LONGEST_STEP_S = 0.1
_DEG_PER_RAD = 180.0 / math.pi


@dataclass(frozen=True, slots=True, eq=False)
class LinearPlant:
    """A (n, n), B (n, m), C (m, n); deviations from trim in SI units and radians.

    Raises
    ------
    ValueError
        The shapes do not belong together, a number is not finite, or C B cannot be inverted.
    """

    a: Float
    b: Float
    c: Float

    def __post_init__(self) -> None:
        for one in fields(self):
            matrix = np.array(getattr(self, one.name), np.float64)
            if matrix.ndim != 2 or not np.all(np.isfinite(matrix)):
                message = f"{one.name} must be a matrix of finite numbers, not {matrix}"
                raise ValueError(message)
            matrix.setflags(write=False)
            object.__setattr__(self, one.name, matrix)
        n, m = self.b.shape
        if self.a.shape != (n, n) or self.c.shape != (m, n):
            message = f"shapes {self.a.shape}, {self.b.shape}, {self.c.shape} are not (n, n), (n, m), (m, n)"
            raise ValueError(message)
        if np.linalg.matrix_rank(self.c @ self.b) < m:
            message = "C B must have an inverse: an output that no input moves at once cannot be inverted"
            raise ValueError(message)

    @property
    def input_matrix(self) -> Float:
        """Omega = C B (m, m), (3-23)."""
        omega: Float = self.c @ self.b
        return omega


OSPREY_LONGITUDINAL = LinearPlant(
    a=np.array(((-0.15, 11.08, 0.08, -9.81), (-0.03, -7.17, 0.83, 0), (0, -37.35, -9.96, 0), (0, 0, 1, 0))),
    b=np.array(((3e-3 * _DEG_PER_RAD, 0.06), (1e-5 * _DEG_PER_RAD, 1e-4), (0.98 * _DEG_PER_RAD, 0), (0, 0))),
    c=np.array(((0.0, 0, 1, 0), (1, 0, 0, 0))),
)
"""V, alpha, q, theta from elevator and thrust; out come q and V. (2-13) with its print's degrees as radians."""

OSPREY_LATERAL = LinearPlant(
    a=np.array(
        ((-0.69, -0.03, -0.99, 0.39), (-3.13, -12.92, 1.10, 0), (17.03, -0.10, -0.97, 0), (0, 1, -0.03, 0))
    ),
    b=_DEG_PER_RAD * np.array(((0, 0), (1.50, -0.02), (-0.09, 0.17), (0, 0))),
    c=np.array(((0.0, 1, 0, 0), (0, 0, 1, 0))),
)  # fmt: skip
"""beta, p, r, phi from aileron and rudder; out come p and r. (2-14)."""

PUBLISHED_INPUT_LONGITUDINAL: Float = np.array(((1.4 * _DEG_PER_RAD, 0.0), (0.01 * _DEG_PER_RAD, 0.1)))
PUBLISHED_INPUT_LATERAL: Float = _DEG_PER_RAD * np.array(((1.7, -0.05), (-0.1, 0.25)))
"""The constant estimates of Omega on page 34, off by 11 to 67 %."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceModel:
    """Two states for each of m outputs: ``pairs`` (m, 2, 2), the first of each is the output, driven by ``drive`` (m,).

    Raises
    ------
    ValueError
        A number is not finite, a pair is not stable, or its output does not settle at a multiple of the command.
    """

    pairs: Float
    drive: Float

    def __post_init__(self) -> None:
        pairs, drive = np.array(self.pairs, np.float64), np.array(self.drive, np.float64)
        if pairs.shape != (len(drive), 2, 2) or not (np.all(np.isfinite(pairs)) and np.all(np.isfinite(drive))):
            message = f"pairs and drive must be finite, (m, 2, 2) and (m,), not {pairs.shape} and {drive.shape}"
            raise ValueError(message)
        if float(np.linalg.eigvals(pairs).real.max()) >= 0.0:
            message = "the reference model is not stable"
            raise ValueError(message)
        if not np.all(drive * np.linalg.inv(pairs)[:, 0, 0] < 0.0):
            message = "an output of the reference model does not settle on the side of its command"
            raise ValueError(message)
        object.__setattr__(self, "pairs", pairs)
        object.__setattr__(self, "drive", drive)


PUBLISHED_REFERENCE = ReferenceModel(
    pairs=np.array((((-4.0, -600.0), (0.1, -10.0)), ((0.6, -1.1), (2.0, -2.2)))), drive=np.array((10.0, 0.5))
)
"""Page 32: the pair of pitch or roll rate (10 rad/s, 0.7), then that of velocity or yaw rate (0.94 rad/s, 0.85)."""


class Reference:
    """A reference model in time, exact for commands that are held over a step.

    Commands are scaled so that outputs settle at them: as printed, the second pair settles at 1.25 times the command.
    """

    def __init__(self, model: ReferenceModel) -> None:
        m = len(model.drive)
        self._a: Float = np.zeros((2 * m, 2 * m))
        self._b: Float = np.zeros((2 * m, m))
        for k, pair in enumerate(model.pairs):
            self._a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = pair
            settles = -model.drive[k] * np.linalg.inv(pair)[0, 0]
            self._b[2 * k, k] = model.drive[k] / settles
        self._x: Float = np.zeros(2 * m)
        self._dt_s = 0.0
        self._over: Float = np.zeros((0, 0))

    def step(self, dt_s: float, command: Float) -> None:
        """Go on by ``dt_s`` with a command (m,).

        Raises
        ------
        ValueError
            ``dt_s`` is not above 0 and at most 0.1 s, or the command is not m finite numbers.
        """
        check_step(dt_s, _LONGEST_STEP_S)
        if command.shape != (self._b.shape[1],) or not np.all(np.isfinite(command)):
            message = f"the command must be {self._b.shape[1]} finite numbers, not {command}"
            raise ValueError(message)
        if dt_s != self._dt_s:
            n, m = self._b.shape
            whole = np.zeros((n + m, n + m))
            whole[:n, :n], whole[:n, n:] = self._a, self._b
            self._dt_s, self._over = dt_s, expm(whole * dt_s)[:n]
        self._x = self._over @ np.concatenate((self._x, command))

    @property
    def output(self) -> Float:
        """y_m (m,)."""
        return self._x[::2].copy()

    def output_rate(self, command: Float) -> Float:
        """The derivative of y_m (m,) under a command (m,)."""
        rate: Float = (self._a @ self._x + self._b @ command)[::2]
        return rate
