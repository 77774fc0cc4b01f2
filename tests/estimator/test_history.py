from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import matrix_from_q, q_from_euler, q_from_rotvec, q_multiply
from estimator.history import (
    AttitudeTrack,
    InertialTrack,
    SampleQueue,
    StateHistory,
    between,
    level_yaw_matrix,
    rotation_between,
)
from estimator.types import BarometerSample, InertialSample, Mode, NavigationState


def _state(t_us: int, north_m: float = 0.0, yaw_rad: float = 0.0, mode: Mode = Mode.GPS) -> NavigationState:
    q = q_from_euler(0.0, 0.0, yaw_rad)
    return NavigationState(
        t_us=t_us,
        mode=mode,
        process_model="inertial",
        lat_rad=0.8 + north_m / 6.37e6,
        lon_rad=0.2,
        alt_amsl_m=400.0,
        alt_agl_m=100.0,
        pos_ned_m=np.array([north_m, 0.0, -100.0]),
        vel_ned_m_s=np.array([10.0, 0.0, 0.0]),
        q_ned_from_body=q,
        q_ned_from_camera=q,
        cov_pos_ned_m2=np.eye(3) * north_m,
        cov_vel_ned_m2_s2=np.eye(3),
        cov_attitude_rad2=np.eye(3) * 1e-4,
        cov_camera_pose=np.eye(6),
        last_fix_age_s=1.0,
    )


def _times(samples: list) -> list[int]:
    return [sample.t_us for sample in samples]


def test_queue_sorts_what_arrives_in_any_order() -> None:
    queue = SampleQueue()
    for t_us in (50, 10, 40, 20, 30):
        assert queue.push(BarometerSample(t_us, 0.0))

    assert _times(list(queue.take_until(30))) == [10, 20, 30]
    assert _times(queue.pending()) == [40, 50]
    assert _times(list(queue.take_until(100))) == [40, 50]
    assert list(queue.take_until(200)) == []


def test_queue_keeps_the_order_of_arrival_at_one_time() -> None:
    queue = SampleQueue()
    for altitude in (3.0, 1.0, 2.0):
        queue.push(BarometerSample(7, altitude))

    assert [sample.pressure_alt_m for sample in list(queue.take_until(7))] == [3.0, 1.0, 2.0]


def test_late_samples_are_refused_and_counted() -> None:
    """
    Fault: a sample older than what has been processed.
    Expected: refused and counted, never handed out; one at the very horizon is still good.
    """
    queue = SampleQueue()
    list(queue.take_until(1000))

    assert not queue.push(BarometerSample(999, 0.0))
    assert queue.push(BarometerSample(1000, 0.0))
    assert queue.late == 1
    assert _times(list(queue.take_until(2000))) == [1000]


def test_horizon_never_moves_back() -> None:
    queue = SampleQueue()
    list(queue.take_until(1000))
    list(queue.take_until(500))

    assert queue.taken_until_us == 1000
    assert not queue.push(BarometerSample(700, 0.0))


def test_attitude_is_interpolated_on_the_arc() -> None:
    track = AttitudeTrack()
    track.add(1_000_000, q_from_euler(0.0, 0.0, 0.2))
    track.add(1_200_000, q_from_euler(0.0, 0.0, 0.6))

    q = track.at(1_050_000)

    assert q is not None
    assert_allclose(matrix_from_q(q), matrix_from_q(q_from_euler(0.0, 0.0, 0.3)), atol=1e-12)


def test_attitude_turns_on_past_the_newest_report_for_a_while() -> None:
    track = AttitudeTrack()
    track.add(1_000_000, q_from_euler(0.0, 0.0, 0.2))
    track.add(1_100_000, q_from_euler(0.0, 0.0, 0.3))

    q = track.at(1_200_000, max_extrapolation_us=300_000)

    assert q is not None
    assert_allclose(matrix_from_q(q), matrix_from_q(q_from_euler(0.0, 0.0, 0.4)), atol=1e-9)
    assert track.at(1_400_001, max_extrapolation_us=300_000) is None


