"""Standing or moving, where and how fast: against truth, over seeds, with errors that last."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.targets.motion import MotionConfig, MotionState, PlaceSighting, TargetMotion, _driven
from estimator.types import Float

OWN_M, SLOW_M, ALIKE_S = 0.15, 2.0, 20.0


def _sightings(path: Float, dt_s: float, rng: np.random.Generator, slow_m: float = SLOW_M) -> list[PlaceSighting]:
    """What a pose that errs for long makes of places (n, 2)."""
    slow = slow_m * rng.standard_normal(2)
    keep = np.exp(-dt_s / ALIKE_S)
    out = []
    for k, place in enumerate(path):
        slow = keep * slow + np.sqrt(1.0 - keep**2) * slow_m * rng.standard_normal(2)
        seen = np.array([*(place + slow + OWN_M * rng.standard_normal(2)), -80.0])
        out.append(
            PlaceSighting(round(k * dt_s * 1e6), seen, OWN_M**2 * np.eye(2), slow_m**2 * np.eye(2) + 1e-9 * np.eye(2))
        )
    return out


def _followed(path: Float, dt_s: float, seed: int, slow_m: float = SLOW_M) -> list[MotionState]:
    motion = TargetMotion()
    return [motion.update(one) for one in _sightings(path, dt_s, np.random.default_rng(seed), slow_m)]


def _driving(n: int, dt_s: float, speed: float = 10.0) -> tuple[Float, Float]:
    """Straight on, then a bend of 90 degrees with a radius of 40 m, then straight."""
    t = np.arange(n) * dt_s
    course = np.clip((t - 0.5 * t[-1]) * speed / 40.0, 0.0, np.pi / 2)
    vel = speed * np.stack((np.cos(course), np.sin(course)), axis=-1)
    return np.cumsum(vel * dt_s, axis=0), vel


def test_an_erring_pose_does_not_make_a_parked_car_drive() -> None:
    said = [[s.moving for s in _followed(np.zeros((300, 2)), 0.2, seed)] for seed in range(6)]
    assert sum(any(one is True for one in run) for run in said) == 0
    assert all(run[-1] is False for run in said)


def test_a_car_that_drives_is_said_to_within_three_seconds() -> None:
    path, _ = _driving(100, 0.2)
    for seed in range(4):
        states = _followed(path, 0.2, seed)
        assert any(s.moving for s in states[:15])
        assert all(s.moving for s in states[15:])


def test_place_and_velocity_err_as_they_say() -> None:
    path, vel = _driving(150, 0.2)
    place_nees, vel_nees, vel_miss, pos_miss = [], [], [], []
    for seed in range(30):
        states = _followed(path, 0.2, seed, slow_m=1.0)
        for k in range(20, 150, 10):
            miss, miss_vel = states[k].pos_ned_m[:2] - path[k], states[k].vel_ne_m_s - vel[k]
            place_nees.append(miss @ np.linalg.solve(states[k].cov_pos_ne_m2, miss))
            vel_nees.append(miss_vel @ np.linalg.solve(states[k].cov_vel_ne_m2_s2, miss_vel))
            vel_miss.append(np.sum(miss_vel**2))
            pos_miss.append(np.sum(miss**2))
    # two numbers each: a consistent filter has 2; a bend is not the models' white acceleration
    assert 1.2 < np.mean(place_nees) < 2.8
    assert 0.6 < np.mean(vel_nees) < 3.0
    assert np.sqrt(np.mean(vel_miss)) < 1.0
    assert np.sqrt(np.mean(pos_miss)) < 1.6


def test_many_sightings_from_one_pose_do_not_make_the_place_sure() -> None:
    state = _followed(np.zeros((100, 2)), 0.1, 3)[-1]
    # ten seconds are half the time in which the pose forgets its error
    assert np.sqrt(np.diag(state.cov_pos_ne_m2)).min() > 0.7 * SLOW_M


def test_a_parked_car_gets_better_over_many_correlation_times() -> None:
    state = _followed(np.zeros((400, 2)), 1.0, 4)[-1]
    assert np.sqrt(np.diag(state.cov_pos_ne_m2)).max() < 0.5 * SLOW_M
    assert np.hypot(*state.pos_ned_m[:2]) < 3.0 * SLOW_M * 0.5


def test_a_car_that_stops_is_said_to_stand() -> None:
    path, _ = _driving(60, 0.2)
    path = np.vstack((path, np.tile(path[-1], (100, 1))))
    states = _followed(path, 0.2, 5, slow_m=0.5)
    assert states[55].moving is True
    assert states[-1].moving is False


def test_a_fast_car_is_not_said_to_stand_as_soon_as_its_sightings_stay_in_one_place() -> None:
    path, _ = _driving(60, 0.2)
    for seed in range(6):
        states = _followed(np.vstack((path, np.tile(path[-1], (3, 1)))), 0.2, seed, slow_m=0.5)
        assert states[59].moving is True
        assert states[-1].moving is True


def test_models_change_as_their_rates_say() -> None:
    c = MotionConfig()
    rates = np.array([
        [0.0, 0.3 * c.start_rate, 0.7 * c.start_rate],
        [0.3 * c.stop_rate, 0.0, c.manoeuvre_rate],
        [c.stop_rate, c.settle_rate, 0.0],
    ])  # fmt: skip
    rates -= np.diag(rates.sum(axis=1))
    for dt_s in (0.0, 0.2, 13.0):
        chances = np.array([0.0, 1.0, 0.0]) @ expm(rates * dt_s)
        motion = TargetMotion()
        # at rest, so that nothing keeps it from standing
        motion.update(PlaceSighting(0, np.zeros(3), 0.01 * np.eye(2), 0.01 * np.eye(2)))
        motion._chances = np.array([0.0, 1.0, 0.0])
        assert motion.at(round(dt_s * 1e6)).moving_probability == pytest.approx(1.0 - chances[0], abs=1e-9)


def test_prediction_goes_on_and_grows_unsure() -> None:
    path, _ = _driving(40, 0.2)
    motion = TargetMotion()
    for one in _sightings(path, 0.2, np.random.default_rng(6), 0.3):
        last = motion.update(one)
    later = motion.at(last.t_us + 4_000_000)
    np.testing.assert_allclose(later.seen_ne_m, last.seen_ne_m + 4.0 * last.seen_vel_ne_m_s, atol=1.5)
    assert np.linalg.det(later.cov_pos_ne_m2) > 10.0 * np.linalg.det(last.cov_pos_ne_m2)
    assert len(motion.track) == 40  # asking changes nothing


def test_a_false_sighting_is_held_down() -> None:
    motion = TargetMotion()
    sightings = _sightings(np.zeros((100, 2)), 0.2, np.random.default_rng(7), 0.3)
    for one in sightings[:80]:
        motion.update(one)
    before = motion.track[-1].pos_ned_m[:2]
    wrong = sightings[80]
    state = motion.update(
        PlaceSighting(wrong.t_us, wrong.pos_ned_m + np.array([40.0, 0.0, 0.0]), wrong.own_ne_m2, wrong.slow_ne_m2)
    )
    assert np.hypot(*(state.pos_ned_m[:2] - before)) < 25.0
    for one in sightings[81:]:
        state = motion.update(one)
    assert np.hypot(*state.pos_ned_m[:2]) < 1.5


def test_a_car_that_turned_about_unseen_goes_as_it_was_watched_to_go() -> None:
    path, _ = _driving(40, 0.2)
    sightings = _sightings(path, 0.2, np.random.default_rng(8), 0.3)
    blind, told = TargetMotion(), TargetMotion()
    for one in sightings:
        last = blind.update(one)
        told.update(one)
    back = -0.5 * last.seen_vel_ne_m_s
    there = replace(sightings[-1], t_us=last.t_us + 12_000_000, pos_ned_m=last.pos_ned_m + np.array([8.0, 3.0, 0.0]))
    before = blind.update(there)
    after = told.update(replace(there, vel_ne_m_s=back, vel_std_m_s=0.7))
    assert np.hypot(*(after.vel_ne_m_s - back)) < 1.0 < np.hypot(*(before.vel_ne_m_s - back))
    assert after.moving is True
    covariance = after.cov_ne
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    assert np.linalg.det(covariance) < np.linalg.det(before.cov_ne)
    np.testing.assert_allclose(after.pos_ned_m, before.pos_ned_m, atol=0.5)


@pytest.mark.parametrize("forget_s", [np.inf, 60.0, 5.0])
def test_noise_of_damped_motion_is_the_integral(forget_s: float) -> None:
    dt_s, psd, rate = 1.7, 4.0, 0.0 if np.isinf(forget_s) else 1.0 / forget_s
    A = np.array([[0.0, 1.0], [0.0, -rate]])
    # Van Loan 1978
    block = np.zeros((4, 4))
    block[:2, :2], block[:2, 2:], block[2:, 2:] = -A, np.diag([0.0, psd]), A.T
    whole = expm(block * dt_s)
    F = whole[2:, 2:].T
    Q = F @ whole[:2, 2:]
    place, keep, noise = _driven(dt_s, psd, forget_s)
    assert place[0, 0] == pytest.approx(F[0, 1], rel=1e-9)
    assert keep[0, 0] == pytest.approx(F[1, 1], rel=1e-9)
    np.testing.assert_allclose(noise, np.kron(Q, np.eye(2)), rtol=1e-7)


def test_bad_input_is_refused_and_loses_nothing() -> None:
    motion = TargetMotion()
    with pytest.raises(ValueError, match="no sighting"):
        motion.at(0)
    first, second = _sightings(np.zeros((2, 2)), 1.0, np.random.default_rng(0))
    motion.update(second)
    with pytest.raises(ValueError, match="order"):
        motion.update(first)
    with pytest.raises(ValueError, match="past"):
        motion.at(0)
    assert len(motion.track) == 1
    with pytest.raises(ValueError, match="finite"):
        PlaceSighting(0, np.array([np.nan, 0.0, 0.0]), np.eye(2), np.eye(2))
    with pytest.raises(ValueError, match="positive"):
        PlaceSighting(0, np.zeros(3), np.zeros((2, 2)), np.eye(2))
    with pytest.raises(ValueError, match="velocity"):
        replace(first, vel_ne_m_s=np.array([1.0, np.inf]))
    with pytest.raises(ValueError, match="velocity"):
        replace(first, vel_ne_m_s=np.zeros(2), vel_std_m_s=0.0)
    with pytest.raises(ValueError, match="say_standing"):
        MotionConfig(say_standing=0.99)
    with pytest.raises(ValueError, match="positive"):
        MotionConfig(alike_s=0.0)
