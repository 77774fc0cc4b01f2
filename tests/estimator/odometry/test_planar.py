from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.nominal import Clone, Layout, Nominal
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.measurements.barometer import pressure_altitude
from estimator.measurements.camera_attitude import CameraAttitude
from estimator.measurements.visual_odometry import displacement
from estimator.odometry.planar import (
    MIN_TRACKS,
    DisplacementResidual,
    KnownHeights,
    displacement_residual,
    independent,
)

FIRST = np.array([0.0, 0.0, -100.0])
SECOND = np.array([9.0, -5.0, -98.0])


def _flat(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
    return np.zeros_like(north_m)


def _sloped(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
    """Eight per cent down to the north, five up to the east."""
    return 0.08 * north_m - 0.05 * east_m + 2.0


def _ground(count: int, seed: int, down_at=_sloped) -> np.ndarray:
    north, east = np.random.default_rng(seed).uniform(-45.0, 45.0, size=(2, count))
    return np.stack((north, east, down_at(north, east)), axis=-1)


def _rays(points_ned_m: np.ndarray, origin_ned_m: np.ndarray) -> np.ndarray:
    rays = points_ned_m - origin_ned_m
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def _turned(rays: np.ndarray, rotvec: np.ndarray) -> np.ndarray:
    return rays @ matrix_from_q(q_from_rotvec(rotvec)).T


def _residual(
    rays_first: np.ndarray, rays_second: np.ndarray, first=FIRST, second=SECOND, down_at=_sloped
) -> DisplacementResidual:
    residual = displacement_residual(rays_first, rays_second, first, second, down_at, 5e-4, 0.006)
    assert residual is not None
    return residual


def test_true_poses_over_sloped_ground_leave_no_residual() -> None:
    points = _ground(80, 1)

    residual = _residual(_rays(points, FIRST), _rays(points, SECOND))

    # the height is looked up twice: 0.08 x 0.05 of the first guess's error of about 5 m remains, averaged
    assert_allclose(residual.residual_ne_m, 0.0, atol=0.03)
    assert residual.tracks == 80
    assert residual.inlier_fraction == 1.0


@pytest.mark.parametrize("error_ne_m", [(1.5, 0.0), (0.0, -2.0), (-3.0, 4.0)])
def test_wrong_displacement_comes_back_with_its_sign(error_ne_m: tuple[float, float]) -> None:
    """
    Fault: the second camera is predicted at an error from the truth; a fifth of the tracks are outliers.
    Expected: solving the residual's own linear model for the second position gives the true one.
    """
    points = _ground(120, 2)
    rng = np.random.default_rng(3)
    true_rays = _rays(points + rng.normal(0.0, 0.05, size=points.shape), SECOND)
    true_rays[:24] = _rays(points[:24] + np.array([8.0, 11.0, 0.0]), SECOND)
    predicted = SECOND + np.array([*error_ne_m, 0.0])

    residual = _residual(_rays(points, FIRST), true_rays, second=predicted)

    to_truth = np.linalg.solve(residual.by_pos_second[:, :2], -residual.residual_ne_m)
    assert_allclose(to_truth, -np.array(error_ne_m), atol=0.1)
    assert residual.inlier_fraction == pytest.approx(0.8, abs=0.05)
    assert residual.tracks >= 90


def test_covariance_counts_a_third_of_the_tracks() -> None:
    """Independent track noise alone: the normalised square is 2 (variance / 60) / (variance / 20 + 1e-4) = 0.47."""
    rng = np.random.default_rng(4)
    squares = []
    for seed in range(300):
        points = _ground(60, 100 + seed, _flat)
        rays_first = _rays(points + rng.normal(0.0, [0.05, 0.05, 0.0], size=points.shape), FIRST)
        rays_second = _rays(points + rng.normal(0.0, [0.05, 0.05, 0.0], size=points.shape), SECOND)
        residual = displacement_residual(rays_first, rays_second, FIRST, SECOND, _flat, 5e-4, 0.0)
        assert residual is not None
        squares.append(residual.residual_ne_m @ np.linalg.solve(residual.cov_m2, residual.residual_ne_m))

    # the mean of 300 has a standard deviation of 0.03
    assert np.mean(squares) == pytest.approx(0.47, abs=0.12)


def test_relative_error_grows_with_the_displacement() -> None:
    points = _ground(60, 12, _flat)
    rays_first, rays_second = _rays(points, FIRST), _rays(points, SECOND)

    exact, relative = (
        displacement_residual(rays_first, rays_second, FIRST, SECOND, _flat, 5e-4, share) for share in (0.0, 0.02)
    )

    assert exact is not None
    assert relative is not None
    assert_allclose(relative.cov_m2 - exact.cov_m2, np.eye(2) * (0.02 * np.hypot(9.0, 5.0)) ** 2, rtol=1e-9, atol=1e-12)


def test_jacobians_agree_with_finite_differences() -> None:
    points = _ground(60, 5, _flat) + np.array([20.0, -10.0, 0.0])
    rays_first, rays_second = _rays(points, FIRST), _rays(points, SECOND)
    base = _residual(rays_first, rays_second, down_at=_flat)

    step = 1e-4
    for axis in range(3):
        nudge = step * np.eye(3)[axis]
        for forward, backward, jacobian in (
            (
                _residual(rays_first, rays_second, first=FIRST + nudge, down_at=_flat),
                _residual(rays_first, rays_second, first=FIRST - nudge, down_at=_flat),
                base.by_pos_first,
            ),
            (
                _residual(rays_first, rays_second, second=SECOND + nudge, down_at=_flat),
                _residual(rays_first, rays_second, second=SECOND - nudge, down_at=_flat),
                base.by_pos_second,
            ),
            (
                _residual(_turned(rays_first, nudge), rays_second, down_at=_flat),
                _residual(_turned(rays_first, -nudge), rays_second, down_at=_flat),
                base.by_rotation_first,
            ),
            (
                _residual(rays_first, _turned(rays_second, nudge), down_at=_flat),
                _residual(rays_first, _turned(rays_second, -nudge), down_at=_flat),
                base.by_rotation_second,
            ),
        ):
            numeric = (forward.residual_ne_m - backward.residual_ne_m) / (2.0 * step)
            assert_allclose(jacobian[:, axis], numeric, rtol=1e-5, atol=1e-4)


def _lowered(by_m: float):
    def down_at(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.full_like(north_m, by_m)

    return down_at


def test_ground_derivative_agrees_with_finite_differences() -> None:
    """What is seen lies deeper than the model says: the same rays then mean a longer way."""
    points = _ground(60, 5, _flat) + np.array([20.0, -10.0, 0.0])
    rays_first, rays_second = _rays(points, FIRST), _rays(points, SECOND)

    step = 1e-3
    forward, backward = (
        _residual(rays_first, rays_second, down_at=_lowered(sign * step)).residual_ne_m for sign in (1.0, -1.0)
    )

    by_ground = _residual(rays_first, rays_second, down_at=_flat).by_ground
    assert by_ground.shape == (2, 1)
    assert_allclose(by_ground[:, 0], (forward - backward) / (2.0 * step), rtol=1e-5, atol=1e-6)
    # flown 9 m north in level flight at 100 m, a metre of depth is nine centimetres of way
    ahead = FIRST + np.array([9.0, 0.0, 0.0])
    level = _residual(rays_first, _rays(points, ahead), second=ahead, down_at=_flat)
    assert_allclose(level.by_ground[:, 0], [0.09, 0.0], atol=1e-9)


def test_noise_of_the_second_rays_does_not_enter_the_derivatives() -> None:
    """It stands in the residual; what multiplied it there would be squared, and squares do not average out."""
    points = _ground(80, 14, _flat)
    noise = np.random.default_rng(15).normal(0.0, 0.2, size=points.shape) * [1.0, 1.0, 0.0]

    clean = _residual(_rays(points, FIRST), _rays(points, SECOND), down_at=_flat)
    noisy = _residual(_rays(points, FIRST), _rays(points + noise, SECOND), down_at=_flat)

    assert noisy.tracks == 80
    assert np.abs(noisy.residual_ne_m).max() > 0.005
    assert_allclose(noisy.by_pos_second, clean.by_pos_second, atol=1e-9)
    assert_allclose(noisy.by_rotation_second, clean.by_rotation_second, atol=1e-9)
    assert_allclose(noisy.by_ground, clean.by_ground, atol=1e-9)


def _flown(seed: int, updates: int) -> tuple[float, float, float, float]:
    """
    Errors of height and ground bias, each with its standard deviation, after a long level flight over flat ground.

    The speed wanders as the filter's process model says, a barometer with a slowly wandering zero holds the height, and
    each second ray carries the noise of half a pixel.
    """
    rng = np.random.default_rng(seed)
    layout = Layout.of(
        ("position", "velocity", "attitude", "barometer_bias", "ground_bias", "clone_position", "clone_rotation")
    )
    part = layout.slices
    noise = ProcessNoise(manoeuvre_m_s2_rt_s=(0.02, 0.02, 0.02))
    std = np.full(layout.size, 1e-6)
    std[part["position"]], std[part["velocity"]], std[part["barometer_bias"]] = (1.0, 1.0, 3.0), 1.0, 3.0
    std[part["ground_bias"]] = noise.ground_bias_std_m
    zero, level = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    pos, vel = np.array([0.0, 0.0, -100.0]), np.array([15.0, 0.0, 0.0])
    nominal = Nominal(Motion(pos, vel, level), zero, zero, 0.0, zero, zero)
    eskf = ErrorStateFilter(nominal, np.diag(std**2), layout, EarthModel.at(0.8, 300.0), noise)
    camera = CameraAttitude(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.eye(3), np.eye(3))
    dt_s = 0.4
    for _ in range(updates):
        first = pos
        eskf.clone(Clone(eskf.nominal.motion.pos_ned_m, level), np.zeros((3, layout.size)))
        pos = pos + vel * dt_s
        vel = vel + np.array([0.02, 0.02, 0.0]) * dt_s**0.5 * rng.normal(size=3)
        eskf.predict_attitude_driven(level, zero, 60.0, dt_s)
        points = pos + np.concatenate((rng.uniform(-50.0, 50.0, size=(40, 2)), np.full((40, 1), 100.0)), axis=1)
        seen = points + np.concatenate((rng.normal(0.0, 0.1, size=(40, 2)), np.zeros((40, 1))), axis=1)
        residual = displacement_residual(
            _rays(points, first), _rays(seen, pos), eskf.nominal.clone.pos_ned_m, eskf.nominal.motion.pos_ned_m,
            _lowered(eskf.nominal.ground_bias_m), 1e-3, 0.006,
        )  # fmt: skip
        assert residual is not None
        odometry = displacement(eskf, residual, camera)
        eskf.update(odometry.z, odometry.H, odometry.R)
        height = pressure_altitude(eskf, 100.0 + rng.normal(0.0, 0.5), 0.0, 0.5)
        eskf.update(height.z, height.H, height.R)
    ones = np.ones(2)
    return (
        -eskf.nominal.motion.pos_ned_m[2] - 100.0,
        float(np.sqrt(eskf.cov("position")[2, 2])),
        eskf.nominal.ground_bias_m,
        float(np.sqrt(ones @ eskf.cov("ground_bias") @ ones)),
    )


def test_noisy_tracks_do_not_drag_height_and_ground_to_one_side() -> None:
    """
    Fault: two thousand pictures with noise in every track, over ground that is where the model has it.
    Expected: height and ground bias stay within their own sigmas, on the mean over flights too.

    With the derivatives taken at the measured rays, all flights end 21 m too low, nine sigmas.
    """
    height_m, height_std_m, ground_m, ground_std_m = np.array([_flown(seed, 2000) for seed in range(3)]).T

    assert (np.abs(height_m) < 2.5 * height_std_m).all()
    assert (np.abs(ground_m) < 2.5 * ground_std_m).all()
    # the barometer's wandering zero leaves 2.6 m; the mean of three flights has 0.6 sigma
    assert abs(np.mean(height_m / height_std_m)) < 1.0
    assert abs(np.mean(ground_m / ground_std_m)) < 1.0


def test_unknown_ground_ahead_uses_the_height_below() -> None:
    """The terrain model ends at the vehicle: the flat continuation serves, and nothing is NaN."""

    def ends(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.where(north_m > 5.0, np.nan, 0.0)

    points = _ground(60, 6, _flat)

    residual = _residual(_rays(points, FIRST), _rays(points, SECOND), down_at=ends)

    assert_allclose(residual.residual_ne_m, 0.0, atol=1e-9)
    assert np.isfinite(residual.cov_m2).all()


def test_too_few_tracks_give_nothing() -> None:
    points = _ground(MIN_TRACKS - 1, 7)

    assert displacement_residual(_rays(points, FIRST), _rays(points, SECOND), FIRST, SECOND, _sloped, 5e-4, 0.0) is None


def test_rays_above_the_horizon_are_left_out() -> None:
    points = _ground(40, 8)
    rays_first, rays_second = _rays(points, FIRST), _rays(points, SECOND)
    rays_first[:30, 2] *= -1.0

    assert _residual(rays_first, rays_second).tracks == 10
    rays_first[30, 2] *= -1.0
    assert displacement_residual(rays_first, rays_second, FIRST, SECOND, _sloped, 5e-4, 0.0) is None


def test_camera_at_the_ground_gives_nothing() -> None:
    points = _ground(40, 9, _flat)
    low = np.array([0.0, 0.0, -0.3])

    assert displacement_residual(_rays(points, low), _rays(points, SECOND), low, SECOND, _flat, 5e-4, 0.0) is None


def test_disagreeing_tracks_give_nothing() -> None:
    """No common motion: a tight core far from most of the tracks must not pass as the majority."""
    points = _ground(60, 10, _flat)
    scattered = points.copy()
    angle = np.linspace(0.0, 2.0 * np.pi, 45, endpoint=False)
    reach = np.linspace(4.0, 60.0, 45)
    scattered[:45, 0] += reach * np.cos(angle)
    scattered[:45, 1] += reach * np.sin(angle)

    residual = displacement_residual(_rays(points, FIRST), _rays(scattered, SECOND), FIRST, SECOND, _flat, 5e-4, 0.0)

    # either refused, or so unsure that it weighs nothing
    assert residual is None or np.sqrt(residual.cov_m2[0, 0]) > 2.0


@pytest.mark.parametrize("relief_m", [1.0, 4.0])
def test_relief_is_the_scatter_of_heights_whatever_their_mean(relief_m: float) -> None:
    """A canopy 9 m above the model: tracks scatter along the motion by its relief, across by noise alone."""
    points = _ground(400, 11, _flat)
    rng = np.random.default_rng(12)
    points[:, 2] += -9.0 + rng.normal(0.0, relief_m, len(points))
    noise = rng.normal(0.0, 0.02, size=points.shape)

    residual = _residual(_rays(points, FIRST), _rays(points + noise, SECOND), down_at=_flat)

    assert residual.relief_m == pytest.approx(relief_m, rel=0.3)


def test_relief_of_bare_ground_is_small() -> None:
    points = _ground(400, 13)
    noise = np.random.default_rng(14).normal(0.0, 0.02, size=points.shape)

    assert _residual(_rays(points, FIRST), _rays(points + noise, SECOND)).relief_m < 0.3


def test_relief_is_unknown_without_motion() -> None:
    points = _ground(400, 15)
    hovering = FIRST + np.array([0.1, 0.1, 0.0])

    assert np.isinf(_residual(_rays(points, FIRST), _rays(points, hovering), second=hovering).relief_m)


def _known(points: np.ndarray, error_m: float = 0.0) -> KnownHeights:
    place = points[:, :2] / 100.0
    return KnownHeights(
        points[:, 2] + error_m, np.full(len(points), 0.1), np.column_stack((np.ones(len(points)), place))
    )


def _by_known(
    points: np.ndarray, first=FIRST, second=SECOND, turned: np.ndarray | None = None, known: KnownHeights | None = None
) -> DisplacementResidual:
    rays_second = _rays(points, SECOND) if turned is None else _turned(_rays(points, SECOND), turned)
    residual = displacement_residual(
        _rays(points, FIRST), rays_second, first, second, _flat, 5e-4, 0.001, known or _known(points), with_moments=True
    )
    assert residual is not None
    return residual


def _wood(count: int, seed: int) -> np.ndarray:
    points = _ground(count, seed, _flat)
    points[:, 2] -= np.random.default_rng(seed).uniform(2.0, 14.0, count)
    return points


def test_known_heights_take_the_place_of_the_ground_model() -> None:
    points = _wood(120, 21)
    residual = _by_known(points)
    assert_allclose(residual.residual_ne_m, 0.0, atol=1e-9)
    assert residual.moments is not None
    assert_allclose(residual.moments.residual, 0.0, atol=1e-12)
    assert residual.below_m == pytest.approx(points[:, 2].mean())


@pytest.mark.parametrize(("std_m", "least_m", "most_m"), [(0.1, 2.5, 3.5), (3.5, 0.0, 1.5)])
def test_heights_tell_a_relief_that_one_pair_of_pictures_misses(std_m: float, least_m: float, most_m: float) -> None:
    """Heights that scatter by 3 m are a rough surface, unless they are as uncertain as that."""
    points = _ground(300, 23, _flat)
    known = _known(points)
    rough_m = np.random.default_rng(24).normal(0.0, 3.0, len(points))
    scattered = replace(known, down_m=known.down_m + rough_m, std_m=np.full(len(points), std_m))

    assert least_m <= _by_known(points, known=scattered).relief_m <= most_m


def test_neighbouring_tracks_do_not_all_count() -> None:
    assert [independent(count) for count in (1, 30, 150, 600)] == [1.0, 10.0, 50.0, 50.0]


def test_known_heights_leave_the_relief_to_the_ground_model() -> None:
    points = _wood(150, 22)
    expected = points[:, 2].std()
    assert _by_known(points).relief_m == pytest.approx(expected, rel=0.35)


def test_a_turn_and_a_climb_come_back_with_their_sign() -> None:
    points = _wood(120, 23)
    turn = _by_known(points, turned=np.array([0.0, 0.0, 0.004])).moments
    climb = _by_known(points, second=SECOND - [0.0, 0.0, 0.9]).moments
    assert turn is not None
    assert climb is not None
    # rays believed turned from north to east put the second points there, and the residual is first less second
    assert_allclose(turn.residual, [-0.004, 0.0], atol=2e-4)
    # believed 0.9 m higher, of 98 m less trees of 8 m, the second points spread too far
    assert_allclose(climb.residual, [0.0, -0.9 / 90.0], atol=4e-4)


@pytest.mark.parametrize("axis", range(6))
def test_moments_change_with_the_second_pose_as_stated(axis: int) -> None:
    points = _wood(120, 24)
    base = _by_known(points).moments
    assert base is not None
    ends = []
    for sign in (1.0, -1.0):
        if axis < 3:
            moved = _by_known(points, second=SECOND + sign * 0.01 * np.eye(3)[axis])
        else:
            moved = _by_known(points, turned=sign * 1e-4 * np.eye(3)[axis - 3])
        assert moved.moments is not None
        ends.append(moved.moments.residual)
    numeric = (ends[0] - ends[1]) / (0.02 if axis < 3 else 2e-4)
    assert_allclose(base.by_pose_second[:, axis], numeric, rtol=0.02, atol=2e-4 if axis < 3 else 0.02)


def test_common_errors_of_the_heights_move_mean_and_moments_as_stated() -> None:
    points = _wood(120, 25)
    base = _by_known(points)
    assert base.by_heights is not None
    assert base.moments is not None
    known = _known(points)
    for k in range(3):
        ends = [
            _by_known(points, known=replace(known, down_m=known.down_m + sign * 0.05 * known.by_error[:, k]))
            for sign in (1.0, -1.0)
        ]
        mean = (ends[0].residual_ne_m - ends[1].residual_ne_m) / 0.1
        turned = [end.moments.residual for end in ends if end.moments is not None]
        assert_allclose(base.by_heights[:, k], mean, atol=1e-3)
        assert_allclose(base.moments.by_heights[:, k], (turned[0] - turned[1]) / 0.1, atol=1e-4)


def test_raising_cameras_and_surface_together_changes_nothing() -> None:
    """A direction that nothing observes: a derivative off by the noise alone would let the height drift along it."""
    points = _wood(120, 26)
    noisy = points + np.random.default_rng(27).normal(0.0, 0.3, points.shape)
    residual = displacement_residual(
        _rays(points, FIRST), _rays(noisy, SECOND), FIRST, SECOND, _flat, 5e-4, 0.001, _known(points)
    )
    assert residual is not None
    assert residual.by_heights is not None
    together = residual.by_pos_first[:, 2] + residual.by_pos_second[:, 2] + residual.by_heights[:, 0]
    assert_allclose(together, 0.0, atol=1e-12)