def test_attitude_before_the_first_and_over_a_gap_is_unknown() -> None:
    track = AttitudeTrack()
    assert track.at(0) is None
    assert track.newest_t_us is None
    track.add(10_000_000, np.array([1.0, 0.0, 0.0, 0.0]))
    track.add(15_000_000, np.array([1.0, 0.0, 0.0, 0.0]))

    assert track.at(9_800_000, max_extrapolation_us=300_000) is not None
    assert track.at(9_600_000, max_extrapolation_us=300_000) is None
    assert track.at(12_000_000, max_extrapolation_us=300_000) is None
    assert track.newest_t_us == 15_000_000


def test_reports_out_of_order_find_their_place() -> None:
    track = AttitudeTrack()
    for t_us, yaw in ((0, 0.0), (200_000, 0.0), (100_000, 0.5)):
        track.add(t_us, q_from_euler(0.0, 0.0, yaw))

    assert track.newest_t_us == 200_000
    at = track.at(100_000)
    assert at is not None
    assert_allclose(at, q_from_euler(0.0, 0.0, 0.5), atol=1e-12)


def test_old_reports_are_forgotten() -> None:
    track = AttitudeTrack(keep_s=1.0)
    track.add(1_000_000, q_from_euler(0.0, 0.0, 0.5))
    for k in range(1, 100):
        track.add(1_000_000 + k * 100_000, q_from_euler(0.0, 0.0, 0.0))

    assert track.at(3_000_000) is None
    assert track.at(10_500_000) is not None


def test_state_between_two() -> None:
    before, after = _state(0, 0.0, 0.1, Mode.GPS), _state(1_000_000, 10.0, 0.5, Mode.VISION)

    early, late = between(before, after, 250_000), between(before, after, 750_000)

    assert_allclose(early.pos_ned_m, [2.5, 0.0, -100.0])
    assert_allclose(matrix_from_q(early.q_ned_from_body), matrix_from_q(q_from_euler(0.0, 0.0, 0.2)), atol=1e-12)
    assert early.t_us == 250_000
    assert early.lat_rad == pytest.approx(0.8 + 2.5 / 6.37e6, abs=1e-12)
    assert (early.mode, late.mode) == (Mode.GPS, Mode.VISION)
    assert_allclose(late.cov_pos_ned_m2, after.cov_pos_ned_m2)


def test_history_answers_only_inside_its_span() -> None:
    history = StateHistory(keep_s=10.0)
    assert history.at(0) is None
    for k in range(41):
        history.add(_state(k * 500_000, 5.0 * k))

    newest = history.at(20_000_000)
    middle = history.at(18_250_000)
    assert newest is not None
    assert newest.pos_ned_m[0] == 200.0
    assert middle is not None
    assert middle.pos_ned_m[0] == pytest.approx(182.5)
    assert history.at(20_000_001) is None
    # older than the ten seconds and the five of slack
    assert history.at(1_000_000) is None


def test_of_several_states_at_one_time_the_last_counts() -> None:
    history = StateHistory()
    history.add(_state(0))
    history.add(_state(1_000_000, 4.0))
    history.add(_state(1_000_000, 8.0))

    state = history.at(1_000_000)
    halfway = history.at(500_000)

    assert state is not None
    assert halfway is not None
    assert state.pos_ned_m[0] == 8.0
    assert halfway.pos_ned_m[0] == 4.0


def test_unknown_height_above_ground_stays_unknown() -> None:
    before, after = replace(_state(0), alt_agl_m=float("nan")), _state(1_000_000)

    assert np.isnan(between(before, after, 500_000).alt_agl_m)


