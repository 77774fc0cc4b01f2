import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from estimator.errors import GeometryError
from estimator.targets.line_of_sight import LineOfSightConfig, LineOfSightFilter, View

TRUE = np.array([20.0, -10.0, 2.0])
MOUNT = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
PRIOR_COV = np.diag([900.0, 900.0, 4.0])


def _views(
    rng: np.random.Generator, count: int, turn: np.ndarray, moved_m: np.ndarray, noise_rad: float = 0.0
) -> list[View]:
    """A circle about the target, banked, as reported: turned in the body by ``turn`` and displaced by ``moved_m``."""
    views = []
    for angle in rng.uniform(0.0, 2.0 * np.pi, count):
        pos = TRUE + np.array([35.0 * np.cos(angle), 35.0 * np.sin(angle), -70.0])
        body = Rotation.from_euler("ZYX", [angle + np.pi / 2, 0.05, rng.normal(0.2, 0.1)])
        noise = Rotation.from_rotvec(noise_rad * rng.normal(size=3))
        ray = (body.as_matrix() @ MOUNT).T @ (TRUE - pos)
        reported = body * noise * Rotation.from_rotvec(turn)
        views.append(View(pos + moved_m, reported.as_matrix(), MOUNT, ray))
    return views


def test_biases_that_stay_are_found_and_the_target_with_them() -> None:
    turn, moved = np.radians([2.0, -2.5, 3.0]), np.array([1.5, -1.0, 0.0])
    views = _views(np.random.default_rng(1), 30, turn, moved)
    config = LineOfSightConfig(view_std_rad=1e-4, view_std_m=0.0, position_bias_m=(1e-3, 1e-3, 1e-3))

    found = LineOfSightFilter(TRUE + np.array([8.0, 5.0, 0.0]), PRIOR_COV, config).add(*views)

    # what displaces all views alike displaces the target: no view tells the two apart
    assert_allclose(found.pos_ned_m[:2], (TRUE + moved)[:2], atol=0.05)
    assert abs(found.pos_ned_m[2] - TRUE[2]) < 3.0 * np.sqrt(found.cov_ned_m2[2, 2])
    reported_to_true = Rotation.from_rotvec(turn).inv().as_rotvec()
    assert_allclose(found.attitude_bias_rad, reported_to_true, atol=np.radians(0.3))


def test_the_solution_is_that_of_a_general_solver() -> None:
    """SciPy, with residuals and rotations of its own."""
    views = _views(np.random.default_rng(2), 8, np.radians([3.0, 1.0, -2.0]), np.zeros(3), np.radians(0.5))
    config = LineOfSightConfig(nu=1e9, view_std_m=0.0)
    prior = TRUE + np.array([5.0, -4.0, 1.0])
    root = np.linalg.cholesky(np.linalg.inv(PRIOR_COV)).T
    bias_std = np.array([*config.attitude_bias_rad, *config.position_bias_m])

    def residuals(x: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(x[3:6]).as_matrix()
        rows = [root @ (x[:3] - prior), x[3:] / bias_std]
        for view in views:
            seen = (view.ned_from_body @ turn @ MOUNT).T @ (x[:3] - view.lens_ned_m - x[6:])
            ray = view.ray_camera / np.linalg.norm(view.ray_camera)
            a = np.cross(ray, [1.0, 0.0, 0.0])
            a /= np.linalg.norm(a)
            rows.append(np.array([a @ seen, np.cross(ray, a) @ seen]) / (ray @ seen) / config.view_std_rad)
        return np.concatenate(rows)

    other = least_squares(
        residuals,
        np.concatenate((prior, np.zeros(6))),
        x_scale=np.r_[np.ones(3), 0.01 * np.ones(3), np.ones(3)],
        xtol=1e-12,
        ftol=1e-12,
    )
    found = LineOfSightFilter(prior, PRIOR_COV, config).add(*views)

    assert_allclose(found.pos_ned_m, other.x[:3], atol=0.02)
    assert_allclose(found.attitude_bias_rad, other.x[3:6], atol=2e-4)
    cov = np.linalg.inv(other.jac.T @ other.jac)
    assert_allclose(found.cov_ned_m2, cov[:3, :3], rtol=0.02, atol=0.02)


def test_one_view_at_a_time_comes_to_the_same() -> None:
    views = _views(np.random.default_rng(3), 12, np.radians([2.0, 2.0, 2.0]), np.zeros(3), np.radians(0.5))
    at_once = LineOfSightFilter(TRUE + np.array([6.0, 0.0, 0.0]), PRIOR_COV).add(*views)
    one_by_one = LineOfSightFilter(TRUE + np.array([6.0, 0.0, 0.0]), PRIOR_COV)
    found = [one_by_one.add(view) for view in views]

    assert_allclose(found[-1].pos_ned_m, at_once.pos_ned_m, atol=0.01)
    assert np.trace(found[-1].cov_ned_m2) < 0.3 * np.trace(found[0].cov_ned_m2)


def test_the_stated_covariance_holds_the_error() -> None:
    rng = np.random.default_rng(4)
    config = LineOfSightConfig(position_bias_m=(1.5, 1.5, 1.5), view_std_m=0.0)
    nees = []
    for _ in range(60):
        turn = rng.normal(size=3) * config.attitude_bias_rad
        moved = rng.normal(size=3) * config.position_bias_m
        views = _views(rng, 12, turn, moved, config.view_std_rad)
        start = TRUE + rng.multivariate_normal(np.zeros(3), PRIOR_COV)
        found = LineOfSightFilter(start, PRIOR_COV, config).add(*views)
        d = (found.pos_ned_m - TRUE)[:2]
        nees.append(d @ np.linalg.solve(found.cov_ned_m2[:2, :2], d))

    assert 0.8 < np.mean(np.array(nees) < 4.605) < 0.99


def test_views_that_cannot_be_of_one_target_are_refused() -> None:
    ahead = View(np.array([0.0, 0.0, -70.0]), np.eye(3), MOUNT, np.array([0.0, 0.0, 1.0]))
    up = View(np.array([0.0, 0.0, -70.0]), np.diag([1.0, -1.0, -1.0]), MOUNT, np.array([0.0, 0.0, 1.0]))
    with pytest.raises(GeometryError, match="behind"):
        LineOfSightFilter(np.zeros(3), PRIOR_COV).add(ahead, up)
    with pytest.raises(ValueError, match="positive"):
        LineOfSightConfig(view_std_rad=0.0)
