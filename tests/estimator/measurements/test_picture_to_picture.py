"""From two pictures to an innovation, with each odometer: rendered ground, real corners, known motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.nominal import STATE_GROUPS, Clone, Layout, Nominal
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.camera import Mount
from estimator.geometry.rotation import q_from_euler, q_from_matrix
from estimator.measurements.camera_attitude import CameraAttitude, CameraAttitudeModel, Gimbal
from estimator.measurements.innovation import Innovation
from estimator.measurements.picture_to_picture import OdometryConfig, VisualOdometry
from estimator.measurements.visual_odometry import SurfaceConfig
from estimator.odometry.odometers import ODOMETERS
from tests.estimator.registration.textured_map import CAMERA, seen_by

MODEL = CameraAttitudeModel(Mount(0.0, -np.pi / 2, 0.0, np.zeros(3)), Gimbal.FIXED)
FIRST, SECOND = np.array([5.0, -8.0, -100.0]), np.array([9.0, -5.0, -99.5])
Q_FIRST, Q_SECOND = q_from_euler(0.03, -0.05, 0.8), q_from_euler(-0.02, 0.04, 0.86)
LAYOUT = Layout.of(STATE_GROUPS)


def flat(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
    return np.zeros_like(north_m)


def camera_of(q_ned_from_body: np.ndarray) -> CameraAttitude:
    return MODEL.at(0, q_ned_from_body, np.zeros(3))


def filter_after(first: np.ndarray, now: np.ndarray) -> ErrorStateFilter:
    """A filter that had its first picture where it truly was, and believes itself at ``now``."""
    zero = np.zeros(3)
    clone = Clone(first, q_from_matrix(camera_of(Q_FIRST).ned_from_camera))
    nominal = Nominal(Motion(now, zero, Q_SECOND), zero, zero, 0.0, zero, zero, clone=clone)
    return ErrorStateFilter(nominal, np.eye(LAYOUT.size), LAYOUT, EarthModel.at(0.8, 300.0), ProcessNoise())


@pytest.mark.parametrize("method", sorted(ODOMETERS))
def test_pictures_tell_how_far_the_prediction_is_off(method: str) -> None:
    """
    Fault: the filter believes itself 1.5 m north and 1 m west of where it is.
    Expected: the innovation says so within a few of its own sigmas and a tenth of a metre or two.
    """
    error = np.array([1.5, -1.0, 0.0])
    odometry = VisualOdometry(CAMERA, OdometryConfig(method))
    pictures = [seen_by(p, camera_of(q).ned_from_camera) for p, q in ((FIRST, Q_FIRST), (SECOND, Q_SECOND))]
    eskf = filter_after(FIRST, SECOND + error)

    assert odometry.step(0, pictures[0], eskf, camera_of(Q_FIRST), FIRST, flat) is None
    assert odometry.took_picture
    step = odometry.step(300_000, pictures[1], eskf, camera_of(Q_SECOND), SECOND + error, flat)

    assert step is not None
    by_position = step.displacement.H[:, LAYOUT.slices["position"]][:, :2]
    to_truth = np.linalg.solve(by_position, step.displacement.z)
    missed = to_truth + error[:2]
    assert_allclose(missed, 0.0, atol=0.25)
    assert missed @ np.linalg.solve(step.displacement.R, missed) < 25.0


def test_an_unknown_odometer_is_refused_at_once() -> None:
    with pytest.raises(ValueError, match="unknown odometer 'flow'"):
        VisualOdometry(CAMERA, OdometryConfig("flow"))


def test_a_repeated_picture_is_frozen_and_says_nothing() -> None:
    odometry = VisualOdometry(CAMERA, OdometryConfig())
    picture = seen_by(FIRST, camera_of(Q_FIRST).ned_from_camera)
    eskf = filter_after(FIRST, SECOND)

    odometry.step(0, picture, eskf, camera_of(Q_FIRST), FIRST, flat)
    assert odometry.step(300_000, picture, eskf, camera_of(Q_SECOND), SECOND, flat) is None
    assert odometry.frozen
    assert not odometry.took_picture


def _flown_over_a_wrong_model(groups: tuple[str, ...]) -> float:
    """Speed error, as a share, after eight seconds over ground that the model raises by 12 m from the middle on.

    Level flight to the north at 10 m/s and 100 m, with a speed known at the beginning and poor accelerometers.
    """
    layout = Layout.of(groups)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    camera = camera_of(level)
    zero = np.zeros(3)
    start = np.array([-100.0, 0.0, -100.0])
    P = np.zeros((layout.size, layout.size))
    for name, std in (("velocity", 0.02), ("attitude", 0.002), ("ground_bias", 0.3)):
        np.einsum("ii->i", P)[layout.slices[name]] = std**2
    earth = EarthModel.at(0.8, 300.0)
    eskf = ErrorStateFilter(
        Nominal(Motion(start, np.array([10.0, 0.0, 0.0]), level), zero, zero, 0.0, zero, zero), P, layout, earth,
        ProcessNoise(accelerometer_m_s2_rt_s=0.5),
    )  # fmt: skip
    # smooth ground would be taken for the model's
    odometry = VisualOdometry(CAMERA, OdometryConfig(surface=SurfaceConfig(bare_std_m=50.0)))

    def wrong(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.where(north_m > -50.0, -12.0, 0.0) + eskf.nominal.ground_bias_m

    def camera_now(eskf: ErrorStateFilter) -> tuple[CameraAttitude, np.ndarray]:
        motion = eskf.nominal.motion
        return MODEL.at(0, motion.q_ned_from_body, eskf.nominal.boresight_rad), motion.pos_ned_m

    def apply(what: str, innovation: Innovation | None) -> bool:
        return innovation is not None and eskf.update(innovation.z, innovation.H, innovation.R, 25.0)[0]

    for step in range(33):
        for _ in range(5 if step else 0):
            eskf.predict_inertial(zero, np.array([0.0, 0.0, -earth.gravity_m_s2]), 0.05)
        true = start + np.array([2.5 * step, 0.0, 0.0])
        odometry.fuse(step * 250_000, seen_by(true, camera.ned_from_camera), eskf, camera_now, wrong, apply)
    return float(eskf.nominal.motion.vel_ned_m_s[0] / 10.0 - 1.0)


def test_structure_carries_the_scale_over_ground_that_is_modelled_wrong() -> None:
    without = tuple(
        name for name in STATE_GROUPS if name not in ("keyframe_position", "keyframe_rotation", "structure")
    )
    kept, lost = _flown_over_a_wrong_model(STATE_GROUPS), _flown_over_a_wrong_model(without)
    assert abs(kept) < 0.012
    # the ground model takes 12 % off the height, and such accelerometers cannot tell
    assert lost < -0.03


def test_pictures_of_a_camera_that_is_being_turned_are_left_out() -> None:
    odometry = VisualOdometry(CAMERA, OdometryConfig())
    eskf = filter_after(FIRST, SECOND)
    told: list[str] = []

    def apply(name: str, innovation: Innovation | None) -> bool:
        told.append(name)
        return innovation is not None

    for t_us, slew in ((0, 0.0), (300_000, 1.0), (600_000, 0.0)):
        picture = seen_by(FIRST + np.array((t_us * 1e-6, 0.0, 0.0)), camera_of(Q_FIRST).ned_from_camera)
        camera = replace(camera_of(Q_FIRST), slew_ned_rad_s=np.array((0.0, 0.0, slew)))
        odometry.fuse(t_us, picture, eskf, lambda _, camera=camera: (camera, FIRST), flat, apply)
        assert odometry.took_picture == (slew == 0.0)

    # After the turn it begins anew.
    assert "odometry" not in told
