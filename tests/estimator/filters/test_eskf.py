from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.nominal import Clone, Layout, Nominal
from estimator.filters.strapdown import Motion
from estimator.geometry.rotation import (
    matrix_from_q,
    q_conjugate,
    q_from_euler,
    q_from_rotvec,
    q_multiply,
    rotvec_from_q,
)
from tests.estimator.filters.eskf_cases import EARTH, FULL, QUIET, nominal_state, quiet_filter

RATE = np.array([0.12, -0.2, 0.35])
FORCE = np.array([1.4, -0.8, -10.6])


def _turn(q_to: np.ndarray, q_from: np.ndarray) -> np.ndarray:
    """Rotation about the NED axes that takes ``q_from`` to ``q_to``."""
    return rotvec_from_q(q_multiply(q_to, q_conjugate(q_from)))


def _difference(to: Nominal, of: Nominal) -> np.ndarray:
    """Error state (n,) that moves ``of`` onto ``to``, written out by hand."""
    assert to.clone is not None
    assert of.clone is not None
    assert to.keyframe is not None
    assert of.keyframe is not None
    assert to.pad is not None
    assert of.pad is not None
    return np.concatenate(
        (
            to.motion.pos_ned_m - of.motion.pos_ned_m,
            to.motion.vel_ned_m_s - of.motion.vel_ned_m_s,
            _turn(to.motion.q_ned_from_body, of.motion.q_ned_from_body),
            to.accelerometer_bias_m_s2 - of.accelerometer_bias_m_s2,
            to.gyroscope_bias_rad_s - of.gyroscope_bias_rad_s,
            [to.barometer_bias_m - of.barometer_bias_m],
            to.boresight_rad - of.boresight_rad,
            to.attitude_bias_rad - of.attitude_bias_rad,
            to.ground_biases_m - of.ground_biases_m,
            to.map_bias_ne_m - of.map_bias_ne_m,
            to.map_region_ne_m - of.map_region_ne_m,
            to.map_offset_ne_m - of.map_offset_ne_m,
            to.gnss_bias_ne_m - of.gnss_bias_ne_m,
            to.clone.pos_ned_m - of.clone.pos_ned_m,
            _turn(to.clone.q_ned_from_camera, of.clone.q_ned_from_camera),
            to.keyframe.pos_ned_m - of.keyframe.pos_ned_m,
            _turn(to.keyframe.q_ned_from_camera, of.keyframe.q_ned_from_camera),
            to.structure_m - of.structure_m,
            to.pad.pos_ned_m - of.pad.pos_ned_m,
            _turn(to.pad.q_ned_from_pad, of.pad.q_ned_from_pad),
        )
    )


def _moved(nominal: Nominal, dx: np.ndarray) -> Nominal:
    """The nominal state with an error put in: an update that trusts its measurement fully."""
    eskf = quiet_filter(np.eye(FULL.size), nominal)
    eskf.update(dx, np.eye(FULL.size), np.eye(FULL.size) * 1e-18)
    return eskf.nominal


def _transition(dt_s: float) -> np.ndarray:
    """The F that predict_inertial uses, read off F P F' column by column."""
    F = np.empty((FULL.size, FULL.size))
    for i in range(FULL.size):
        u = np.eye(FULL.size)[i]
        eskf = quiet_filter(np.outer(u, u))
        eskf.predict_inertial(RATE, FORCE, dt_s)
        # P is (F u)(F u)' here, and F's diagonal is positive
        F[:, i] = eskf.P[:, i] / np.sqrt(eskf.P[i, i])
    return F


def test_transition_agrees_with_finite_differences_of_the_strapdown() -> None:
    """
    Every column of F against the nominal propagation of a disturbed state.

    The filter's F leaves out terms of second order in the step, and that a faster aircraft forgets more of the ground's
    biases: at 5 ms they are below 1e-4 of a unit.
    """
    dt_s, step = 0.005, 1e-5
    F = _transition(dt_s)
    numeric = np.empty_like(F)
    for i in range(FULL.size):
        ends = []
        for sign in (1.0, -1.0):
            eskf = quiet_filter(np.eye(FULL.size), _moved(nominal_state(), sign * step * np.eye(FULL.size)[i]))
            eskf.predict_inertial(RATE, FORCE, dt_s)
            ends.append(eskf.nominal)
        numeric[:, i] = _difference(ends[0], ends[1]) / (2.0 * step)

    assert_allclose(F, numeric, atol=2e-4)
    # and the blocks that matter are far above that tolerance
    assert np.abs(numeric[3:6, 6:9]).max() > 0.04
    assert np.abs(numeric[6:9, 12:15]).max() > 4e-3


