import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.camera import Mount
from estimator.geometry.rotation import matrix_from_q, q_from_euler, q_from_matrix, rotvec_from_q
from estimator.measurements.camera_attitude import CameraAttitude, CameraAttitudeModel, Gimbal, camera_rotation_jacobian
from estimator.types import CameraAttitudeSample
from tests.estimator.measurements.filters import general_filter, numeric_jacobian

MOUNT = Mount(0.05, -1.2, 0.3, np.array([0.1, 0.0, 0.05]))


def _model(gimbal: Gimbal, report: bool, yaw_is_earth: bool) -> CameraAttitudeModel:
    model = CameraAttitudeModel(MOUNT, gimbal)
    if report:
        model.offer(CameraAttitudeSample(1_000_000, q_from_euler(0.02, -1.1, 0.4), yaw_is_earth))
    return model


def _at(model: CameraAttitudeModel, eskf) -> CameraAttitude:
    return model.at(1_000_000, eskf.nominal.motion.q_ned_from_body, eskf.nominal.boresight_rad)


@pytest.mark.parametrize(
    ("gimbal", "report", "yaw_is_earth"),
    [
        (Gimbal.FIXED, False, True),
        (Gimbal.STABILISED, False, True),
        (Gimbal.PAN_TILT, True, True),
        (Gimbal.PAN_TILT, True, False),
    ],
)
def test_jacobian_agrees_with_finite_differences(gimbal: Gimbal, report: bool, yaw_is_earth: bool) -> None:
    model = _model(gimbal, report, yaw_is_earth)
    eskf = general_filter()
    base = _at(model, eskf)

    def turn(other) -> np.ndarray:
        return rotvec_from_q(q_from_matrix(_at(model, other).ned_from_camera @ base.ned_from_camera.T))

    numeric, H = numeric_jacobian(turn), camera_rotation_jacobian(base, eskf)
    attitude = eskf.layout.slices["attitude"]
    if gimbal is not Gimbal.FIXED and not (report and yaw_is_earth):
        # roll and pitch errors of 0.2 rad and less move the yaw by their tangent, which the model leaves out
        assert_allclose(H[:, attitude], numeric[:, attitude], atol=np.tan(0.26))
        assert_allclose(H[:, attitude][:, 2], numeric[:, attitude][:, 2], atol=1e-6)
        H[:, attitude], numeric[:, attitude] = 0.0, 0.0
    assert_allclose(H, numeric, atol=1e-6)


def test_nadir_mount_looks_down_with_the_top_ahead() -> None:
    model = CameraAttitudeModel(Mount(0.0, -np.pi / 2, 0.0, np.zeros(3)), Gimbal.FIXED)

    camera = model.at(0, q_from_euler(0.0, 0.0, np.pi / 2), np.zeros(3)).ned_from_camera

    assert_allclose(camera @ [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], atol=1e-12)
    # flying east, the top of the picture (camera -y) is east and its right south
    assert_allclose(camera @ [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    assert_allclose(camera @ [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], atol=1e-12)


def test_fixed_camera_ignores_reports_and_a_gimbal_needs_fresh_ones() -> None:
    q = q_from_euler(0.1, 0.1, 0.5)
    fixed, silent = _model(Gimbal.FIXED, True, True), _model(Gimbal.FIXED, False, True)
    assert_allclose(fixed.at(1_000_000, q, np.zeros(3)).ned_from_camera, silent.at(0, q, np.zeros(3)).ned_from_camera)

    model, unreported = _model(Gimbal.PAN_TILT, True, True), _model(Gimbal.PAN_TILT, False, True)
    fresh = model.at(1_500_000, q, np.zeros(3)).ned_from_camera
    stale = model.at(9_000_000, q, np.zeros(3)).ned_from_camera

    assert_allclose(fresh @ [0.0, 0.0, 1.0], matrix_from_q(q_from_euler(0.02, -1.1, 0.4)) @ [1.0, 0.0, 0.0], atol=1e-12)
    assert_allclose(stale, unreported.at(0, q, np.zeros(3)).ned_from_camera, atol=1e-12)


def test_a_gimbal_that_turns_says_how_fast_about_the_north_east_down_axes() -> None:
    turning, stabilised, fixed = (
        CameraAttitudeModel(MOUNT, gimbal) for gimbal in (Gimbal.PAN_TILT, Gimbal.STABILISED, Gimbal.FIXED)
    )
    for t_us, yaw in ((0, 0.0), (100_000, 0.05)):
        for model in (turning, stabilised, fixed):
            model.offer(CameraAttitudeSample(t_us, q_from_euler(0.0, -1.2, yaw), yaw_is_earth=False))

    q = q_from_euler(0.0, 0.0, 1.0)
    assert_allclose(turning.at(50_000, q, np.zeros(3)).slew_ned_rad_s, (0.0, 0.0, 0.5), atol=1e-9)
    assert turning.at(50_000, q, np.zeros(3)).slew_rad_s == pytest.approx(0.5)
    assert stabilised.at(50_000, q, np.zeros(3)).slew_rad_s == 0.0
    assert fixed.at(50_000, q, np.zeros(3)).slew_rad_s == 0.0
