import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.odometry.image_gyro import (
    MIN_TRACKS,
    ImageGyro,
    ImageTurn,
    PlanarMotion,
    PlanarMotionConfig,
    planar_motion,
)

CAMERA = Camera(640, 480, 554.3, 554.3, 319.5, 239.5)
NADIR = np.array([0.0, 0.0, 1.0])
TURN_RAD = np.array([0.02, -0.03, 0.05])
SHIFT = np.array([0.01, 0.03, -0.008])
NOISE = 1.5e-4


def _tracks(
    seed: int, turn_rad: np.ndarray, shift: np.ndarray, down: np.ndarray, noise: float, count: int = 120
) -> tuple[np.ndarray, np.ndarray]:
    """Normalised coordinates before and after: the camera turns by ``turn_rad`` and moves by -``shift`` distances."""
    rng = np.random.default_rng(seed)
    first = np.column_stack((rng.uniform((-0.55, -0.4), (0.55, 0.4), size=(count, 2)), np.ones(count)))
    points = first / (first @ (down / np.linalg.norm(down)))[:, None]
    # a point fixed in space turns the other way in the camera's axes
    seen = points @ matrix_from_q(q_from_rotvec(turn_rad)) + shift
    return first[:, :2] + rng.normal(0.0, noise, (count, 2)), seen[:, :2] / seen[:, 2:]


def _motion(first: np.ndarray, second: np.ndarray, down: np.ndarray = NADIR) -> PlanarMotion:
    motion = planar_motion(first, second, down, PlanarMotionConfig())
    assert motion is not None
    return motion


@pytest.mark.parametrize("down", [NADIR, np.array([0.0, 0.7, 0.7]), np.array([-0.5, 0.3, 0.8])])
def test_exact_tracks_give_turn_and_shift_over_level_and_oblique_ground(down: np.ndarray) -> None:
    motion = _motion(*_tracks(1, TURN_RAD, SHIFT, down, 0.0), down)

    assert_allclose(motion.rotvec_camera_rad, TURN_RAD, atol=1e-6)
    assert_allclose(motion.translation_by_distance, SHIFT, atol=1e-6)
    assert motion.inlier_fraction == 1.0


def test_forward_motion_is_not_taken_for_pitch() -> None:
    """Over flat ground the two look alike at the centre: 3 % of the height forward is 1.7 degrees if mistaken."""
    motion = _motion(*_tracks(2, np.zeros(3), np.array([0.0, 0.03, 0.0]), NADIR, 0.0))

    assert_allclose(motion.rotvec_camera_rad, 0.0, atol=1e-6)


def test_normal_may_be_said_wrong_by_twenty_degrees() -> None:
    """A bank of 20 degrees that the attitude, half a second late, does not know of."""
    down = matrix_from_q(q_from_rotvec(np.array([0.0, 0.35, 0.0]))) @ NADIR

    motion = _motion(*_tracks(3, TURN_RAD, np.array([0.002, 0.03, 0.0]), down, 1e-5), NADIR)

    assert_allclose(motion.rotvec_camera_rad, TURN_RAD, atol=3e-4)


def test_covariance_is_the_errors_with_a_third_of_the_tracks() -> None:
    """Independent noise: the normalised square is 3 (dimensions) / 3 (share), a quarter more for the robust weight."""
    squares = []
    for seed in range(200):
        motion = _motion(*_tracks(100 + seed, TURN_RAD, SHIFT, NADIR, NOISE))
        error = motion.rotvec_camera_rad - TURN_RAD
        squares.append(error @ np.linalg.solve(motion.cov_rotvec_rad2, error))

    # the mean of 200 has a standard deviation of 0.07
    assert np.mean(squares) == pytest.approx(1.25, abs=0.25)
    std_rad = np.sqrt(np.diag(motion.cov_rotvec_rad2))
    assert std_rad[2] < 0.6 * std_rad[:2].min()


def test_a_third_of_outliers_is_shrugged_off() -> None:
    first, second = _tracks(4, TURN_RAD, SHIFT, NADIR, NOISE)
    second[::3] += np.random.default_rng(5).uniform(-0.05, 0.05, second[::3].shape)

    motion = _motion(first, second)

    assert motion.inlier_fraction == pytest.approx(0.667, abs=0.05)
    sigmas = (motion.rotvec_camera_rad - TURN_RAD) / np.sqrt(np.diag(motion.cov_rotvec_rad2))
    assert np.abs(sigmas).max() < 4.0


