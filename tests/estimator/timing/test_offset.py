import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

from estimator.geometry.rotation import matrix_from_euler
from estimator.timing.offset import OffsetConfig, OffsetEstimate, PictureTurns, estimate_offset, offset_steps
from estimator.timing.turns import TurnTrack
from tests.estimator.timing.synthetic import NADIR, Motion, turns_and_track

# what a test knows exactly has no floors
EXACT = OffsetConfig(sensor_delay_std_s=0.0, boresight_floor_rad=0.0)
BORESIGHT_RAD = np.radians([0.8, -1.2, 0.6])


def _estimate(seed: int, motion: Motion, offset_s: float, rates: CubicSpline | None = None) -> OffsetEstimate:
    turns, track = turns_and_track(seed, motion, offset_s, BORESIGHT_RAD, rates)
    return estimate_offset(turns, track, NADIR, EXACT)


@pytest.mark.parametrize("offset_s", [-0.5, -0.13, 0.0, 0.27, 0.5])
def test_offset_and_boresight_come_back_with_their_signs(offset_s: float) -> None:
    """Exposure = frame time + offset; body_from_camera = Exp(boresight) mount."""
    found = _estimate(1, Motion(), offset_s)

    assert found.observable, found.reason
    assert found.offset_s == pytest.approx(offset_s, abs=0.003)
    # 4 sigma of a quarter degree over 30 s
    assert_allclose(np.degrees(found.boresight_rad), np.degrees(BORESIGHT_RAD), atol=1.0)
    assert found.correlation > 0.99


@pytest.mark.parametrize(
    "motion",
    [
        Motion(),
        Motion(time_constant_s=1.0),
        Motion(picture_noise_correlation=0.8),
        Motion(rate_std_rad_s=(0.0005, 0.0005, 0.1)),
        Motion(sensor_hz=10.0),
        Motion(length_s=6.0),
    ],
    ids=["plain", "slow", "correlated noise", "yaw alone", "10 Hz", "6 s"],
)
def test_errors_match_their_sigmas(motion: Motion) -> None:
    """Over 60 seeds: unit variance of the offset's error, and of the boresight's where it is excited."""
    errors, misaligned = [], []
    for seed in range(60):
        offset_s = float(np.random.default_rng(900 + seed).uniform(-0.5, 0.5))
        found = _estimate(seed, motion, offset_s)
        assert found.observable, (seed, found.reason)
        errors.append((found.offset_s - offset_s) / found.std_s)
        misaligned.append((found.boresight_rad - BORESIGHT_RAD) / np.sqrt(np.diag(found.cov_boresight_rad2)))

    # the standard deviation of 60 normal numbers has a standard deviation of 0.09; correlated noise costs some
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.35
    assert np.abs(errors).max() < 5.0
    assert np.sqrt(np.mean(np.square(misaligned))) < 1.5


@pytest.mark.parametrize(
    ("name", "rates"),
    [
        ("hover", (0.0, 0.0, 0.0)),
        ("constant turn", (0.02, -0.05, 0.3)),
    ],
)
def test_motion_that_tells_nothing_is_admitted(name: str, rates: tuple[float, float, float]) -> None:
    """No change of rate: the sigma is near that of not knowing, and no error over 30 seeds is beyond three of it."""
    motion = Motion()
    steady = CubicSpline([-5.0, 0.0, 20.0, 40.0], np.tile(rates, (4, 1)))
    for seed in range(30):
        found = _estimate(seed, motion, 0.2, steady)
        assert not found.observable
        assert found.std_s > 0.2
        assert abs(found.offset_s - 0.2) < 3.0 * found.std_s
        assert "motion" in found.reason or "edge" in found.reason or "unlike" in found.reason


def test_steady_turn_about_one_axis_leaves_the_boresight_at_its_prior() -> None:
    steady = CubicSpline([-5.0, 0.0, 20.0, 40.0], np.tile((0.0, 0.0, 0.3), (4, 1)))

    found = _estimate(3, Motion(), 0.0, steady)

    assert np.degrees(np.sqrt(np.diag(found.cov_boresight_rad2))).min() > 1.5


def test_weak_slow_motion_is_not_overrated() -> None:
    """Rates of 0.01 rad/s that change over a second, within the sensor's noise: 3 sigma hold over 30 seeds."""
    motion = Motion(rate_std_rad_s=(0.01, 0.01, 0.005), time_constant_s=1.0)
    for seed in range(30):
        found = _estimate(seed, motion, -0.1)
        assert abs(found.offset_s + 0.1) < 3.0 * found.std_s


