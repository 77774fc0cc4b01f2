from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_euler, q_from_matrix, q_from_rotvec, q_multiply
from estimator.targets.ray import locate_ray
from estimator.types import Mode, NavigationState

FRAME = LocalFrame(np.deg2rad(47.2), np.deg2rad(8.6), 420.0)
CAMERA = Camera(640, 480, 520.0, 522.0, 315.0, 243.0, (-0.15, 0.05, 0.001, -0.0005, -0.006))
NADIR_TOP_NORTH = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
POS = np.array([60.0, -35.0, -120.0])


class Slope:
    """Ground that rises ten per cent to the north, five to the west; nothing is known beyond 400 m east."""

    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.where(east_m > 400.0, np.nan, 420.0 + 0.1 * north_m - 0.05 * east_m)


class Unknown:
    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.full(np.shape(north_m), np.nan)


def _state(ned_from_camera: np.ndarray = NADIR_TOP_NORTH, cov: np.ndarray | None = None) -> NavigationState:
    q = q_from_matrix(ned_from_camera)
    lat, lon, alt = FRAME.geodetic_from_ned(POS)
    return NavigationState(
        t_us=0,
        mode=Mode.VISION,
        process_model="inertial",
        lat_rad=float(lat),
        lon_rad=float(lon),
        alt_amsl_m=float(alt),
        alt_agl_m=112.0,
        pos_ned_m=POS,
        vel_ned_m_s=np.zeros(3),
        q_ned_from_body=np.array([1.0, 0.0, 0.0, 0.0]),
        q_ned_from_camera=q,
        cov_pos_ned_m2=np.eye(3),
        cov_vel_ned_m2_s2=np.eye(3),
        cov_attitude_rad2=np.eye(3) * 1e-4,
        cov_camera_pose=np.diag([4.0, 4.0, 1.0, 1e-4, 1e-4, 4e-4]) if cov is None else cov,
        last_fix_age_s=0.5,
    )


def _pixel_of(point_ned_m: np.ndarray, ned_from_camera: np.ndarray) -> tuple[float, float]:
    u, v = CAMERA.project((point_ned_m - POS) @ ned_from_camera)
    return float(u), float(v)


@pytest.mark.parametrize("point_ne_m", [(60.0, -35.0), (85.0, -60.0), (70.0, -20.0)])
@pytest.mark.parametrize("tilt_rad", [0.0, 0.35])
def test_projected_ground_point_is_found_again(point_ne_m: tuple[float, float], tilt_rad: float) -> None:
    ned_from_camera = matrix_from_euler(0.1, tilt_rad, 0.3) @ NADIR_TOP_NORTH
    point = np.array([*point_ne_m, -0.1 * point_ne_m[0] + 0.05 * point_ne_m[1]])

    target = locate_ray(_state(ned_from_camera), CAMERA, _pixel_of(point, ned_from_camera), Slope(), FRAME, 1.0)

    assert target.method == "ray_terrain"
    assert_allclose(target.pos_ned_m, point, atol=0.02)
    assert_allclose(
        FRAME.ned_from_geodetic(target.lat_rad, target.lon_rad, target.alt_amsl_m), target.pos_ned_m, atol=1e-6
    )


def test_top_of_the_picture_lies_ahead_and_right_is_right() -> None:
    """Nadir with the top to the north: up in the picture is north, right is east."""
    up = locate_ray(_state(), CAMERA, (315.0, 100.0), Slope(), FRAME, 1.0)
    right = locate_ray(_state(), CAMERA, (500.0, 243.0), Slope(), FRAME, 1.0)

    assert up.pos_ned_m[0] > POS[0] + 20.0
    assert right.pos_ned_m[1] > POS[1] + 20.0


