"""A target from many lines of sight, with what the views have in common as states.

The second method of Conte's thesis (2009, section 7.2, "line-of-sight filtering", after Madison et al., IEEE Aerospace
2008): rays from many poses meet in the target, and need no ground to be cut with. A consumer unit's attitude is wrong
by degrees that stay the same, and its position by metres that do, so that the rays miss the target together, each to
its own side as the aircraft turns. Both errors are states: nine in all, the place (3), the turn of the body (3) and
the displacement (3). Everything is solved again with each view (Gauss-Newton, a few steps from the last answer), so
that early views are seen with what later ones have told of the biases.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.errors import GeometryError
from estimator.geometry.rotation import matrix_from_q, q_from_matrix, q_from_rotvec, rotvec_from_q, skew
from estimator.types import Float

STEP_END = 1e-4
MIN_AHEAD_M = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One sighting: the reported lens (3,) and rotations (3, 3), and the pixel's ray (3,) in the camera, any length."""

    lens_ned_m: Float
    ned_from_body: Float
    body_from_camera: Float
    ray_camera: Float


@dataclass(frozen=True, slots=True)
class LineOfSightConfig:
    """Standard deviations of what is constant over the views, and of what is new in each.

    ``attitude_bias_rad`` and ``position_bias_m`` are about each axis, forward, right, down and north, east, down.
    ``view_std_rad`` is of one ray: click, and attitude noise; ``view_std_m`` of one position. ``nu`` are the degrees of
    freedom of Student's t.
    """

    attitude_bias_rad: tuple[float, float, float] = (0.0524, 0.0524, 0.0524)
    position_bias_m: tuple[float, float, float] = (2.0, 2.0, 3.0)
    view_std_rad: float = 0.018
    view_std_m: float = 0.7
    nu: float = 4.0
    iterations: int = 30

    def __post_init__(self) -> None:
        std = (*self.attitude_bias_rad, *self.position_bias_m, self.view_std_rad, self.nu)
        if not (all(np.isfinite(std)) and min(std) > 0.0 and self.view_std_m >= 0.0 and self.iterations >= 1):
            message = f"standard deviations must be positive and finite, iterations at least 1: {self}"
            raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class SightedTarget:
    """The place (3,) with its covariance (3, 3), and the biases found, each with its covariance (3, 3).

    ``attitude_bias_rad`` is the turn of the body, R_true = R_reported Exp(bias); ``position_bias_m`` is true less
    reported, NED.
    """

    pos_ned_m: Float
    cov_ned_m2: Float
    attitude_bias_rad: Float
    cov_attitude_bias_rad2: Float
    position_bias_m: Float
    cov_position_bias_m2: Float


class LineOfSightFilter:
    """Views of one target. ``prior_ned_m`` (3,) with ``prior_cov_m2`` (3, 3) is where the first ray meets the ground.

    Its horizontal variance should be wide; the vertical is what is known of the ground's height, which is what makes
    few views from one side determine the place at all.
    """

    def __init__(self, prior_ned_m: Float, prior_cov_m2: Float, config: LineOfSightConfig | None = None) -> None:
        self.config = config or LineOfSightConfig()
        self._prior = np.concatenate((prior_ned_m, np.zeros(6)))
        std = np.array([*self.config.attitude_bias_rad, *self.config.position_bias_m])
        self._information = np.zeros((9, 9))
        self._information[:3, :3] = np.linalg.inv(prior_cov_m2)
        self._information[3:, 3:] = np.diag(std**-2.0)
        self._views: list[View] = []
        self._x = self._prior.copy()

    def add(self, *views: View) -> SightedTarget:
        """Take in views; where the target is now.

        Raises
        ------
        GeometryError
            The target would lie behind a camera.
        """
        self._views.extend(views)
        x, information = self._x, self._information
        for _ in range(self.config.iterations):
            step, information = self._step(x)
            x = x + step
            # the turn is composed, not added
            turn = matrix_from_q(q_from_rotvec(x[3:6] - step[3:6])) @ matrix_from_q(q_from_rotvec(step[3:6]))
            x[3:6] = rotvec_from_q(q_from_matrix(turn))
            if float(np.linalg.norm(step[:3])) < STEP_END:
                break
        self._x = x
        cov = np.linalg.inv(information)
        cov = 0.5 * (cov + cov.T)
        return SightedTarget(x[:3].copy(), cov[:3, :3], x[3:6].copy(), cov[3:6, 3:6], x[6:].copy(), cov[6:, 6:])

    def _step(self, x: Float) -> tuple[Float, Float]:
        information = self._information.copy()
        gradient = information @ (self._prior - x)
        turn = matrix_from_q(q_from_rotvec(x[3:6]))
        for residual, H, var in (self._look(view, x, turn) for view in self._views):
            d2 = float(residual @ residual) / var
            weight = min((self.config.nu + 2.0) / (self.config.nu + d2), 1.0) / var
            information += weight * H.T @ H
            gradient += weight * H.T @ residual
        return np.asarray(np.linalg.solve(information, gradient), dtype=np.float64), information

    def _look(self, view: View, x: Float, turn: Float) -> tuple[Float, Float, float]:
        """Residual (2,) across the line of sight in radians, its Jacobian (2, 9) by the state, and its variance."""
        to = x[:3] - view.lens_ned_m - x[6:]
        in_body = turn.T @ (view.ned_from_body.T @ to)
        seen = view.body_from_camera.T @ in_body
        ray = view.ray_camera / np.linalg.norm(view.ray_camera)
        range_m = float(np.linalg.norm(seen))
        if float(seen @ ray) < MIN_AHEAD_M:
            message = "the views do not see one target: it would lie behind a camera"
            raise GeometryError(message)
        across = np.linalg.svd(ray[None])[2][1:]
        by_seen = across / float(seen @ ray)
        residual = -by_seen @ seen
        by_place = view.body_from_camera.T @ turn.T @ view.ned_from_body.T
        by_turn = view.body_from_camera.T @ skew(in_body)
        flat = by_seen - np.outer(by_seen @ seen, ray) / float(seen @ ray)
        H = flat @ np.hstack((by_place, by_turn, -by_place))
        return residual, H, self.config.view_std_rad**2 + (self.config.view_std_m / range_m) ** 2
