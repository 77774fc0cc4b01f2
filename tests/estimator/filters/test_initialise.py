import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from estimator.filters.eskf import ProcessNoise
from estimator.filters.initialise import InitialConditions, InitialGuess, aligned
from estimator.filters.nominal import STATE_GROUPS, Layout
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_euler
from estimator.types import AttitudeSample, BarometerSample, GnssSample, HomeSample

FRAME = LocalFrame(0.82, 0.15, 300.0)
Q = q_from_euler(0.05, -0.02, 1.4)
LAYOUT = Layout.of(STATE_GROUPS)


def _gnss(t_us: int, vel=(5.0, -2.0, np.nan)) -> GnssSample:
    lat, lon, alt = FRAME.geodetic_from_ned(np.array([40.0, -25.0, -80.0]))
    return GnssSample(t_us, float(lat), float(lon), float(alt), np.array(vel), 2.0, 4.0, 10)


def _with(*samples, guess: InitialGuess | None = None) -> InitialConditions:
    conditions = InitialConditions(guess or InitialGuess(), FRAME)
    for sample in samples:
        conditions.offer(sample)
    return conditions


def test_satellite_fix_attitude_and_pressure_make_a_start() -> None:
    first = _with(AttitudeSample(0, Q, np.zeros(3)), BarometerSample(0, 391.0), _gnss(100_000)).ready(200_000)

    assert first is not None
    assert_allclose(first.motion.pos_ned_m, [40.0, -25.0, -80.0], atol=1e-6)
    # the vertical speed was not reported
    assert_allclose(first.motion.vel_ned_m_s, [5.0, -2.0, 0.0])
    assert first.velocity_std_m_s[2] > first.velocity_std_m_s[0]
    assert_allclose(first.position_std_m, [2.0, 2.0, 4.0])
    # 80 m above the origin at 300 m, to the earth's curvature over 50 m
    assert first.barometer_bias_m == pytest.approx(11.0, abs=1e-3)


HOME = HomeSample(0, FRAME.lat_rad, FRAME.lon_rad, 300.0)
ATTITUDE, PRESSURE = AttitudeSample(0, Q, np.zeros(3)), BarometerSample(0, 380.0)


@pytest.mark.parametrize(
    ("samples", "named"),
    [
        ((), {"attitude", "barometer", "first position"}),
        ((_gnss(0),), {"attitude", "barometer"}),
        ((ATTITUDE,), {"barometer", "first position"}),
        ((ATTITUDE, PRESSURE), {"first position"}),
        ((ATTITUDE, _gnss(0)), {"barometer"}),
        ((ATTITUDE, HOME), {"barometer"}),
        ((PRESSURE, HOME), {"attitude"}),
        # a fix of 3 s ago does not serve any more
        ((_gnss(0), PRESSURE, AttitudeSample(3_000_000, Q, np.zeros(3))), {"first position"}),
        ((ATTITUDE, PRESSURE, HOME), {"satellite fix, or 3 s"}),
    ],
)
def test_all_that_is_missing_is_named_and_nothing_else(samples, named) -> None:
    conditions = _with(*samples)
    said = conditions.missing()

    words = {"attitude", "barometer", "first position", "satellite fix, or 3 s"}
    assert {word for word in words if word in said} == named
    newest_us = max((sample.t_us for sample in samples), default=0)
    assert conditions.ready(newest_us) is None


def test_what_was_named_as_missing_is_what_starts_it() -> None:
    conditions = _with(ATTITUDE, _gnss(0))
    assert "barometer" in conditions.missing()
    conditions.offer(BarometerSample(100_000, 380.0))

    assert conditions.ready(100_000) is not None


def test_nothing_starts_without_attitude_or_pressure() -> None:
    assert _with(_gnss(0), BarometerSample(0, 380.0)).ready(10_000_000) is None
    assert _with(AttitudeSample(0, Q, np.zeros(3)), _gnss(0)).ready(100_000) is None


