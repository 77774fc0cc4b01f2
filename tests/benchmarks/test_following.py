"""How the cars of the study drive, how its navigation errs, and what its figures count."""

import numpy as np
import pytest

from benchmarks.following import LEVELS, Outcome, summary
from benchmarks.following_scenes import PACE_S, SPEED_M_S, Disturbance, NavigationErrors, Pose, _drive
from estimator.geometry.rotation import q_from_matrix, rotvec_from_q
from estimator.types import Float


def _bent_road() -> Float:
    along = np.arange(0.0, 300.0)
    return np.stack((along, 30.0 * np.sin(along / 60.0)), axis=-1)


def test_a_car_drives_at_its_speed_where_it_looks_and_keeps_to_the_road() -> None:
    line = _bent_road()
    path = _drive(line, 0.1, 1.0, 3000)
    step = np.diff(path.ne_m, axis=0) / PACE_S
    speed = np.hypot(step[:, 0], step[:, 1])
    assert speed.max() < SPEED_M_S + 0.3
    assert np.median(path.speed_m_s) == pytest.approx(SPEED_M_S, abs=0.5)
    moving = speed > 1.0
    off = np.angle(np.exp(1j * (np.arctan2(step[:, 1], step[:, 0]) - path.yaw_rad[:-1])))
    assert np.abs(off[moving]).max() < 0.15
    # no faster in bends, no harder on the pedals than a car can
    sideways = np.abs(np.diff(np.unwrap(path.yaw_rad))) / PACE_S * path.speed_m_s[:-1]
    assert np.quantile(sideways, 0.99) < 3.5
    assert np.abs(path.speed_m_s[25:] - path.speed_m_s[:-25]).max() / (25 * PACE_S) < 3.0
    away = np.min(np.hypot(*(path.ne_m[::50, None, :] - line[None]).transpose(2, 0, 1)), axis=1)
    assert away.max() < 20.0


def test_navigation_errs_as_much_as_it_says() -> None:
    pose = Pose(np.array([10.0, 20.0, -90.0]), np.eye(3))
    misses = []
    for seed in range(200):
        errors = NavigationErrors(seed, Disturbance(1.5, 1.0))
        told = errors.believed(pose, 0.2)
        turn = rotvec_from_q(q_from_matrix(told.ned_from_camera))
        misses.append(np.concatenate((told.pos_ned_m - pose.pos_ned_m, turn)))
    spread = np.std(misses, axis=0)
    np.testing.assert_allclose(spread, np.sqrt(np.diag(errors.cov)), rtol=0.2)


def test_navigation_errors_last() -> None:
    pose = Pose(np.zeros(3), np.eye(3))
    errors = NavigationErrors(3, LEVELS["poor"])
    track = np.array([errors.believed(pose, 0.2).pos_ned_m for _ in range(20_000)])
    lag = round(20.0 / 0.2)
    alike = [np.corrcoef(track[:-lag, k], track[lag:, k])[0, 1] for k in range(3)]
    assert np.mean(alike) == pytest.approx(np.exp(-1.0), abs=0.12)


def test_figures_count_what_was_wrong() -> None:
    one = Outcome(
        201, True, "poor", returns=4, found_again=3, wrong_again=1, sightings=10, wrong_sightings=2, in_view=16
    )
    one.absences_s, one.seconds_to_find = [5.0, 9.0], [0.4, 0.6]
    one.pos_m, one.vel_m_s, one.fast = [3.0, 4.0], [1.0, 1.0], [True, False]
    one.pos_nees, one.vel_nees, one.verdicts = [2.0, 2.0], [1.0, 3.0], [1, 0]
    one.pixel_px, one.pixel_nees, one.ms, one.search_ms = [1.0], [2.0], [3.0], [9.0]
    figures = summary([one])
    assert figures["found_again_share"] == 0.75
    assert figures["wrong_return_share"] == 0.25
    assert figures["wrong_sighting_share"] == 0.2
    assert figures["seen_share"] == 0.5
    assert figures["pos_rms_m"] == pytest.approx(np.sqrt(12.5))
    assert figures["pos_rms_fast_m"] == 3.0
    assert figures["said_moving_share"] == 0.5