def test_injection_moves_every_group_by_its_correction() -> None:
    dx = np.random.default_rng(1).normal(0.0, 0.01, size=FULL.size)

    assert_allclose(_difference(_moved(nominal_state(), dx), nominal_state()), dx, atol=1e-9)


@pytest.mark.parametrize("part", [0, 1, 2])
def test_innovation_that_is_not_finite_changes_nothing(part: int) -> None:
    """Fault: NaN in innovation, Jacobian or noise. Expected: rejected, the estimate as it was."""
    eskf = ErrorStateFilter(nominal_state(), np.eye(FULL.size), FULL, EARTH, QUIET)
    measurement = [np.ones(1), FULL.jacobian(1, position=np.ones((1, 3))), np.eye(1)]
    measurement[part] = measurement[part] * np.nan

    accepted, nis = eskf.update(*measurement)

    assert not accepted
    assert np.isnan(nis)
    assert_allclose(eskf.P, np.eye(FULL.size))
    assert_allclose(eskf.nominal.motion.pos_ned_m, nominal_state().motion.pos_ned_m)


def test_a_learned_map_offset_moves_the_map_and_nothing_else() -> None:
    root = np.random.default_rng(3).normal(size=(FULL.size, FULL.size))
    eskf = quiet_filter(root @ root.T)
    before, P = eskf.nominal, eskf.P.copy()

    eskf.learn_map_offset(np.array([3.0, 4.0]), 1.5)

    rest = np.ones(FULL.size, dtype=bool)
    rest[FULL.slices["map_offset"]] = False
    assert_allclose(_difference(eskf.nominal, before)[~rest], [3.0, 4.0])
    assert_allclose(_difference(eskf.nominal, before)[rest], 0.0, atol=1e-12)
    assert_allclose(eskf.P[np.ix_(rest, rest)], P[np.ix_(rest, rest)])
    assert_allclose(eskf.cov("map_offset"), 2.25 * np.eye(2))
    assert_allclose(eskf.P[np.ix_(~rest, rest)], 0.0)


def test_a_copy_goes_its_own_way() -> None:
    eskf = quiet_filter(np.eye(FULL.size))
    other = eskf.copied()
    other.inflate("position", 1.0)
    other.predict_inertial(RATE, FORCE, 0.1)

    assert_allclose(eskf.P, np.eye(FULL.size))
    assert_allclose(eskf.nominal.motion.pos_ned_m, nominal_state().motion.pos_ned_m)


def test_attitude_correction_turns_about_the_ned_axes() -> None:
    """A tenth of a radian about down changes the yaw by as much, whatever roll and pitch are."""
    dx = np.zeros(FULL.size)
    dx[FULL.slices["attitude"]] = [0.0, 0.0, 0.1]

    moved = matrix_from_q(_moved(nominal_state(), dx).motion.q_ned_from_body)
    before = matrix_from_q(nominal_state().motion.q_ned_from_body)

    yaw = np.arctan2(moved[1, 0], moved[0, 0]) - np.arctan2(before[1, 0], before[0, 0])
    assert yaw == pytest.approx(0.1, abs=1e-9)
    assert_allclose(moved[2], before[2], atol=1e-9)


def test_an_innovation_is_tallied_and_gated_by_what_one_reading_errs_by() -> None:
    """
    Nine readings in a row say one thing: R is nine times the 1 m^2 that one errs by, beside a prior of 3 m^2.

    Four metres are 16 / (3 + 1) of a normalised square. What the filter makes of them is by R: a gain of 3 / 12.
    """
    eskf = quiet_filter(np.eye(FULL.size) * 3.0)
    H = FULL.jacobian(1, position=np.array([[1.0, 0.0, 0.0]]))
    before = eskf.nominal.motion.pos_ned_m[0]

    accepted, nis = eskf.update(np.array([4.0]), H, np.array([[9.0]]), 25.0, "fix", np.array([[1.0]]))

    assert accepted
    assert nis == pytest.approx(4.0)
    assert eskf.innovations["fix"].nis_per_dof == pytest.approx(4.0)
    assert eskf.nominal.motion.pos_ned_m[0] - before == pytest.approx(4.0 * 3.0 / 12.0)
    refused = quiet_filter(np.eye(FULL.size) * 3.0)
    assert not refused.update(np.array([12.0]), H, np.array([[9.0]]), 25.0, "fix", np.array([[1.0]]))[0]
    assert_allclose(refused.P, np.eye(FULL.size) * 3.0)


