from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.camera import Mount
from estimator.geometry.rotation import matrix_from_q, q_from_matrix, q_from_rotvec, rotvec_from_q
from estimator.measurements.camera_attitude import CameraAttitude, CameraAttitudeModel, Gimbal
from estimator.measurements.terrain_fix import (
    PoseNoise,
    apparent_pose,
    apparent_pose_jacobian,
    centre_by_pose,
    heading,
    height,
    pose,
)
from estimator.registration.refine import Refinement
from tests.estimator.measurements.filters import LAYOUT, general_filter, numeric_jacobian

GROUND_DOWN_M = 12.0
PLAIN = PoseNoise(1.0, 1.0)


def _camera(eskf: ErrorStateFilter) -> CameraAttitude:
    model = CameraAttitudeModel(Mount(0.1, -1.3, 0.2, np.zeros(3)), Gimbal.FIXED)
    return model.at(0, eskf.nominal.motion.q_ned_from_body, eskf.nominal.boresight_rad)


def _apparent(eskf: ErrorStateFilter) -> np.ndarray:
    return apparent_pose(eskf, eskf.nominal.motion.pos_ned_m)


def _seen(eskf: ErrorStateFilter, ray_camera: np.ndarray) -> np.ndarray:
    """Map point (3,) at which a ray of the camera meets what the map shows."""
    ray = _camera(eskf).ned_from_camera @ ray_camera
    pos = _apparent(eskf)
    return pos + ray * (GROUND_DOWN_M - pos[2]) / ray[2]


def test_map_bias_and_ground_bias_displace_the_apparent_pose() -> None:
    """
    The map shows everything 3 m too far north and 2 m too far west; what is seen lies 1.5 m below the ground model.

    On the map the camera then stands 3 m north and 2 m west of itself, and 1.5 m higher.
    """
    eskf = general_filter()
    biased = replace(
        eskf.nominal, map_bias_ne_m=np.array([2.5, -3.0]), map_region_ne_m=np.array([0.5, 1.0]),
        ground_biases_m=np.array([2.0, -0.5]),
    )  # fmt: skip
    eskf.nominal = biased

    assert_allclose(_apparent(eskf) - eskf.nominal.motion.pos_ned_m, [3.0, -2.0, -1.5])


def test_apparent_pose_jacobian_agrees_with_finite_differences() -> None:
    eskf = general_filter()
    base = _camera(eskf).ned_from_camera

    def pose_of(other: ErrorStateFilter) -> np.ndarray:
        turn = rotvec_from_q(q_from_matrix(_camera(other).ned_from_camera @ base.T))
        return np.concatenate((_apparent(other), turn))

    T = apparent_pose_jacobian(eskf, _camera(eskf))

    assert_allclose(T, numeric_jacobian(pose_of), atol=1e-6)
    for group in ("position", "attitude", "boresight", "map_bias", "map_region", "ground_bias"):
        assert T[:, LAYOUT.slices[group]].any(), group


@pytest.mark.parametrize("ray_camera", [(0.0, 0.0, 1.0), (0.3, -0.2, 1.0)])
def test_seen_point_agrees_with_finite_differences(ray_camera: tuple[float, float, float]) -> None:
    """Map and ground bias included: the chain that registration uses for where the picture's middle lies."""
    eskf = general_filter()
    ray = np.array(ray_camera)

    H = centre_by_pose(_seen(eskf, ray), _apparent(eskf)) @ apparent_pose_jacobian(eskf, _camera(eskf))

    # a hundred metres times a step of 1e-5 squared: truncation far below a millimetre per radian
    assert_allclose(H, numeric_jacobian(lambda other: _seen(other, ray)[:2]), rtol=1e-5, atol=1e-4)
    for group in ("map_bias", "map_region"):
        assert_allclose(H[:, LAYOUT.slices[group]], np.eye(2), atol=1e-12)


def test_heading_is_the_cameras_turn_about_the_vertical() -> None:
    eskf = general_filter()
    innovation = heading(eskf, _camera(eskf), 0.02, 0.005, 0.25)

    assert_allclose(innovation.z, [0.02])
    assert_allclose(innovation.H[:, eskf.layout.slices["attitude"]], [[0.0, 0.0, 1.0]], atol=1e-12)
    eskf.update(innovation.z, innovation.H, innovation.R)
    assert heading(eskf, _camera(eskf), 0.0, 0.005, 1.0).H.any()


