import math
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from estimator.geometry.camera import GIMBAL_FROM_CAMERA, Camera, Mount
from tests.authorities.stored import stored

ROWS = stored("camera_opencv")["cameras"]
PLAIN = Camera(640, 480, 700.0, 690.0, 319.5, 239.5)
MILD = Camera(640, 480, 554.3, 551.9, 322.1, 236.8, (-0.12, 0.05, 0.0008, -0.0004, -0.01))
# Barrel distortion so strong that the polynomial turns at a radius of 0.913, inside the corners of a wide picture.
FOLDING = Camera(1000, 800, 500.0, 500.0, 499.5, 399.5, (-0.4, 0.0, 0.001, -0.0005, 0.0))


def _camera(row: dict[str, Any]) -> Camera:
    names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    return Camera(*(row[name] for name in names), tuple(row["distortion"]))


def _pixels(camera: Camera, step: int = 20) -> np.ndarray:
    u, v = np.arange(0.0, camera.width_px, step), np.arange(0.0, camera.height_px, step)
    return np.stack(np.meshgrid(u, v), axis=-1)


def _pixel(camera: Camera, xy: np.ndarray) -> np.ndarray:
    return xy * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)


@pytest.mark.parametrize("row", ROWS)
def test_projection_agrees_with_opencv(row: dict[str, Any]) -> None:
    found = _camera(row).project(np.array(row["points_camera_m"]))

    assert_allclose(found, row["points_uv_px"], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("row", ROWS)
def test_undistortion_agrees_with_opencv(row: dict[str, Any]) -> None:
    found = _camera(row).undistort(np.array(row["uv_px"]))

    assert_allclose(found, row["ideal_xy"], rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("camera", [PLAIN, MILD, *map(_camera, ROWS)])
def test_every_pixel_of_a_reasonable_lens_there_and_back(camera: Camera) -> None:
    uv = _pixels(camera)

    assert_allclose(_pixel(camera, camera.distort(camera.undistort(uv))), uv, rtol=0.0, atol=1e-9)
    assert_allclose(camera.project(camera.rays(uv) * 123.0), uv, rtol=0.0, atol=1e-9)


lenses = st.builds(
    lambda k1, k2, p1, p2, k3: Camera(640, 480, 500.0, 500.0, 320.0, 240.0, (k1, k2, p1, p2, k3)),
    st.floats(-0.5, 0.5),
    st.floats(-0.3, 0.3),
    st.floats(-0.005, 0.005),
    st.floats(-0.005, 0.005),
    st.floats(-0.1, 0.1),
)


@given(lenses, st.floats(0.0, 1.2), st.floats(-math.pi, math.pi))
def test_whatever_the_lens_shows_is_found_again(camera: Camera, radius: float, bearing: float) -> None:
    """Also close to the fold: there the answer loses digits as the slope goes to zero."""
    xy = radius * np.array((math.cos(bearing), math.sin(bearing)))
    distorted = camera.distort(xy)
    assume(np.all(np.isfinite(distorted)))
    growth = (camera.distort(xy * (1.0 - 1e-6)) - distorted) @ -xy / 1e-6
    assume(growth > 0.02 * radius * radius)

    assert_allclose(camera.undistort(_pixel(camera, distorted)), xy, rtol=0.0, atol=1e-9)


@given(lenses, st.floats(-200.0, 840.0), st.floats(-200.0, 680.0))
def test_undistorted_pixels_lie_before_the_fold_or_nowhere(camera: Camera, u: float, v: float) -> None:
    uv = np.array((u, v))
    xy = camera.undistort(uv)

    if np.all(np.isnan(xy)):
        # Nothing that the lens shows may be missed: no ideal point on the same bearing reaches this pixel.
        target = (uv - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)
        assert math.isfinite(camera.max_radius)
        rim = camera.distort(0.999 * camera.max_radius * target / np.hypot(*target))
        assert not np.hypot(*rim) > np.hypot(*target) * 1.05
    else:
        assert np.hypot(*xy) < camera.max_radius
        assert_allclose(_pixel(camera, camera.distort(xy)), uv, rtol=0.0, atol=1e-7)


def test_nothing_folds_back_into_the_picture() -> None:
    """A point at 60 degrees off the axis would land inside the picture by the bare polynomial."""
    k1 = FOLDING.distortion[0]
    x = math.tan(math.radians(60.0))
    bare_u = FOLDING.cx_px + FOLDING.fx_px * x * (1.0 + k1 * x * x)
    assert abs(bare_u - FOLDING.cx_px) < FOLDING.width_px / 2

    assert FOLDING.max_radius == pytest.approx(math.sqrt(1.0 / 1.2))
    assert np.all(np.isnan(FOLDING.project(np.array((x, 0.0, 1.0)))))
    assert np.all(np.isfinite(FOLDING.project(np.array((0.85, 0.0, 1.0)))))


def test_pixels_beyond_the_lens_have_no_ray() -> None:
    uv = _pixels(FOLDING)
    rays = FOLDING.rays(uv)

    seen = np.isfinite(rays).all(axis=-1)
    assert np.all(seen == np.isfinite(rays).any(axis=-1))
    assert not seen[0, 0]
    assert seen[20, 25]
    # The picture of the radius of growth is a circle of about 0.61 focal lengths.
    reach = np.hypot(*np.moveaxis(uv - (499.5, 399.5), -1, 0)) / 500.0
    assert np.all(seen[reach < 0.6])
    assert not np.any(seen[reach > 0.62])


def test_points_behind_are_not_seen() -> None:
    points = np.array([[0.0, 0.0, -1.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [np.nan, 0.0, 1.0]])

    uv = PLAIN.project(points)

    assert np.all(np.isnan(uv[:2]))
    assert_allclose(uv[2], (319.5, 239.5))
    assert np.isnan(uv[3, 0])


def test_rays_point_right_down_forward() -> None:
    rays = PLAIN.rays(np.array([[319.5, 239.5], [639.0, 239.5], [319.5, 479.0]]))

    assert_allclose(np.linalg.norm(rays, axis=-1), 1.0)
    assert_allclose(rays[0], (0.0, 0.0, 1.0))
    assert rays[1, 0] > 0.0
    assert rays[2, 1] > 0.0
    assert np.all(np.isnan(MILD.rays(np.array((np.nan, 3.0)))))


def test_the_picture_reaches_half_a_pixel_beyond_the_outermost_centres() -> None:
    uv = np.array([[-0.5, 0.0], [-0.51, 0.0], [639.4, 479.4], [639.5, 0.0], [0.0, 479.5], [np.nan, 1.0]])

    assert PLAIN.contains(uv).tolist() == [True, False, True, False, False, False]


def test_field_of_view_spans_edge_to_edge() -> None:
    camera = Camera.from_hfov(640, 480, math.radians(60.0))

    left, right = camera.rays(np.array([[-0.5, 239.5], [639.5, 239.5]]))
    assert math.acos(float(left @ right)) == pytest.approx(math.radians(60.0))
    assert camera.fx_px == camera.fy_px


@pytest.mark.parametrize("factor", [0.5, 0.25, 0.3, 1.0, 2.0])
def test_scaled_camera_sees_what_the_resized_picture_shows(factor: float) -> None:
    """A ramp whose value is the column shows, after resizing, which column a new pixel was made from."""
    small = MILD.scaled(factor)
    ramp = np.tile(np.arange(640.0, dtype=np.float32), (480, 1))
    # Plain linear: averaging areas of a staircase is not exact when the factor is no whole fraction.
    columns = cv2.resize(ramp, (small.width_px, small.height_px), interpolation=cv2.INTER_LINEAR)[5]

    inner = np.arange(4, small.width_px - 4)
    row_full = (5.0 + 0.5) * MILD.height_px / small.height_px - 0.5
    full = np.column_stack((columns[inner].astype(float), np.full(inner.size, row_full)))
    # The ramp is float32.
    assert_allclose(small.rays(np.column_stack((inner, np.full(inner.size, 5.0)))), MILD.rays(full), atol=1e-6)


def test_matrix_is_the_projection_without_distortion() -> None:
    point = np.array((1.0, -2.0, 9.0))
    homogeneous = PLAIN.matrix @ point

    assert_allclose(PLAIN.project(point), homogeneous[:2] / homogeneous[2])


@pytest.mark.parametrize(
    "arguments",
    [
        (0, 480, 700.0, 700.0, 320.0, 240.0),
        (640, 480, 0.0, 700.0, 320.0, 240.0),
        (640, 480, 700.0, math.nan, 320.0, 240.0),
        (640, 480, 700.0, 700.0, math.inf, 240.0),
        (640, 480, 700.0, 700.0, 320.0, 240.0, (0.1, 0.2)),
        (640, 480, 700.0, 700.0, 320.0, 240.0, (0.1, 0.2, math.nan, 0.0, 0.0)),
    ],
)
def test_refuses_impossible_cameras(arguments: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match=r"size|focal|five|finite"):
        Camera(*arguments)


@pytest.mark.parametrize("hfov", [0.0, math.pi, -1.0, math.nan])
def test_refuses_impossible_fields_of_view(hfov: float) -> None:
    with pytest.raises(ValueError, match="field of view"):
        Camera.from_hfov(640, 480, hfov)


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf])
def test_refuses_impossible_scales(factor: float) -> None:
    with pytest.raises(ValueError, match="factor"):
        PLAIN.scaled(factor)


def test_nadir_mount_looks_down_with_forward_at_the_top() -> None:
    body_from_camera = Mount(0.0, -math.pi / 2, 0.0).body_from_camera

    assert_allclose(body_from_camera @ (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), atol=1e-15)  # the axis looks down
    assert_allclose(body_from_camera @ (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), atol=1e-15)  # the top is forward
    assert_allclose(body_from_camera @ (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), atol=1e-15)  # right is right


def test_forward_mount_looks_forward_with_up_at_the_top() -> None:
    body_from_camera = Mount(0.0, 0.0, 0.0).body_from_camera

    assert_allclose(body_from_camera @ (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), atol=1e-15)
    assert_allclose(body_from_camera @ (0.0, -1.0, 0.0), (0.0, 0.0, -1.0), atol=1e-15)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_mount_angles_are_those_of_aviation(roll: float, pitch: float, yaw: float) -> None:
    mount = Mount(roll, pitch, yaw)
    expected = Rotation.from_euler("ZYX", (yaw, pitch, roll)).as_matrix()

    assert_allclose(mount.body_from_gimbal, expected, atol=1e-14)
    # Tilted up by the pitch, turned right by the yaw.
    axis = mount.body_from_camera @ (0.0, 0.0, 1.0)
    assert math.asin(max(-1.0, min(1.0, -axis[2]))) == pytest.approx(pitch, abs=1e-7)
    assert math.atan2(axis[1], axis[0]) == pytest.approx(yaw, abs=1e-7)


def test_gimbal_from_camera_is_a_rotation_that_cannot_be_overwritten() -> None:
    assert np.linalg.det(GIMBAL_FROM_CAMERA) == pytest.approx(1.0)
    with pytest.raises(ValueError, match="read-only"):
        GIMBAL_FROM_CAMERA[0, 0] = 1.0


def test_mount_keeps_its_own_lever_arm() -> None:
    lever_arm = np.array((0.1, 0.0, 0.2))
    mount = Mount(lever_arm_frd_m=lever_arm)
    lever_arm[0] = 9.0

    assert_allclose(mount.lever_arm_frd_m, (0.1, 0.0, 0.2))


@pytest.mark.parametrize("lever_arm", [np.zeros(2), np.array((0.0, math.nan, 0.0))])
def test_refuses_impossible_lever_arms(lever_arm: np.ndarray) -> None:
    with pytest.raises(ValueError, match="lever arm"):
        Mount(lever_arm_frd_m=lever_arm)