def test_accepted_innovations_are_tallied_by_what_was_measured() -> None:
    eskf = quiet_filter(np.zeros((FULL.size, FULL.size)))
    H = FULL.jacobian(2, position=np.eye(3)[:2])
    for z in ([1.0, 2.0], [3.0, 0.0]):
        eskf.update(np.array(z), H, np.eye(2) * 4.0, what="fix")
    eskf.update(np.array([90.0, 0.0]), H, np.eye(2), gate=25.0, what="fix")

    assert set(eskf.innovations) == {"fix"}
    assert eskf.innovations["fix"].numbers == 4
    assert eskf.innovations["fix"].nis_per_dof == pytest.approx((5.0 + 9.0) / 4.0 / 4.0)


def test_rejected_innovation_leaves_the_state_alone() -> None:
    eskf = quiet_filter(np.eye(FULL.size))
    before = eskf.nominal

    accepted, nis = eskf.update(
        np.array([50.0]), FULL.jacobian(1, position=np.array([[1.0, 0.0, 0.0]])), np.eye(1), 9.0
    )

    assert not accepted
    assert np.isnan(nis)
    assert eskf.nominal is before
    assert_allclose(eskf.P, np.eye(FULL.size))


def test_a_keyframe_hands_its_errors_and_the_old_ones_to_the_structure() -> None:
    """The new structure's covariance against the same linear map written out, with the old keyframe in it."""
    rng = np.random.default_rng(5)
    root = rng.normal(0.0, 1.0, (FULL.size, FULL.size))
    eskf = quiet_filter(root @ root.T)
    before = eskf.P.copy()
    by_pose, cov = rng.normal(0.0, 1.0, (3, 12)), np.diag([0.1, 0.2, 0.3])
    by_state = FULL.jacobian(3, attitude=np.eye(3), boresight=matrix_from_q(nominal_state().motion.q_ned_from_body))
    camera = Clone(eskf.nominal.motion.pos_ned_m + 1.0, q_from_euler(0.0, -1.5, 0.4))

    eskf.take_keyframe(camera, by_state, by_pose, cov)

    poses = np.concatenate((
        FULL.jacobian(3, keyframe_position=np.eye(3)), FULL.jacobian(3, keyframe_rotation=np.eye(3)),
        FULL.jacobian(3, position=np.eye(3)), by_state,
    ))  # fmt: skip
    assert_allclose(eskf.cov("structure"), by_pose @ poses @ before @ poses.T @ by_pose.T + cov, rtol=1e-9)
    assert_allclose(
        eskf.cov("structure", "velocity"), (by_pose @ poses @ before)[:, FULL.slices["velocity"]], rtol=1e-9
    )
    assert_allclose(eskf.cov("keyframe_rotation"), by_state @ before @ by_state.T, rtol=1e-9)
    assert_allclose(eskf.nominal.structure_m, 0.0)
    assert eskf.nominal.keyframe is camera


def test_a_keyframe_without_structure_leaves_the_old_one() -> None:
    eskf = quiet_filter(np.eye(FULL.size))
    camera = Clone(eskf.nominal.motion.pos_ned_m, q_from_euler(0.0, -1.5, 0.4))
    eskf.take_keyframe(camera, np.zeros((3, FULL.size)), None, None)
    assert_allclose(eskf.cov("structure"), np.eye(3))
    assert_allclose(eskf.nominal.structure_m, nominal_state().structure_m)


def test_a_filter_without_keyframes_takes_none() -> None:
    layout = Layout.of(("position", "velocity", "attitude", "clone_position", "clone_rotation"))
    eskf = ErrorStateFilter(nominal_state(), np.eye(layout.size), layout, EARTH, QUIET)
    before = eskf.nominal.keyframe
    eskf.take_keyframe(Clone(np.zeros(3), q_from_euler(0.0, 0.0, 0.0)), np.zeros((3, layout.size)), None, None)
    assert eskf.nominal.keyframe is before
    assert_allclose(eskf.P, np.eye(layout.size))


def test_clone_is_fully_correlated_with_the_present() -> None:
    """Right after cloning, the displacement since the picture is known exactly, however uncertain the position."""
    rng = np.random.default_rng(2)
    root = rng.normal(size=(FULL.size, FULL.size))
    eskf = quiet_filter(root @ root.T)
    by_state = FULL.jacobian(3, attitude=np.eye(3), boresight=matrix_from_q(nominal_state().motion.q_ned_from_body))
    expected = by_state @ eskf.P @ by_state.T

    eskf.clone(Clone(eskf.nominal.motion.pos_ned_m, q_from_euler(0.0, -1.5, 0.4)), by_state)

    displacement = FULL.jacobian(3, position=np.eye(3), clone_position=-np.eye(3))
    assert_allclose(displacement @ eskf.P @ displacement.T, 0.0, atol=1e-9)
    turn = by_state - FULL.jacobian(3, clone_rotation=np.eye(3))
    assert_allclose(turn @ eskf.P @ turn.T, 0.0, atol=1e-9)
    assert_allclose(eskf.cov("clone_rotation"), expected)