def test_larger_scale_means_higher_above_what_is_seen() -> None:
    """Two per cent of 100 m are two metres, shared by position and the two ground biases as they are uncertain."""
    eskf = general_filter()
    innovation = height(eskf, 100.0, 0.02, 1e-6, 1.0)

    eskf.update(innovation.z, innovation.H, innovation.R)

    assert eskf.nominal.motion.pos_ned_m[2] == pytest.approx(-90.0 - 2.0 / 3.0, abs=1e-3)
    assert_allclose(eskf.nominal.ground_biases_m, 2.0 / 3.0, atol=1e-3)
    known = general_filter()
    part = LAYOUT.slices["ground_bias"]
    known.P[part, part] = np.eye(2) * 1e-12
    known.update(innovation.z, innovation.H, innovation.R)
    assert known.nominal.motion.pos_ned_m[2] == pytest.approx(-92.0, abs=1e-3)


def _refinement(best: np.ndarray, information: np.ndarray) -> Refinement:
    return Refinement(best, best, information, 1.0, 20)


def _informed(std: np.ndarray, seed: int = 3) -> np.ndarray:
    """An information matrix (6, 6) with these deviations and correlations between all of them."""
    root = np.random.default_rng(seed).normal(size=(6, 6))
    correlation = root @ root.T + 6.0 * np.eye(6)
    scale = np.sqrt(np.diag(correlation))
    return np.linalg.inv(correlation / np.outer(scale, scale) * np.outer(std, std))


def _uncertain(std_position_m: float, std_attitude_rad: float) -> ErrorStateFilter:
    """Position and attitude uncertain; biases, misalignment and clone known."""
    eskf = general_filter()
    std = np.full(LAYOUT.size, 1e-7)
    std[LAYOUT.slices["position"]] = std_position_m
    std[LAYOUT.slices["attitude"]] = std_attitude_rad
    eskf.P = np.diag(std**2)
    return eskf


def _centre(eskf: ErrorStateFilter) -> np.ndarray:
    return _seen(eskf, np.array([0.0, 0.0, 1.0]))


def test_sharp_refinement_takes_the_filter_to_the_true_pose() -> None:
    """Position, tilt and heading were wrong; the camera's error by the picture is the vehicle's on a fixed mount."""
    eskf = _uncertain(10.0, 0.1)
    before = eskf.nominal.motion
    error = np.array([4.0, -3.0, 1.5, 0.02, -0.03, 0.05])
    std = np.array([0.2, 0.2, 0.3, 0.002, 0.002, 0.002])

    innovation = pose(
        _refinement(error, _informed(std)), apparent_pose_jacobian(eskf, _camera(eskf)), _centre(eskf),
        _apparent(eskf), PLAIN, PLAIN,
    )  # fmt: skip
    assert innovation is not None
    eskf.update(innovation.z, innovation.H, innovation.R)

    after = eskf.nominal.motion
    # a prior fifty times as wide pulls by 1 / 2500
    assert_allclose(after.pos_ned_m - before.pos_ned_m, error[:3], atol=0.02)
    turn = matrix_from_q(after.q_ned_from_body) @ matrix_from_q(before.q_ned_from_body).T
    assert_allclose(rotvec_from_q(q_from_matrix(turn)), error[3:], atol=1e-4)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_update_is_that_of_the_information_filter(seed: int) -> None:
    """P+^-1 = P^-1 + T' I T, whatever the axes the innovation is written along."""
    eskf = _uncertain(2.0, 0.03)
    rng = np.random.default_rng(seed)
    # turns below a hundredth of a radian, so that no reset of the attitude error takes part
    best = rng.normal(0.0, [1.0, 1.0, 1.0, 0.001, 0.001, 0.001])
    information = _informed(np.array([0.5, 0.8, 1.5, 0.01, 0.02, 0.015]), seed)
    T = apparent_pose_jacobian(eskf, _camera(eskf))

    innovation = pose(_refinement(best, information), T, _centre(eskf), _apparent(eskf), PLAIN, PLAIN)

    assert innovation is not None
    posterior_information = np.linalg.inv(eskf.P) + T.T @ information @ T
    expected_dx = np.linalg.solve(posterior_information, T.T @ information @ best)
    before = eskf.nominal.motion.pos_ned_m
    eskf.update(innovation.z, innovation.H, innovation.R)
    moved = eskf.nominal.motion.pos_ned_m - before
    assert_allclose(moved, expected_dx[LAYOUT.slices["position"]], atol=1e-6)
    # the states known to 1e-7 make the inverse good to about a millionth
    block = np.linalg.inv(posterior_information)[:9, :9]
    assert_allclose(eskf.P[:9, :9], block, rtol=1e-4, atol=1e-7)


