import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from estimator.geometry.ground import (
    ground_point_by_pose,
    ground_point_covariance,
    intersect_plane,
    intersect_terrain,
    ray_ground_jacobian,
    terrain_slope,
)
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from tests.estimator.geometry.strategies import vectors

ORIGIN = np.array((10.0, -20.0, -120.0))


def _fan(half_angle_rad: float, count: int = 15) -> np.ndarray:
    """Rays (count, count, 3) around straight down."""
    tangent = math.tan(half_angle_rad) * np.linspace(-1.0, 1.0, count)
    north, east = np.meshgrid(tangent, tangent)
    return np.stack((north, east, np.ones_like(north)), axis=-1)


def _hills(north: np.ndarray, east: np.ndarray) -> np.ndarray:
    return -15.0 * np.sin(north / 60.0) * np.cos(east / 45.0) + 5.0


def _wall(north: np.ndarray, east: np.ndarray) -> np.ndarray:
    """Level ground with a building 40 m high and 12 m deep, its front at north = 100."""
    return np.where((north >= 100.0) & (north <= 112.0), -40.0, 0.0)


def _tilted_point(origin: np.ndarray, ray: np.ndarray, slope: np.ndarray, down_m: float) -> np.ndarray:
    """Where a ray meets the plane down = down_m + slope . (north, east)."""
    along = (down_m + slope @ origin[:2] - origin[2]) / (ray[2] - slope @ ray[:2])
    return origin + along * ray


def test_plane_below() -> None:
    points = intersect_plane(ORIGIN, np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 1.0], [0.0, -3.0, 1.0]]), 30.0)

    assert_allclose(points, [[10.0, -20.0, 30.0], [160.0, -20.0, 30.0], [10.0, -470.0, 30.0]])


def test_plane_missed() -> None:
    rays = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, -0.1], [np.nan, 0.0, 1.0]])

    assert np.all(np.isnan(intersect_plane(ORIGIN, rays[:3], 0.0)))
    assert np.isnan(intersect_plane(ORIGIN, rays[3], 0.0)[0])
    # From below the plane it is ahead of rays that climb.
    assert_allclose(intersect_plane(-ORIGIN, rays[0], 0.0), (-10.0, 20.0, 0.0))


def test_plane_broadcasts() -> None:
    points = intersect_plane(np.zeros((4, 1, 3)), np.ones((5, 3)), np.arange(1.0, 6.0))

    assert points.shape == (4, 5, 3)
    assert_allclose(points[2, 3], (4.0, 4.0, 4.0))


def test_flat_terrain_is_the_plane() -> None:
    rays = _fan(math.radians(75.0))

    found = intersect_terrain(ORIGIN, rays, lambda north, east: np.full_like(north, 30.0), 5000.0)

    assert_allclose(found, intersect_plane(ORIGIN, rays, 30.0), rtol=0.0, atol=1e-6)


def test_points_lie_on_the_hills_and_on_their_rays() -> None:
    rays = _fan(math.radians(70.0), 25)

    points = intersect_terrain(ORIGIN, rays, _hills, 2000.0)

    assert np.all(np.isfinite(points))
    assert_allclose(_hills(points[..., 0], points[..., 1]), points[..., 2], rtol=0.0, atol=1e-5)
    assert_allclose(np.cross(points - ORIGIN, rays), 0.0, atol=1e-8)


def test_the_first_of_many_crossings_is_taken() -> None:
    """Low rays pass behind hills; nothing of the ray before the point may be below the ground."""
    origin = np.array((0.0, 0.0, -30.0))
    azimuth = np.linspace(0.0, 2.0 * math.pi, 90)
    rays = np.stack((np.cos(azimuth), np.sin(azimuth), np.full(90, 0.08)), axis=-1)

    points = intersect_terrain(origin, rays, _hills, 1000.0)

    assert np.all(np.isfinite(points))
    before = origin + np.linspace(0.0, 0.999, 4000)[:, np.newaxis, np.newaxis] * (points - origin)
    assert np.all(before[..., 2] < _hills(before[..., 0], before[..., 1]))