def test_too_few_or_disagreeing_tracks_give_nothing() -> None:
    first, second = _tracks(6, TURN_RAD, SHIFT, NADIR, NOISE)
    scattered = second + np.random.default_rng(7).uniform(-0.1, 0.1, second.shape)
    unseen = np.where(np.arange(len(first))[:, None] < MIN_TRACKS - 1, first, np.nan)

    assert planar_motion(unseen, second, NADIR, PlanarMotionConfig()) is None
    motion = planar_motion(first, scattered, NADIR, PlanarMotionConfig())
    # either refused, or so unsure that it weighs nothing
    assert motion is None or np.sqrt(np.diag(motion.cov_rotvec_rad2)).min() > 0.005


def _ground() -> np.ndarray:
    noise = np.random.default_rng(8).normal(size=(900, 1100))
    rough = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return np.asarray(cv2.normalize(rough, None, 0, 255, cv2.NORM_MINMAX), dtype=np.uint8)


def _picture(turn_rad: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The ground from a camera that has turned and moved since it looked straight down from one distance."""
    plane = matrix_from_q(q_from_rotvec(turn_rad)).T + np.outer(shift, NADIR)
    ground_from_map = np.array([[1 / 554.3, 0.0, -550 / 554.3], [0.0, 1 / 554.3, -450 / 554.3], [0.0, 0.0, 1.0]])
    homography = CAMERA.matrix @ plane @ ground_from_map
    return np.asarray(cv2.warpPerspective(_ground(), homography, (640, 480)), dtype=np.uint8)


def _flown(gyro: ImageGyro, steps: int, interval_us: int, turn_rad: np.ndarray) -> list[ImageTurn]:
    turns = []
    for step in range(steps):
        turn = gyro.step(1_000_000 + step * interval_us, _picture(step * turn_rad, step * 0.3 * SHIFT), NADIR)
        if turn is not None:
            turns.append(turn)
    return turns


def test_pictures_become_turns() -> None:
    turn_rad = np.array([0.004, -0.006, 0.015])

    turns = _flown(ImageGyro(CAMERA), 5, 100_000, turn_rad)

    assert len(turns) == 4
    for turn in turns:
        assert turn.t_second_us - turn.t_first_us == 100_000
        std_rad = np.sqrt(np.diag(turn.cov_rotvec_rad2))
        assert (np.abs(turn.rotvec_camera_rad - turn_rad) < 4.0 * std_rad).all()
        assert std_rad.max() < 2e-3
        assert_allclose(turn.rate_camera_rad_s, turn.rotvec_camera_rad / 0.1)


def test_fast_video_is_thinned() -> None:
    turns = _flown(ImageGyro(CAMERA), 7, 33_333, np.array([0.001, -0.002, 0.004]))

    assert [turn.t_second_us - turn.t_first_us for turn in turns] == [66_666] * 3


def test_repeated_pictures_and_gaps_do_not_read_as_rest() -> None:
    gyro = ImageGyro(CAMERA)
    first, second = _picture(np.zeros(3), np.zeros(3)), _picture(TURN_RAD, SHIFT)

    assert gyro.step(0, first, NADIR) is None
    assert gyro.step(100_000, first, NADIR) is None
    repeated = gyro.step(200_000, second, NADIR)
    assert repeated is not None
    assert (repeated.t_first_us, repeated.t_second_us) == (0, 200_000)
    # a second without pictures, then a clock that runs back
    assert gyro.step(1_200_000, first, NADIR) is None
    assert gyro.step(1_100_000, second, NADIR) is None
    assert gyro.step(1_200_000, first, NADIR) is not None


def test_reset_forgets_the_last_picture() -> None:
    gyro = ImageGyro(CAMERA)
    gyro.step(0, _picture(np.zeros(3), np.zeros(3)), NADIR)
    gyro.reset()

    assert gyro.step(100_000, _picture(TURN_RAD, SHIFT), NADIR) is None


def test_dark_picture_gives_nothing() -> None:
    gyro = ImageGyro(CAMERA)
    gyro.step(0, np.zeros((480, 640), dtype=np.uint8), NADIR)

    assert gyro.step(100_000, np.full((480, 640), 1, dtype=np.uint8), NADIR) is None