def test_home_serves_after_patience() -> None:
    lat, lon, _ = FRAME.geodetic_from_ned(np.array([10.0, 20.0, 0.0]))
    home = HomeSample(0, float(lat), float(lon), 300.0)
    conditions = _with(AttitudeSample(0, Q, np.zeros(3)), BarometerSample(0, 350.0), home)

    assert conditions.ready(2_900_000) is None
    first = conditions.ready(3_000_000)

    assert first is not None
    assert_allclose(first.motion.pos_ned_m, [10.0, 20.0, -50.0], atol=0.01)
    assert first.position_std_m[0] == InitialGuess().position_std_m


def test_configured_position_goes_before_home() -> None:
    guess = InitialGuess(lat_rad=FRAME.lat_rad, lon_rad=FRAME.lon_rad)
    home = HomeSample(0, 0.821, 0.151, 300.0)

    first = _with(AttitudeSample(0, Q, np.zeros(3)), BarometerSample(0, 350.0), home, guess=guess).ready(4_000_000)

    assert first is not None
    assert_allclose(first.motion.pos_ned_m[:2], 0.0, atol=1e-6)


def test_old_satellite_fix_does_not_serve() -> None:
    conditions = _with(AttitudeSample(0, Q, np.zeros(3)), BarometerSample(0, 380.0), _gnss(0))

    assert conditions.ready(2_500_000) is None


def test_covariance_holds_the_stated_deviations_and_is_positive() -> None:
    first = _with(AttitudeSample(0, Q, np.zeros(3)), BarometerSample(0, 391.0), _gnss(0)).ready(0)
    assert first is not None

    nominal, P = aligned(first, LAYOUT, InitialGuess(), ProcessNoise())

    assert nominal.barometer_bias_m == first.barometer_bias_m
    assert_allclose(np.sqrt(np.diag(P)[LAYOUT.slices["position"]]), first.position_std_m)
    assert_allclose(P, P.T)
    assert np.linalg.eigvalsh(P).min() > -1e-12
    # the barometer's zero was taken from the same height: too low by a metre means the zero is too high by one
    height, zero = LAYOUT.slices["position"].start + 2, LAYOUT.slices["barometer_bias"].start
    reading = np.zeros(LAYOUT.size)
    reading[height], reading[zero] = -1.0, 1.0
    assert reading @ P @ reading < 0.05 * P[height, height]
    # the receiver's slow error is in the place that it gave: a second fix that errs alike tells nothing new of it
    north, slow = LAYOUT.slices["position"].start, LAYOUT.slices["gnss_bias"].start
    again = np.zeros(LAYOUT.size)
    again[[north, slow]] = 1.0
    assert again @ P @ again == pytest.approx(P[north, north] - P[slow, slow], rel=0.1)


def test_reduced_layouts_leave_out_what_they_lack() -> None:
    layout = Layout.of(("position", "velocity", "attitude"))
    first = _with(AttitudeSample(0, Q, np.zeros(3)), BarometerSample(0, 391.0), _gnss(0)).ready(0)
    assert first is not None

    _, P = aligned(first, layout, InitialGuess(), ProcessNoise())

    assert P.shape == (9, 9)
    assert (np.diag(P) > 0.0).all()


def test_an_attitude_made_wrong_on_purpose_is_wrong_by_that_about_the_fixed_axes() -> None:
    """Outside truth: SciPy's composition of rotations, which turns the reported attitude from the left."""
    error = np.array([0.05, -0.08, 0.17])
    first = _with(AttitudeSample(0, Q, np.zeros(3)), BarometerSample(0, 391.0), _gnss(100_000)).ready(200_000)
    assert first is not None
    guess = InitialGuess(attitude_error_rad=(0.05, -0.08, 0.17))
    nominal, _ = aligned(first, LAYOUT, guess, ProcessNoise())

    expected = Rotation.from_rotvec(error) * Rotation.from_quat(Q, scalar_first=True)
    assert_allclose(
        Rotation.from_quat(nominal.motion.q_ned_from_body, scalar_first=True).as_matrix(), expected.as_matrix()
    )
    untouched, _ = aligned(first, LAYOUT, InitialGuess(), ProcessNoise())
    assert_allclose(untouched.motion.q_ned_from_body, Q)