def test_a_wall_stops_rays_that_pass_under_its_top() -> None:
    """Steeper than the march supposes, but thicker than its step there."""
    origin = np.array((0.0, 0.0, -100.0))
    target_down = np.linspace(-39.0, -1.0, 30)
    rays = np.stack((np.full(30, 100.0), np.zeros(30), target_down + 100.0), axis=-1)

    points = intersect_terrain(origin, rays, _wall, 1000.0)

    assert_allclose(points[:, 0], 100.0, atol=1e-3)
    assert_allclose(points[:, 2], target_down, atol=1e-3)


def test_terrain_missed() -> None:
    flat = np.zeros_like
    rays = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.001], [np.nan, 0.0, 1.0], [0.0, 0.0, 0.0]])

    def level(north: np.ndarray, east: np.ndarray) -> np.ndarray:
        return flat(north)

    assert np.all(np.isnan(intersect_terrain(ORIGIN, rays, level, 1000.0)))
    # A camera at or below the ground sees nothing of it.
    assert np.all(np.isnan(intersect_terrain(np.zeros(3), _fan(0.5), level, 1000.0)))
    assert np.all(np.isnan(intersect_terrain(-ORIGIN, _fan(0.5), level, 1000.0)))


def test_range_ends_exactly() -> None:
    down = np.array((0.0, 0.0, 1.0))

    def level(north: np.ndarray, east: np.ndarray) -> np.ndarray:
        return np.zeros_like(north)

    assert np.all(np.isfinite(intersect_terrain(ORIGIN, down, level, 120.1)))
    assert np.all(np.isnan(intersect_terrain(ORIGIN, down, level, 119.9)))


def test_ground_is_unknown_beyond_the_model() -> None:
    """A hit off the model is no hit; a camera outside still sees what lies inside."""

    def known_north_of_50(north: np.ndarray, east: np.ndarray) -> np.ndarray:
        return np.where(north > 50.0, 0.0, np.nan)

    south, inside = np.array((-0.2, 0.0, 1.0)), np.array((1.0, 0.0, 0.9))

    points = intersect_terrain(ORIGIN, np.stack((south, inside)), known_north_of_50, 1000.0)

    assert np.all(np.isnan(points[0]))
    assert_allclose(points[1], ORIGIN + 120.0 / 0.9 * inside, atol=1e-6)
    # This one goes below zero before the model begins: nobody knows where it went in.
    short = np.array((30.0, 0.0, 120.0))
    assert np.all(np.isnan(intersect_terrain(ORIGIN, short, known_north_of_50, 1000.0)))


@pytest.mark.parametrize(("max_range_m", "step_m"), [(math.inf, 1.0), (100.0, 0.0), (math.nan, 1.0)])
def test_refuses_a_march_without_end(max_range_m: float, step_m: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        intersect_terrain(ORIGIN, _fan(0.1), _hills, max_range_m, step_m)


def test_slope_of_the_hills() -> None:
    ne = np.array([[[10.0, 20.0], [-30.0, 55.0]]])
    north, east = ne[..., 0], ne[..., 1]

    by_north = -15.0 / 60.0 * np.cos(north / 60.0) * np.cos(east / 45.0)
    by_east = 15.0 / 45.0 * np.sin(north / 60.0) * np.sin(east / 45.0)
    assert_allclose(terrain_slope(_hills, ne, 0.5), np.stack((by_north, by_east), axis=-1), atol=1e-5)


slopes = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)).map(np.array)
looks = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.just(1.0)).map(np.array)


