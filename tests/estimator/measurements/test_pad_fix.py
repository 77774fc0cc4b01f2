"""What a picture of a pad tells the filter: signs by finite differences, sigmas by chance, nothing counted twice."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from estimator.filters.eskf import ErrorStateFilter
from estimator.filters.nominal import STATE_GROUPS, Layout
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.rotation import matrix_from_euler, matrix_from_q, q_from_euler, q_from_matrix, rotvec_from_q
from estimator.landing.pad import circle_pad
from estimator.landing.pose import (
    BLEED_STD_PX,
    BLUR_PX2,
    BLUR_STD_PX2,
    Edges,
    PadPose,
    Solution,
    TiltPrior,
    sample_rings,
    seen,
    solve,
)
from estimator.measurements.camera_attitude import CameraAttitude, CameraAttitudeModel, Gimbal
from estimator.measurements.innovation import Innovation
from estimator.measurements.pad_fix import PadNoise, by_states, foreseen, innovation, place
from estimator.types import CameraAttitudeSample
from tests.estimator.measurements.filters import general_filter, numeric_jacobian

CAMERA = Camera(640, 480, 800.0, 800.0, 319.5, 239.5)
PAD = circle_pad("p", 1.5, 0.3)
LEVER = np.array([0.3, -0.1, 0.2])
EDGE_PX = 0.1
PLAIN = PadNoise(edge_factor=1.0, alike_s=0.0, direction_std_rad=0.0, range_share=0.0)


def _model(gimbal: Gimbal) -> CameraAttitudeModel:
    model = CameraAttitudeModel(Mount(0.0, -np.pi / 2, 0.1, LEVER), gimbal)
    model.offer(CameraAttitudeSample(0, q_from_euler(0.1, -1.4, 0.2), yaw_is_earth=False))
    return model


def _camera(eskf: ErrorStateFilter, gimbal: Gimbal = Gimbal.FIXED) -> tuple[CameraAttitude, np.ndarray]:
    motion = eskf.nominal.motion
    lens = motion.pos_ned_m + matrix_from_q(motion.q_ned_from_body) @ LEVER
    return _model(gimbal).at(0, motion.q_ned_from_body, eskf.nominal.boresight_rad), lens


def _expected(eskf: ErrorStateFilter, gimbal: Gimbal = Gimbal.FIXED) -> PadPose:
    assert eskf.nominal.pad is not None
    return foreseen(eskf.nominal.pad, *_camera(eskf, gimbal))


def _apart(one: PadPose, other: PadPose) -> np.ndarray:
    turn = Rotation.from_matrix(one.camera_from_pad @ other.camera_from_pad.T).as_rotvec()
    return np.concatenate((turn, one.pad_in_camera_m - other.pad_in_camera_m))


def _solved(pose: PadPose, prior: TiltPrior | None, rng: np.random.Generator | None = None) -> Solution:
    """The pad as its edges show it from a pose, each edge off by its own noise, and all by blur and bleeding."""
    samples = sample_rings(PAD.rings[:3], 0, 28)
    curve = seen(CAMERA, pose, samples)
    noise = -BLUR_PX2 / curve.radius_px
    if rng is not None:
        noise = rng.normal(0.0, EDGE_PX, len(samples.ring)) + rng.normal(0.0, BLEED_STD_PX) * samples.rises
        noise -= rng.normal(BLUR_PX2, BLUR_STD_PX2) / curve.radius_px
    edges = Edges.found(samples, curve, noise, np.ones(len(noise), dtype=bool))
    solution = solve(edges, pose, prior, EDGE_PX)
    assert solution is not None
    return solution


def _told(eskf: ErrorStateFilter, *solutions: Solution, noise: PadNoise = PLAIN, since_s: float = 9.0) -> Innovation:
    found = innovation(eskf, solutions, *_camera(eskf), noise, since_s)
    assert found is not None
    return found


@pytest.mark.parametrize("gimbal", list(Gimbal))
def test_jacobian_agrees_with_finite_differences(gimbal: Gimbal) -> None:
    eskf = general_filter()
    assert eskf.nominal.pad is not None
    here = _expected(eskf, gimbal)

    H = by_states(eskf, eskf.nominal.pad, *_camera(eskf, gimbal))

    numeric = numeric_jacobian(lambda e: _apart(_expected(e, gimbal), here))
    if gimbal is not Gimbal.FIXED:
        # that the yaw of a tilted body changes a little as it tilts on is left out, here as for the map
        tilt = slice(eskf.layout.slices["attitude"].start, eskf.layout.slices["attitude"].start + 2)
        H[:, tilt] = numeric[:, tilt]
    assert_allclose(H, numeric, atol=2e-5)


def test_a_pad_that_has_just_been_placed_is_where_it_was_seen() -> None:
    eskf = general_filter()
    camera, lens = _camera(eskf)
    level = PadPose(camera.ned_from_camera.T @ matrix_from_euler(0.0, 0.0, 0.8), np.array([0.4, -0.3, 12.0]))

    found = place(level, camera, lens)

    again = foreseen(found, camera, lens)
    assert_allclose(again.camera_from_pad, level.camera_from_pad, atol=1e-12)
    assert_allclose(again.pad_in_camera_m, level.pad_in_camera_m, atol=1e-12)


def test_the_tilt_that_helped_to_find_edges_does_not_count() -> None:
    """
    Fault: the tilt handed to the detector is 0.3 degrees off and said to be sure to 0.03.
    Expected: it pulls the pose, but not the innovation, nor does it make that surer.
    """
    eskf = general_filter()
    pose = _expected(eskf)
    down = pose.camera_from_pad[:, 2] + np.cross([0.005, -0.002, 0.0], pose.camera_from_pad[:, 2])
    wrong = _solved(pose, TiltPrior(down / np.linalg.norm(down), 0.0005), np.random.default_rng(4))
    free = _solved(pose, None, np.random.default_rng(4))

    z_wrong, z_free = _told(eskf, wrong), _told(eskf, free)

    assert np.linalg.norm(_apart(wrong.pose, free.pose)[:3]) > 0.003
    sigma = np.sqrt(np.diag(z_free.R))
    # linear about two poses a third of a degree apart
    assert np.all(np.abs(z_wrong.z - z_free.z) < 0.2 * sigma)
    assert_allclose(np.sqrt(np.diag(z_wrong.R)), sigma, rtol=0.1)


def _mahalanobis(z: np.ndarray, cov: np.ndarray) -> float:
    return float(z @ np.linalg.solve(cov, z))


def test_sigmas_are_right_over_many_draws() -> None:
    """Errors of vehicle, camera and pad drawn from the covariance, edges from theirs: NEES of all after one picture.

    They are small enough that products of two do not show against an edge's tenth of a pixel.
    """
    rng = np.random.default_rng(7)
    layout = Layout.of(("position", "velocity", "attitude", "boresight", "pad_position", "pad_rotation"))
    std = np.concatenate([np.full(3, s) for s in (0.005, 0.1, 0.001, 0.001, 0.005, 0.002)])
    general = general_filter()
    general.nominal = replace(general.nominal, clone=None)
    nees, nis = [], []
    for _ in range(120):
        truth = ErrorStateFilter(general.nominal, np.diag(std**2), layout, general.earth, general.noise)
        drawn = rng.normal(0.0, std)
        eskf = ErrorStateFilter(general.nominal, np.eye(layout.size), layout, general.earth, general.noise)
        eskf.update(-drawn, np.eye(layout.size), np.eye(layout.size) * 1e-18)
        eskf.P = np.diag(std**2)
        told = _told(eskf, _solved(_expected(truth), None, rng))
        nis.append(_mahalanobis(told.z, told.H @ eskf.P @ told.H.T + told.R))
        eskf.update(told.z, told.H, told.R)
        off = _error(truth, eskf)
        nees.append(_mahalanobis(off, eskf.P))

    # of 120 draws the mean of chi squared scatters by sqrt(2 n / 120): three of those, and a twentieth for bends
    assert np.mean(nis) == pytest.approx(6.0, abs=3.0 * np.sqrt(12.0 / 120.0) + 0.3)
    assert np.mean(nees) == pytest.approx(18.0, abs=3.0 * np.sqrt(36.0 / 120.0) + 0.9)


def _error(truth: ErrorStateFilter, eskf: ErrorStateFilter) -> np.ndarray:
    a, b = truth.nominal, eskf.nominal
    assert a.pad is not None
    assert b.pad is not None
    turns = [
        rotvec_from_q(q_from_matrix(matrix_from_q(p) @ matrix_from_q(q).T))
        for p, q in (
            (a.motion.q_ned_from_body, b.motion.q_ned_from_body),
            (a.pad.q_ned_from_pad, b.pad.q_ned_from_pad),
        )
    ]
    return np.concatenate((
        a.motion.pos_ned_m - b.motion.pos_ned_m, a.motion.vel_ned_m_s - b.motion.vel_ned_m_s, turns[0],
        a.boresight_rad - b.boresight_rad, a.pad.pos_ned_m - b.pad.pos_ned_m, turns[1],
    ))  # fmt: skip


def test_of_two_poses_that_look_alike_the_difference_is_noise() -> None:
    eskf = general_filter()
    pose = _expected(eskf)
    one = _solved(pose, None)
    other = replace(one, pose=one.pose.moved(np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])))
    far = replace(other, edges_cost=one.edges_cost + 100.0 * one.inflation**2)

    alike, told_apart, alone = _told(eskf, one, other), _told(eskf, one, far), _told(eskf, one)

    assert alike.z[0] == pytest.approx(0.1, abs=0.03)
    assert np.sqrt(alike.R[0, 0]) > 0.09
    assert_allclose(alike.R[3:, 3:], alone.R[3:, 3:], rtol=0.05, atol=1e-6)
    assert_allclose(told_apart.z, alone.z, atol=1e-9)
    assert_allclose(told_apart.R, alone.R, rtol=1e-6, atol=1e-12)


def test_pictures_in_a_row_say_it_once() -> None:
    eskf = general_filter()
    solution = _solved(_expected(eskf), None)
    noise = replace(PLAIN, alike_s=0.4)

    often, seldom = (_told(eskf, solution, noise=noise, since_s=s) for s in (0.05, 5.0))

    assert often.R_one is not None
    assert_allclose(often.R, often.R_one * 17.0)
    assert_allclose(seldom.R, often.R_one)


def test_before_the_pad_is_placed_there_is_nothing_to_compare() -> None:
    eskf = general_filter()
    solution = _solved(_expected(eskf), None)
    eskf.nominal = replace(eskf.nominal, pad=None)

    assert innovation(eskf, (solution,), *_camera(eskf), PLAIN, 1.0) is None
    assert set(STATE_GROUPS) >= {"pad_position", "pad_rotation"}


def test_a_gimbal_that_turns_is_believed_less_about_the_axis_of_its_turn() -> None:
    """
    Fault: the report of a gimbal that turns at 1 rad/s is 20 ms late, so that the camera is 20 mrad off.
    Expected: the covariance has just that error, of the pad's attitude and of its place, and nothing across.
    """
    eskf = general_filter()
    camera, lens = _camera(eskf)
    solution, slew = _solved(_expected(eskf), None), np.array((0.6, 0.0, 0.8))
    noise = replace(PLAIN, slew_timing_s=0.02)

    still, turning = (
        innovation(eskf, (solution,), replace(camera, slew_ned_rad_s=rate), lens, noise, 9.0)
        for rate in (np.zeros(3), slew)
    )

    assert still is not None
    assert turning is not None
    assert eskf.nominal.pad is not None
    late = replace(camera, ned_from_camera=Rotation.from_rotvec(0.02 * slew).as_matrix() @ camera.ned_from_camera)
    off = _apart(foreseen(eskf.nominal.pad, late, lens), _expected(eskf))
    assert_allclose(turning.R - still.R, np.outer(off, off), atol=0.05 * float(off @ off))
