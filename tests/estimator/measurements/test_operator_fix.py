"""An operator's alignment: its Jacobian, and what it makes of a flight that is somewhere else."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.measurements import operator_fix
from estimator.types import AlignmentSample, FixReport, Mode
from tests.estimator.measurements.filters import general_filter, numeric_jacobian
from tests.estimator.test_navigator import FRAME, SPEED, _fly, _navigator, _t_us, _truth


def test_the_jacobian_is_that_of_the_place_by_the_imagery() -> None:
    def reads(eskf: object) -> np.ndarray:
        nominal = eskf.nominal  # type: ignore[attr-defined]
        return np.asarray(
            nominal.motion.pos_ned_m[:2] + nominal.map_bias_ne_m + nominal.map_region_ne_m + nominal.map_offset_ne_m
        )

    measured = operator_fix.position(general_filter(), np.array([40.0, -10.0]), np.eye(2))

    assert_allclose(measured.H, numeric_jacobian(reads), atol=1e-6)
    assert_allclose(measured.z, np.array([40.0, -10.0]) - reads(general_filter()))


def alignment(
    at_s: float, frame_s: float, std_m: float, error_ne_m: tuple[float, float] = (0.0, 0.0)
) -> AlignmentSample:
    """An operator who sees where the vehicle was, but for an error."""
    place = _truth(frame_s)[:2] + np.array(error_ne_m)
    return AlignmentSample(_t_us(at_s), _t_us(frame_s), 7, place, std_m**2 * np.eye(2))


def flown_astray(end_s: float, wrong_m: float):  # type: ignore[no-untyped-def]
    """A flight with GPS for 8 s, then without and without pictures; the estimate is pushed east meanwhile."""
    navigator = _navigator(reference=None)
    _fly(navigator, 0.0, 8.0, frames=False)
    eskf = navigator._eskf
    assert eskf is not None
    motion = eskf.nominal.motion
    eskf.nominal = replace(
        eskf.nominal, motion=replace(motion, pos_ned_m=motion.pos_ned_m + np.array([0.0, wrong_m, 0.0]))
    )
    _fly(navigator, 8.0, end_s, gnss=False, frames=False)
    return navigator


def fused(navigator, sample: AlignmentSample) -> FixReport:  # type: ignore[no-untyped-def]
    navigator.offer(sample)
    (report,) = navigator.advance(sample.t_us)
    return report


def error_ne_m(navigator, t_s: float) -> np.ndarray:  # type: ignore[no-untyped-def]
    state = navigator.predict(_t_us(t_s))
    assert state is not None
    north, east, _ = FRAME.ned_from_geodetic(state.lat_rad, state.lon_rad, state.alt_amsl_m)
    return np.array([north, east]) - _truth(t_s)[:2]


@pytest.mark.parametrize("frame_s", [11.9, 9.0])
@pytest.mark.parametrize("wrong_m", [4.0, 60.0])
def test_an_alignment_of_a_frame_of_before_corrects_now(frame_s: float, wrong_m: float) -> None:
    """Whether the estimate was sure of itself or not; the vehicle has flown up to 24 m since the frame."""
    navigator = flown_astray(12.0, wrong_m)
    assert abs(error_ne_m(navigator, 11.95)[1]) > 0.7 * wrong_m

    report = fused(navigator, alignment(12.0, frame_s, 1.0))

    assert (report.kind, report.accepted, report.frame_id) == ("operator", True, 7)
    assert report.north_m == pytest.approx(_truth(12.0)[0], abs=1.5)
    # 4 m are within what the estimate says of itself: it is weighed with the operator. 60 m are not: it gives way.
    assert np.hypot(*error_ne_m(navigator, 12.0)) < (2.4 if wrong_m < 10.0 else 1.5)
    state = navigator.predict(_t_us(12.0))
    assert state.last_fix_age_s < 0.1
    # The operator's metre, and what the map's own displacement adds to a place by its imagery.
    assert 0.9 < np.sqrt(state.cov_pos_ned_m2[1, 1]) < 2.0


def test_an_old_frame_counts_less() -> None:
    """Its place is carried on with a velocity that is not exact."""
    spread = []
    for frame_s in (11.9, 8.5):
        report = fused(flown_astray(12.0, 4.0), alignment(12.0, frame_s, 1.0))
        spread.append(float(np.trace(report.cov_ne_m2)))

    assert spread[1] > 1.05 * spread[0]
    assert spread[0] >= 2.0


def test_errors_of_the_operator_stay_within_what_is_said_of_them() -> None:
    """Over seeds: the corrected east has the sigma that it claims, by the mean of its squared ratio (chi-square)."""
    rng, ratios = np.random.default_rng(4), []
    for _ in range(40):
        navigator = flown_astray(10.0, 25.0)
        off = rng.normal(0.0, 2.0, 2)
        fused(navigator, alignment(10.0, 9.5, 2.0, (off[0], off[1])))
        state = navigator.predict(_t_us(10.0))
        ratios.append(error_ne_m(navigator, 10.0)[1] ** 2 / state.cov_pos_ned_m2[1, 1])

    assert 0.5 < float(np.mean(ratios)) < 1.6


def test_a_frame_beyond_the_history_is_refused() -> None:
    navigator = flown_astray(10.0, 4.0)
    before = error_ne_m(navigator, 10.0)

    report = fused(navigator, alignment(10.0, -100.0, 1.0))

    assert not report.accepted
    assert "reach back" in report.reason
    assert_allclose(error_ne_m(navigator, 10.0), before, atol=1e-6)
    assert navigator.predict(_t_us(10.0)).mode is not Mode.VISION


def test_the_way_since_the_frame_does_not_jump_with_a_fix() -> None:
    """A second word on the same frame, after the first was used, changes little."""
    navigator = flown_astray(12.0, 30.0)
    fused(navigator, alignment(12.0, 10.0, 1.0))
    first = error_ne_m(navigator, 12.0)
    _fly(navigator, 12.0, 12.5, gnss=False, frames=False)

    fused(navigator, alignment(12.5, 10.0, 1.0))

    assert SPEED * 2.5 == 20.0  # m that the vehicle has flown since the frame
    assert np.hypot(*(error_ne_m(navigator, 12.5) - first)) < 0.7