def test_direction_that_the_picture_does_not_tell_is_left_alone() -> None:
    """A straight road to the east: nothing along it, and no turn or height either."""
    eskf = _uncertain(5.0, 1e-7)
    along = np.diag([1.0 / 0.3**2, 0.0, 0.0, 0.0, 0.0, 0.0])

    innovation = pose(
        _refinement(np.array([2.0, 50.0, 0.0, 0.0, 0.0, 0.0]), along), apparent_pose_jacobian(eskf, _camera(eskf)),
        _centre(eskf), _apparent(eskf), PLAIN, PLAIN,
    )  # fmt: skip

    assert innovation is not None
    assert len(innovation.z) == 1
    before = eskf.nominal.motion.pos_ned_m
    eskf.update(innovation.z, innovation.H, innovation.R)
    assert_allclose(eskf.nominal.motion.pos_ned_m - before, [2.0, 0.0, 0.0], atol=0.02)
    assert_allclose(np.diag(eskf.cov("position")), [0.3**2, 25.0, 25.0], rtol=0.01)


def test_picture_without_information_gives_no_innovation() -> None:
    eskf = general_filter()

    innovation = pose(
        _refinement(np.ones(6), np.zeros((6, 6))), apparent_pose_jacobian(eskf, _camera(eskf)), _centre(eskf),
        _apparent(eskf), PLAIN, PLAIN,
    )  # fmt: skip

    assert innovation is None


def test_noise_factors_belong_to_where_the_middle_lies_and_to_the_shape() -> None:
    """
    Position and tilt each hold both: the middle's place counts four times less sure, turn, tilt and scale twice.

    The innovation's covariance, taken back to middle, height and rotation, is that of the picture times the factors.
    """
    eskf = general_filter()
    information = _informed(np.array([0.5, 0.8, 1.5, 0.01, 0.02, 0.015]))
    centre, apparent = _centre(eskf), _apparent(eskf)
    parts = np.zeros((6, 6))
    parts[:2] = centre_by_pose(centre, apparent)
    parts[2:, 2:] = np.eye(4)
    T = np.eye(6)

    innovation = pose(
        _refinement(np.zeros(6), information), T, centre, apparent, PoseNoise(4.0, 2.0), PoseNoise(4.0, 0.5)
    )

    assert innovation is not None
    assert len(innovation.z) == 6
    back = parts @ np.linalg.inv(innovation.H)
    factors = np.diag([4.0, 4.0, 2.0, 2.0, 2.0, 2.0])
    expected = factors @ parts @ np.linalg.inv(information) @ parts.T @ factors
    assert_allclose(back @ innovation.R @ back.T, expected, rtol=1e-6, atol=1e-9)
    own = np.diag([4.0, 4.0, 0.5, 0.5, 0.5, 0.5])
    assert innovation.R_one is not None
    assert_allclose(
        back @ innovation.R_one @ back.T, own @ parts @ np.linalg.inv(information) @ parts.T @ own, rtol=1e-6, atol=1e-9
    )


def test_map_bias_keeps_a_perfect_picture_from_certainty() -> None:
    """What the map is displaced by, a metre, no picture can tell: the position keeps it, over any number of them."""
    eskf = _uncertain(5.0, 1e-7)
    part = LAYOUT.slices["map_bias"]
    eskf.P[part, part] = np.eye(2)
    sharp = _informed(np.array([0.05, 0.05, 0.1, 1e-3, 1e-3, 1e-3]))
    for _ in range(50):
        innovation = pose(
            _refinement(np.zeros(6), sharp), apparent_pose_jacobian(eskf, _camera(eskf)), _centre(eskf),
            _apparent(eskf), PLAIN, PLAIN,
        )  # fmt: skip
        assert innovation is not None
        eskf.update(innovation.z, innovation.H, innovation.R)

    # 25 x 1 / (25 + 1): the two share what they were uncertain by
    assert_allclose(np.diag(eskf.cov("position"))[:2], 25.0 / 26.0, rtol=0.01)


def test_pose_is_refined_about_the_rotation_of_the_camera() -> None:
    """A turn of the camera that the picture finds is the misalignment's where the attitude is known."""
    eskf = general_filter()
    std = np.full(LAYOUT.size, 1e-7)
    std[LAYOUT.slices["boresight"]] = 0.1
    eskf.P = np.diag(std**2)
    turn = np.array([0.01, -0.02, 0.03])
    before = _camera(eskf).ned_from_camera
    sharp = _informed(np.array([0.2, 0.2, 0.3, 1e-4, 1e-4, 1e-4]))

    innovation = pose(
        _refinement(np.concatenate((np.zeros(3), turn)), sharp), apparent_pose_jacobian(eskf, _camera(eskf)),
        _centre(eskf), _apparent(eskf), PLAIN, PLAIN,
    )  # fmt: skip
    assert innovation is not None
    eskf.update(innovation.z, innovation.H, innovation.R)

    # first order in the turn: 0.04 rad squared
    expected = matrix_from_q(q_from_rotvec(turn)) @ before
    assert_allclose(_camera(eskf).ned_from_camera, expected, atol=1e-3)
