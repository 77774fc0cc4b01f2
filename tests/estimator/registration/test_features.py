import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import matrix_from_euler, matrix_from_q, q_from_rotvec
from estimator.registration.alignment import CameraPose
from estimator.registration.features import FeatureConfig, Pairs, _pixel_jacobian, fit_pose, propose
from estimator.registration.ortho import Ground
from estimator.registration.pose_prior import PosePrior
from tests.estimator.registration.textured_map import CAMERA, MAP, NADIR_TOP_NORTH, ORIGIN_ALT_M, FlatGround

TRUE = CameraPose(np.array([12.0, 7.0, -95.0]), matrix_from_euler(0.06, -0.09, 0.8) @ NADIR_TOP_NORTH)
GROUND = Ground(FlatGround(), ORIGIN_ALT_M, TRUE.pos_ned_m[:2], 100.0)
PRIOR = PosePrior(np.array([20.0, -10.0]), 100.0, np.inf, -95.0, 5.0)


def test_a_pose_is_fitted_in_spite_of_a_third_of_wrong_pairs() -> None:
    rng = np.random.default_rng(3)
    on_map = rng.uniform(-30.0, 30.0, (90, 2)) + TRUE.pos_ned_m[:2]
    points = np.concatenate((on_map, np.zeros((90, 1))), axis=1)
    uv = CAMERA.project((points - TRUE.pos_ned_m) @ TRUE.ned_from_camera) + rng.normal(0.0, 0.5, (90, 2))
    kept = np.isfinite(uv).all(axis=1)
    wrong = on_map.copy()
    wrong[:30] += rng.uniform(-25.0, 25.0, (30, 2))
    pairs = Pairs(on_map[kept], wrong[kept], np.zeros(kept.sum()), np.ones(kept.sum()), uv[kept])
    start = CameraPose(TRUE.pos_ned_m + np.array([6.0, -5.0, 4.0]), matrix_from_euler(0.0, 0.0, 0.85) @ NADIR_TOP_NORTH)

    fitted = fit_pose(pairs, np.ones(kept.sum(), bool), CAMERA, GROUND, start, PRIOR, 1.0, FeatureConfig())

    assert fitted is not None
    pose, count, information = fitted
    # half a pixel is 0.12 m on the ground; tilt and position share it, for three standard deviations
    assert_allclose(pose.pos_ned_m, TRUE.pos_ned_m, atol=0.9)
    assert count >= 35
    assert np.linalg.eigvalsh(information)[0] > 0.0


def test_the_pixels_derivatives_are_those_of_the_projection() -> None:
    ideal = type(CAMERA)(480, 360, 400.0, 402.0, 236.0, 183.0)
    points = np.array([[20.0, 15.0, 0.0], [-8.0, 3.0, 4.0]])

    def seen(x: np.ndarray) -> np.ndarray:
        rotation = matrix_from_q(q_from_rotvec(x[3:])) @ TRUE.ned_from_camera
        return ideal.project((points - TRUE.pos_ned_m - x[:3]) @ rotation)

    steps = 1e-6 * np.eye(6)
    numeric = np.stack([(seen(d) - seen(-d)) / 2e-6 for d in steps], axis=-1)
    offset = points - TRUE.pos_ned_m

    analytic = _pixel_jacobian(offset @ TRUE.ned_from_camera, TRUE.ned_from_camera, offset, ideal)

    assert_allclose(analytic, numeric, rtol=1e-5, atol=1e-4)


def test_unknown_features_are_an_error() -> None:
    with pytest.raises(ValueError, match="unknown features 'surf'"):
        propose(
            np.full((360, 480), 9, np.uint8), CAMERA, MAP, GROUND, PRIOR, FeatureConfig(kinds=("surf",))
        )  # fmt: skip