def test_height_above_ground_raises_the_point() -> None:
    """What stands 15 m high is met earlier on an oblique ray."""
    ned_from_camera = matrix_from_euler(0.0, 0.6, 0.0) @ NADIR_TOP_NORTH
    uv = (315.0, 243.0)

    low = locate_ray(_state(ned_from_camera), CAMERA, uv, Slope(), FRAME, 1.0)
    high = locate_ray(_state(ned_from_camera), CAMERA, uv, Slope(), FRAME, 1.0, height_above_ground_m=15.0)

    ground_alt = Slope().alt_amsl_m(high.pos_ned_m[0], high.pos_ned_m[1])
    assert high.alt_amsl_m == pytest.approx(float(ground_alt) + 15.0, abs=0.05)
    assert np.linalg.norm(high.pos_ned_m - POS) < np.linalg.norm(low.pos_ned_m - POS)


def test_unknown_terrain_falls_back_on_the_height_below() -> None:
    target = locate_ray(_state(), CAMERA, (400.0, 300.0), Unknown(), FRAME, 5.0)

    assert target.method == "ray_flat"
    assert target.pos_ned_m[2] == pytest.approx(POS[2] + 112.0)


@pytest.mark.parametrize("tilt_rad", [0.0, 0.5])
def test_covariance_agrees_with_drawn_errors(tilt_rad: float) -> None:
    """Camera pose, pixel and ground height drawn from their stated errors: the spread is the stated covariance."""
    rng = np.random.default_rng(6)
    ned_from_camera = matrix_from_euler(0.0, tilt_rad, 0.0) @ NADIR_TOP_NORTH
    state, uv, ground_std_m = _state(ned_from_camera), (350.0, 260.0), 1.5
    target = locate_ray(state, CAMERA, uv, Slope(), FRAME, ground_std_m)
    ends = []
    for _ in range(500):
        error = rng.multivariate_normal(np.zeros(6), state.cov_camera_pose)
        q = q_multiply(q_from_rotvec(error[3:]), state.q_ned_from_camera)
        disturbed = replace(state, pos_ned_m=POS + error[:3], q_ned_from_camera=q)
        pixel = (uv[0] + float(rng.normal()), uv[1] + float(rng.normal()))
        raised = float(rng.normal(0.0, ground_std_m))
        ends.append(locate_ray(disturbed, CAMERA, pixel, Slope(), FRAME, 1.0, 1.0, raised).pos_ned_m)

    spread = np.cov((np.array(ends) - target.pos_ned_m).T)
    # standard deviations over 500 draws are good to 3 %, correlations to 0.045
    assert_allclose(np.sqrt(np.diag(spread)[:2]), np.sqrt(np.diag(target.cov_ned_m2)[:2]), rtol=0.13)
    correlation = target.cov_ned_m2[0, 1] / np.sqrt(target.cov_ned_m2[0, 0] * target.cov_ned_m2[1, 1])
    assert np.corrcoef(np.array(ends)[:, :2].T)[0, 1] == pytest.approx(correlation, abs=0.15)


def test_pixel_outside_the_picture_is_refused() -> None:
    with pytest.raises(GeometryError, match="outside the 640 x 480"):
        locate_ray(_state(), CAMERA, (640.0, 10.0), Slope(), FRAME, 1.0)
    with pytest.raises(GeometryError, match="outside"):
        locate_ray(_state(), CAMERA, (float("nan"), 10.0), Slope(), FRAME, 1.0)


def test_ray_above_the_horizon_is_refused() -> None:
    level = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

    with pytest.raises(GeometryError, match="horizon"):
        locate_ray(_state(level), CAMERA, (315.0, 20.0), Unknown(), FRAME, 1.0)


def test_ground_beyond_the_range_is_refused() -> None:
    oblique = matrix_from_euler(0.0, 1.3, 0.0) @ NADIR_TOP_NORTH

    with pytest.raises(GeometryError, match="200 m"):
        locate_ray(_state(oblique), CAMERA, (315.0, 243.0), Unknown(), FRAME, 1.0, max_range_m=200.0)