@given(looks, slopes, vectors(1.0), vectors(1.0))
def test_jacobian_is_the_derivative_of_the_intersection(
    look: np.ndarray, slope: np.ndarray, move: np.ndarray, turn: np.ndarray
) -> None:
    """Against central differences of the ray cut with the tilted plane, the ray turned by Exp(dtheta)."""
    step = 1e-5
    point = _tilted_point(ORIGIN, look, slope, 3.0)

    def moved(sign: float) -> np.ndarray:
        ray = matrix_from_q(q_from_rotvec(sign * step * turn)) @ look
        return _tilted_point(ORIGIN + sign * step * move, ray, slope, 3.0)[:2]

    numeric = (moved(1.0) - moved(-1.0)) / (2.0 * step)
    analytic = ray_ground_jacobian(ORIGIN, look, point, slope) @ np.concatenate((move, turn))
    # Points lie up to 1 km away, where the differences keep about seven digits.
    assert_allclose(analytic, numeric, rtol=2e-6, atol=2e-5)


def test_jacobian_straight_down() -> None:
    """120 m up: north moves north, pitching the nose up (about east) moves the point ahead by 120 m per radian."""
    jacobian = ray_ground_jacobian(ORIGIN, np.array((0.0, 0.0, 5.0)), np.array((10.0, -20.0, 0.0)))

    expected = [[1.0, 0.0, 0.0, 0.0, 120.0, 0.0], [0.0, 1.0, 0.0, -120.0, 0.0, 0.0]]
    assert_allclose(jacobian, expected, atol=1e-12)


def test_covariance_is_that_of_a_cloud_of_points() -> None:
    """
    Model: poses, pixels and ground heights drawn from their covariances, each ray cut with the tilted ground.
    Expected: the sample covariance of the points, within what 200 000 samples allow (1 % of the largest).
    """
    rng = np.random.default_rng(7)
    count, ground_std, pixel_std = 200_000, 2.5, 0.004
    slope, ray, down = np.array((0.1, -0.2)), np.array((0.6, 0.3, 1.0)), 3.0
    root = rng.normal(size=(6, 6)) * np.array((1.0, 1.0, 1.0, 0.004, 0.004, 0.004))[:, np.newaxis]
    cov_pose = root @ root.T
    point = _tilted_point(ORIGIN, ray, slope, down)

    pose = rng.normal(size=(count, 6)) @ root.T
    # A turn about all three axes moves the ray only across itself, the same each way.
    turned = np.einsum("nij,nj->ni", matrix_from_q(q_from_rotvec(rng.normal(0.0, pixel_std, (count, 3)))), ray[None])
    rays = np.einsum("nij,nj->ni", matrix_from_q(q_from_rotvec(pose[:, 3:])), turned)
    origins = ORIGIN + pose[:, :3]
    along = (down + rng.normal(0.0, ground_std, count) + origins[:, :2] @ slope - origins[:, 2]) / (
        rays[:, 2] - rays[:, :2] @ slope
    )
    sampled = np.cov((origins + along[:, np.newaxis] * rays).T)

    found = ground_point_covariance(ORIGIN, ray, point, slope, cov_pose, pixel_std, ground_std)
    assert_allclose(found, sampled, rtol=0.0, atol=0.01 * np.max(sampled))
    assert_allclose(found, found.T, atol=0.0)
    assert np.all(np.linalg.eigvalsh(found) > 0.0)


def test_height_of_the_ground_moves_an_oblique_point_along_the_ray() -> None:
    ray = np.array((2.0, 0.0, 1.0))
    point = intersect_plane(ORIGIN, ray, 0.0)

    cov = ground_point_covariance(ORIGIN, ray, point, None, np.zeros((6, 6)), 0.0, 3.0)

    assert_allclose(np.sqrt(np.diag(cov)), (6.0, 0.0, 3.0))
    assert cov[0, 2] == pytest.approx(18.0)


def test_pixel_noise_straight_down_is_a_circle() -> None:
    point = np.array((10.0, -20.0, 0.0))

    cov = ground_point_covariance(ORIGIN, np.array((0.0, 0.0, 1.0)), point, None, np.zeros((6, 6)), 0.002, 0.0)

    assert_allclose(cov, np.diag((0.24**2, 0.24**2, 0.0)), atol=1e-15)


