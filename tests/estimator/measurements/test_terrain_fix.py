import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.camera import Mount
from estimator.measurements.camera_attitude import CameraAttitude, CameraAttitudeModel, Gimbal
from estimator.measurements.terrain_fix import apparent_position_jacobian, heading, height
from tests.estimator.measurements.filters import general_filter, numeric_jacobian

GROUND_DOWN_M = 12.0


def _camera(eskf) -> CameraAttitude:
    model = CameraAttitudeModel(Mount(0.1, -1.3, 0.2, np.zeros(3)), Gimbal.FIXED)
    return model.at(0, eskf.nominal.motion.q_ned_from_body, eskf.nominal.boresight_rad)


def _seen(eskf, ray_camera: np.ndarray) -> np.ndarray:
    """Ground point (3,) that a ray of the camera meets."""
    ray = _camera(eskf).ned_from_camera @ ray_camera
    pos = eskf.nominal.motion.pos_ned_m
    return pos + ray * (GROUND_DOWN_M - pos[2]) / ray[2]


@pytest.mark.parametrize("ray_camera", [(0.0, 0.0, 1.0), (0.3, -0.2, 1.0)])
def test_apparent_position_agrees_with_finite_differences(ray_camera: tuple[float, float, float]) -> None:
    eskf = general_filter()
    ray = np.array(ray_camera)

    H = apparent_position_jacobian(eskf, _camera(eskf), _seen(eskf, ray), eskf.nominal.motion.pos_ned_m)

    # a hundred metres times a step of 1e-5 squared: truncation far below a millimetre per radian
    assert_allclose(H, numeric_jacobian(lambda other: _seen(other, ray)[:2]), rtol=1e-5, atol=1e-4)


def test_heading_is_the_cameras_turn_about_the_vertical() -> None:
    eskf = general_filter()
    innovation = heading(eskf, _camera(eskf), 0.02, 0.005)

    assert_allclose(innovation.z, [0.02])
    assert_allclose(innovation.H[:, eskf.layout.slices["attitude"]], [[0.0, 0.0, 1.0]], atol=1e-12)
    eskf.update(innovation.z, innovation.H, innovation.R)
    assert heading(eskf, _camera(eskf), 0.0, 0.005).H.any()


def test_larger_scale_means_higher() -> None:
    """Two per cent of 100 m: two metres up."""
    eskf = general_filter()
    innovation = height(eskf, 100.0, 0.02, 1e-6)

    eskf.update(innovation.z, innovation.H, innovation.R)

    assert eskf.nominal.motion.pos_ned_m[2] == pytest.approx(-92.0, abs=1e-3)