def _unsure(state: NavigationState) -> NavigationState:
    """With a lever and a ground bias whose error goes with the camera's height, as after a fix on the map."""
    joint = np.diag([4.0, 4.0, 1.0, 1e-4, 1e-4, 4e-4, 1.2])
    joint[2, 6] = joint[6, 2] = 1.0
    return replace(
        state, lever_ned_m=np.array([0.4, -0.3, 0.2]), ground_bias_m=-3.0, cov_camera_pose=joint[:6, :6],
        cov_ground_bias=joint[6],
    )  # fmt: skip


def test_the_ray_starts_at_the_lens_and_meets_the_ground_where_the_filter_has_it() -> None:
    ned_from_camera = matrix_from_euler(0.1, 0.5, 0.3) @ NADIR_TOP_NORTH
    state = _unsure(_state(ned_from_camera))
    lens = POS + state.lever_ned_m
    north, east = 110.0, -20.0
    point = np.array([north, east, -0.1 * north + 0.05 * east - 3.0])  # three metres above the model
    u, v = CAMERA.project((point - lens) @ ned_from_camera)

    target = locate_ray(state, CAMERA, (float(u), float(v)), Slope(), FRAME, 1.0)

    assert_allclose(target.pos_ned_m, point, atol=0.02)


def test_the_covariance_is_that_of_many_poses_and_grounds() -> None:
    """Pose and ground bias drawn from their joint covariance, rays cut again: what is scattered is what is said."""
    ned_from_camera = matrix_from_euler(0.0, 0.6, 0.0) @ NADIR_TOP_NORTH
    state = _unsure(_state(ned_from_camera))
    assert state.cov_ground_bias is not None
    joint = np.zeros((7, 7))
    joint[:6, :6], joint[6], joint[:, 6] = state.cov_camera_pose, state.cov_ground_bias, state.cov_ground_bias
    uv = (300.0, 200.0)
    stated = locate_ray(state, CAMERA, uv, Slope(), FRAME, 0.0, pixel_std_px=0.0)
    rng = np.random.default_rng(5)
    places = []
    for error in rng.multivariate_normal(np.zeros(7), joint, 1500, method="cholesky"):
        turned = q_multiply(q_from_rotvec(error[3:6]), state.q_ned_from_camera)
        other = replace(
            state, pos_ned_m=POS + error[:3], q_ned_from_camera=turned, ground_bias_m=state.ground_bias_m + error[6]
        )
        places.append(locate_ray(other, CAMERA, uv, Slope(), FRAME, 0.0).pos_ned_m)

    scatter = np.cov(np.array(places).T)

    assert_allclose(scatter, stated.cov_ned_m2, atol=0.1 * np.trace(stated.cov_ned_m2))
    # height and ground err together: less than the height alone would move the place
    alone = locate_ray(replace(state, cov_ground_bias=None), CAMERA, uv, Slope(), FRAME, 0.0, pixel_std_px=0.0)
    assert stated.cov_ned_m2[0, 0] < alone.cov_ned_m2[0, 0] - 0.2


def test_the_parts_of_the_covariance_are_the_click_and_the_height() -> None:
    state = _state(matrix_from_euler(0.0, 0.6, 0.0) @ NADIR_TOP_NORTH, np.zeros((6, 6)))
    target = locate_ray(state, CAMERA, (300.0, 200.0), Slope(), FRAME, 1.5, pixel_std_px=2.0)
    higher = locate_ray(state, CAMERA, (300.0, 200.0), Slope(), FRAME, 0.0, 0.0, height_above_ground_m=1.5)

    assert_allclose(target.cov_ned_m2, target.cov_pixel_m2 + np.outer(target.height_way_m, target.height_way_m))
    assert_allclose(target.height_way_m[:2], (target.pos_ned_m - higher.pos_ned_m)[:2], atol=0.01)