def test_a_doubted_place_is_not_made_sure_again_by_the_way_since_the_last_picture() -> None:
    """Variance 0.25 raised by 36; odometry then tells the way since the clone to a centimetre, which says no place."""
    eskf = quiet_filter(np.diag(np.full(FULL.size, 0.25)))
    nominal = eskf.nominal
    camera = Clone(nominal.motion.pos_ned_m, nominal.motion.q_ned_from_body)
    turned = FULL.jacobian(3, attitude=np.eye(3))
    eskf.clone(camera, turned)
    eskf.take_keyframe(camera, turned, None, None)
    vertical_m2 = eskf.cov("position")[2, 2]

    eskf.doubt_place(np.diag([36.0, 4.0]))
    for clone in ("clone_position", "keyframe_position"):
        H = FULL.jacobian(3, **{"position": np.eye(3), clone: -np.eye(3)})
        eskf.update(np.zeros(3), H, np.eye(3) * 1e-4)

    assert_allclose(eskf.cov("position")[:2, :2], np.diag([36.25, 4.25]), rtol=1e-6, atol=1e-9)
    assert eskf.cov("position")[2, 2] == pytest.approx(vertical_m2)


def test_relative_measurement_bounds_velocity_and_not_position() -> None:
    """
    Forty exact-model odometry steps: the position's variance may only grow, by no more than what the steps allow.

    Without the clone, each displacement would be taken for independent knowledge of the position and shrink it.
    """
    P = np.diag(np.full(FULL.size, 1e-8))
    P[FULL.slices["position"], FULL.slices["position"]] = np.eye(3) * 25.0
    P[FULL.slices["velocity"], FULL.slices["velocity"]] = np.eye(3) * 4.0
    level = replace(nominal_state().motion, q_ned_from_body=np.array([1.0, 0.0, 0.0, 0.0]))
    eskf = quiet_filter(P, replace(nominal_state(), motion=level), ProcessNoise())
    hover = np.array([0.0, 0.0, -EARTH.gravity_m_s2])
    H = FULL.jacobian(2, position=np.eye(3)[:2], clone_position=-np.eye(3)[:2])
    variances = []
    for _ in range(40):
        eskf.clone(Clone(eskf.nominal.motion.pos_ned_m, np.array([1.0, 0.0, 0.0, 0.0])), np.zeros((3, FULL.size)))
        for _ in range(10):
            eskf.predict_inertial(np.zeros(3), hover, 0.02)
        eskf.update(np.zeros(2), H, np.eye(2) * 0.05**2)
        variances.append(eskf.cov("position")[0, 0])

    assert min(variances) > 25.0 - 1e-6
    # 40 independent steps of 5 cm, and the interval before the first measurement
    assert variances[-1] < 25.0 + 1.0
    assert eskf.cov("velocity")[0, 0] < 0.1


def test_attitude_driven_prediction_moves_by_velocity_and_takes_the_attitude() -> None:
    P = np.zeros((FULL.size, FULL.size))
    P[FULL.slices["velocity"], FULL.slices["velocity"]] = np.eye(3)
    eskf = quiet_filter(P, noise=ProcessNoise(manoeuvre_m_s2_rt_s=(2.0, 2.0, 1.0)))
    q = q_from_euler(0.1, 0.0, -2.0)
    start = eskf.nominal.motion

    for _ in range(20):
        eskf.predict_attitude_driven(q, np.array([0.01, 0.01, 0.03]), 60.0, 0.1)

    assert_allclose(eskf.nominal.motion.pos_ned_m, start.pos_ned_m + 2.0 * start.vel_ned_m_s)
    assert_allclose(eskf.nominal.motion.q_ned_from_body, q)
    # random walk of velocity: variance q t in velocity, t^2 + q t^3 / 3 in position; each step's noise comes without
    # its cross term between the two, which for 20 steps is 5 % of the position's variance
    assert eskf.cov("velocity")[0, 0] == pytest.approx(1.0 + 4.0 * 2.0)
    assert eskf.cov("position")[0, 0] == pytest.approx(4.0 + 4.0 * 8.0 / 3.0, rel=0.06)
    assert eskf.cov("attitude")[2, 2] == pytest.approx(0.03**2 * (1.0 - np.exp(-2.0 * 2.0 / 60.0)), rel=1e-6)