def test_many_points_at_once_equal_one_by_one() -> None:
    rays = _fan(0.7, 4).reshape(-1, 3)
    points = intersect_plane(ORIGIN, rays, 0.0)
    slope = np.array((0.1, 0.05))
    cov_pose = np.diag((1.0, 1.0, 2.0, 1e-4, 1e-4, 3e-4))

    found = ground_point_covariance(ORIGIN, rays, points, slope, cov_pose, 0.001, 1.5)

    assert found.shape == (16, 3, 3)
    single = ground_point_covariance(ORIGIN, rays[5], points[5], slope, cov_pose, 0.001, 1.5)
    assert_allclose(found[5], single)
    assert ray_ground_jacobian(ORIGIN, rays, points, slope).shape == (16, 2, 6)


def test_rays_that_do_not_enter_the_ground_have_no_covariance() -> None:
    ray = np.array((1.0, 0.0, -0.1))

    cov = ground_point_covariance(ORIGIN, ray, ORIGIN + ray, None, np.eye(6), 0.001, 1.0)

    assert np.all(np.isnan(cov))
    # Going down, but along a slope that falls faster.
    ray, slope = np.array((1.0, 0.0, 0.1)), np.array((0.2, 0.0))
    assert np.all(np.isnan(ray_ground_jacobian(ORIGIN, ray, ORIGIN + ray, slope)))


def _level_point(pose_error: np.ndarray, ray: np.ndarray, height_m: float) -> np.ndarray:
    """North and east where a ray meets level ground, its camera moved and turned by a pose error (6,)."""
    camera = np.array([0.0, 0.0, -height_m]) + pose_error[:3]
    turned = matrix_from_q(q_from_rotvec(pose_error[3:])) @ ray
    return (camera + turned * (-camera[2] / turned[2]))[:2]


@pytest.mark.parametrize("slope_ne", [(0.0, 0.0), (0.4, -0.7), (-1.2, 0.05), (0.9, 1.6)])
@pytest.mark.parametrize("height_m", [12.0, 140.0])
def test_ground_point_by_pose_agrees_with_finite_differences(slope_ne: tuple[float, float], height_m: float) -> None:
    # the ray's length must not matter
    ray = 3.0 * np.array([*slope_ne, 1.0])
    step = 1e-5
    numeric = np.stack(
        [
            (_level_point(step * e, ray, height_m) - _level_point(-step * e, ray, height_m)) / (2.0 * step)
            for e in np.eye(6)
        ],
        axis=-1,
    )

    # a hundred metres times a step of 1e-5 squared: truncation far below a millimetre per radian
    assert_allclose(ground_point_by_pose(np.array(slope_ne), np.array(height_m)), numeric, rtol=1e-6, atol=1e-5)


def test_ground_point_by_pose_of_the_nadir_ray() -> None:
    """Straight down from 50 m: rolling right about north moves the point west, pitching about east moves it north."""
    expected = [[1.0, 0.0, 0.0, 0.0, 50.0, 0.0], [0.0, 1.0, 0.0, -50.0, 0.0, 0.0]]

    assert_allclose(ground_point_by_pose(np.zeros(2), np.array(50.0)), expected, atol=1e-12)


def test_ground_point_by_pose_is_that_of_level_ground_for_any_leading_shape() -> None:
    rays = _fan(1.0, count=5)
    origin = np.array([0.0, 0.0, -80.0])
    points = origin + 80.0 * rays

    by_pose = ground_point_by_pose(rays[..., :2], np.full((5, 5), 80.0))

    assert by_pose.shape == (5, 5, 2, 6)
    assert_allclose(by_pose, ray_ground_jacobian(origin, rays, points), rtol=1e-9, atol=1e-9)