def test_three_short_manoeuvres_in_long_rest_are_enough() -> None:
    """Rest is most of it, so that what is usual says nothing of what there is to see."""
    t_s = np.arange(-5.0, 40.0, 0.01)
    bursts = sum(np.exp(-0.5 * ((t_s - at_s) / 0.25) ** 2) for at_s in (6.0, 14.0, 25.0))
    rates = CubicSpline(t_s, np.outer(bursts, (0.2, -0.3, 0.5)))
    errors = []
    for seed in range(20):
        found = _estimate(seed, Motion(), -0.4, rates)
        assert found.observable, found.reason
        assert found.std_s < 0.005
        errors.append((found.offset_s + 0.4) / found.std_s)

    assert np.sqrt(np.mean(np.square(errors))) < 1.5


def test_repeating_motion_is_ambiguous() -> None:
    """A pure oscillation of 0.8 s fits as well one period off: the sigma says so, whichever minimum is taken."""
    t_s = np.arange(-5.0, 40.0, 0.01)
    phase = math.tau * t_s / 0.8
    rates = CubicSpline(t_s, 0.1 * np.stack((np.sin(phase), np.cos(phase), np.sin(phase + 1.0)), axis=-1))

    found = _estimate(4, Motion(), 0.05, rates)

    assert not found.observable
    assert found.std_s > 0.3


def test_offset_beyond_the_search_is_not_claimed() -> None:
    found = _estimate(5, Motion(), 1.4)

    assert not found.observable
    assert found.std_s > 0.2


def test_outliers_are_shrugged_off() -> None:
    """A tenth of the turns is nonsense, as behind a passing bird or a damaged picture."""
    turns, track = turns_and_track(6, Motion(), 0.31, BORESIGHT_RAD)
    rotvec = turns.rotvec_camera_rad.copy()
    rotvec[::10] += np.random.default_rng(7).normal(0.0, 0.05, size=rotvec[::10].shape)
    spoilt = PictureTurns(turns.first_s, turns.second_s, rotvec, turns.cov_rotvec_rad2)

    found = estimate_offset(spoilt, track, NADIR, EXACT)

    assert found.observable
    assert found.offset_s == pytest.approx(0.31, abs=0.004)


def test_wrong_mount_is_noticed() -> None:
    """The camera is said to look up and looks down: two of three axes turn the other way."""
    turns, track = turns_and_track(8, Motion(), 0.0, np.zeros(3))
    stated = matrix_from_euler(math.pi, 0.0, 0.0) @ NADIR

    found = estimate_offset(turns, track, stated, EXACT)

    assert not found.observable
    assert "mount" in found.reason


def test_floors_are_in_the_sigmas() -> None:
    turns, track = turns_and_track(9, Motion(), 0.0, np.zeros(3))

    found = estimate_offset(turns, track, NADIR, OffsetConfig(sensor_delay_std_s=0.02, boresight_floor_rad=0.05))

    assert 0.02 < found.std_s < 0.021
    assert np.sqrt(np.diag(found.cov_boresight_rad2)).min() > 0.05


def test_too_few_pairs_say_so() -> None:
    turns, track = turns_and_track(10, Motion(), 0.0, np.zeros(3))

    found = estimate_offset(turns.where(np.arange(len(turns)) < 20), track, NADIR, EXACT)

    assert not found.observable
    assert found.pairs == 20
    assert "too few" in found.reason
    assert found.std_s == pytest.approx(1.0 / math.sqrt(3.0))


def test_work_in_steps_gives_the_same_and_no_step_is_long() -> None:
    """A minute at 16 turns a second, each turn looked at for some 400 offsets: no step does a tenth of it."""
    turns, track = turns_and_track(3, Motion(length_s=60.0, frames_per_s=16.0), 0.2, BORESIGHT_RAD)
    looked = []

    class Watched(TurnTrack):
        def turned(self, from_s, to_s):  # type: ignore[no-untyped-def]
            looked.append(len(from_s))
            return super().turned(from_s, to_s)

    watched = Watched(track._angle, 0.5)
    steps, in_step = offset_steps(turns, watched, NADIR, EXACT), []
    while True:
        before = sum(looked)
        try:
            next(steps)
        except StopIteration as end:
            found = end.value
            break
        in_step.append(sum(looked) - before)

    assert max(in_step) < 0.1 * sum(looked)
    at_once = estimate_offset(turns, track, NADIR, EXACT)
    assert (found.offset_s, found.std_s) == (at_once.offset_s, at_once.std_s)