def test_layout_drops_absent_groups_and_names_unknown_ones() -> None:
    layout = Layout.of(("attitude", "position", "velocity"))

    assert layout.size == 9
    assert layout.slices["attitude"] == slice(6, 9)
    assert_allclose(layout.jacobian(1, boresight=np.ones((1, 3)), velocity=np.ones((1, 3)))[0, 3:6], 1.0)
    assert not layout.jacobian(1, boresight=np.ones((1, 3))).any()
    with pytest.raises(ValueError, match="wind"):
        Layout.of(("position", "wind"))


def _run(seed: int, seconds: float) -> list[float]:
    """
    NEES of position, velocity and attitude over one simulated flight of the filter's own model.

    The truth flies a turn; its readings get white noise and biases drawn from the filter's own numbers, and a position
    measurement comes each second. The stated noise is the true noise: a consistent filter's NEES is nine.
    """
    rng = np.random.default_rng(seed)
    noise = ProcessNoise()
    groups = ("position", "velocity", "attitude", "accelerometer_bias", "gyroscope_bias")
    layout = Layout.of(groups)
    std = np.repeat([2.0, 0.5, 0.02, 0.1, 0.003], 3)
    zero = np.zeros(3)
    motion = Motion(np.array([0.0, 0.0, -100.0]), np.array([15.0, 0.0, 0.0]), q_from_euler(0.1, 0.02, 0.0))
    error = rng.normal(0.0, std)
    start = Motion(
        motion.pos_ned_m - error[:3],
        motion.vel_ned_m_s - error[3:6],
        q_multiply(q_from_rotvec(-error[6:9]), motion.q_ned_from_body),
    )
    # a second, noiseless filter is the world: its nominal state is the truth
    world = ErrorStateFilter(Nominal(motion, zero, zero, 0.0, zero, zero), np.zeros((15, 15)), layout, EARTH, QUIET)
    eskf = ErrorStateFilter(Nominal(start, zero, zero, 0.0, zero, zero), np.diag(std**2), layout, EARTH, noise)
    accelerometer_bias, gyroscope_bias = error[9:12], error[12:15]
    dt_s = 0.05
    H = layout.jacobian(3, position=np.eye(3))
    nees = []
    for k in range(int(seconds / dt_s)):
        rate = np.array([0.0, 0.01, 0.1]) + 0.1 * np.sin(0.02 * k * np.array([1.0, 1.3, 0.7]))
        force = np.array([0.4 * np.sin(0.05 * k), 0.9, -EARTH.gravity_m_s2])
        world.predict_inertial(rate, force, dt_s)
        accelerometer_bias = accelerometer_bias + rng.normal(size=3) * noise.accelerometer_bias_m_s2_rt_s * dt_s**0.5
        gyroscope_bias = gyroscope_bias + rng.normal(size=3) * noise.gyroscope_bias_rad_s_rt_s * dt_s**0.5
        eskf.predict_inertial(
            rate + gyroscope_bias + rng.normal(size=3) * noise.gyroscope_rad_rt_s / dt_s**0.5,
            force + accelerometer_bias + rng.normal(size=3) * noise.accelerometer_m_s2_rt_s / dt_s**0.5,
            dt_s,
        )
        truth, now = world.nominal.motion, eskf.nominal.motion
        if k % 20 == 19:
            z = truth.pos_ned_m + rng.normal(0.0, 1.5, size=3) - now.pos_ned_m
            eskf.update(z, H, np.eye(3) * 1.5**2)
            now = eskf.nominal.motion
            e = np.concatenate(
                (
                    truth.pos_ned_m - now.pos_ned_m,
                    truth.vel_ned_m_s - now.vel_ned_m_s,
                    _turn(truth.q_ned_from_body, now.q_ned_from_body),
                )
            )
            nees.append(float(e @ np.linalg.solve(eskf.P[:9, :9], e)))
    return nees


def test_errors_match_their_covariance_over_seeds() -> None:
    nees = np.array([_run(seed, 15.0) for seed in range(30)])

    # 30 independent flights: the mean of a chi-square of nine degrees over 30 has a deviation of sqrt(18 / 30) = 0.77
    assert nees.mean() == pytest.approx(9.0, abs=2.3)
    assert nees[:, -1].mean() == pytest.approx(9.0, abs=2.3)