def test_rotation_between_is_about_the_ned_axes() -> None:
    q = q_from_euler(0.4, -0.3, 2.0)
    turn = np.array([0.05, -0.02, 0.11])

    assert_allclose(rotation_between(q, q_multiply(q_from_rotvec(turn), q)), turn, atol=1e-12)
    # the other sign of the quaternion is the same attitude
    assert_allclose(rotation_between(q, -q_multiply(q_from_rotvec(turn), q)), turn, atol=1e-12)


def test_level_yaw_keeps_the_heading_alone() -> None:
    level = level_yaw_matrix(q_from_euler(0.5, -0.4, 1.3))

    assert_allclose(level, matrix_from_q(q_from_euler(0.0, 0.0, 1.3)), atol=1e-12)


def _reading(t_us: int, rate: float) -> InertialSample:
    return InertialSample(t_us, np.array([rate, 0.0, 0.0]), np.array([0.0, 0.0, -9.8 - rate]))


def test_inertial_readings_are_interpolated_at_the_moment_they_tell_of() -> None:
    """Stamped 10 ms late: what is stamped 20 and 40 ms was at 10 and 30 ms, and half of each at 20 ms."""
    track = InertialTrack(0.010)
    for t_us, rate in ((40_000, 3.0), (20_000, 1.0)):
        track.add(_reading(t_us, rate))

    at = track.at(20_000)

    assert at is not None
    assert_allclose(at[0], [2.0, 0.0, 0.0])
    assert_allclose(at[1], [0.0, 0.0, -11.8])


def test_inertial_readings_are_held_beyond_their_ends() -> None:
    track = InertialTrack(0.0)
    assert track.at(0) is None
    for t_us, rate in ((1000, 1.0), (2000, 2.0), (2000, 9.0)):
        track.add(_reading(t_us, rate))

    rates = [track.at(t_us) for t_us in (0, 5000)]

    assert [reading[0][0] for reading in rates if reading is not None] == [1.0, 2.0]


def test_predictions_are_kept_with_the_states_that_follow_them_and_no_longer_than_those() -> None:
    history = StateHistory(keep_s=10.0)
    for n in range(200):
        if n % 2:
            history.expect(_state(n * 100_000, north_m=1.0))
        history.add(_state(n * 100_000, north_m=2.0))

    kept = history.corrected()

    assert [each.after.t_us // 100_000 % 2 for each in kept] == [1] * len(kept)
    assert {(each.before.pos_ned_m[0], each.after.pos_ned_m[0]) for each in kept} == {(1.0, 2.0)}
    assert kept[-1].after.t_us == 19_900_000
    assert kept[0].after.t_us >= 19_900_000 - 15_000_000
    history.expect(_state(30_000_000))
    history.add(_state(30_100_000))
    assert history.corrected()[-1].after.t_us == 19_900_000


def test_the_fastest_turn_about_a_time_is_told_in_the_axes_that_turn() -> None:
    track = AttitudeTrack()
    assert_allclose(track.turning_rad_s(0), np.zeros(3))
    # Pitching up in a turned frame: still until 1.0 s, at 2 rad/s until 1.2 s, then still again.
    for t_s, pitch in ((0.8, 0.0), (0.9, 0.0), (1.0, 0.0), (1.1, 0.2), (1.2, 0.4), (1.3, 0.4), (1.4, 0.4), (1.5, 0.4)):
        track.add(round(t_s * 1e6), q_from_euler(0.0, pitch, 0.7))

    assert_allclose(track.turning_rad_s(1_150_000), (0.0, 2.0, 0.0), atol=1e-9)
    # One report further the turn may have begun before it was told.
    assert_allclose(track.turning_rad_s(950_000), (0.0, 2.0, 0.0), atol=1e-9)
    assert_allclose(track.turning_rad_s(850_000), np.zeros(3), atol=1e-9)
    assert_allclose(track.turning_rad_s(1_450_000), np.zeros(3), atol=1e-9)
    assert_allclose(track.turning_rad_s(9_000_000), np.zeros(3), atol=1e-9)
