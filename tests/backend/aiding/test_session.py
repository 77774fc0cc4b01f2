"""What goes to an autopilot: when, and what keeps it from going."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backend.aiding.session import INTERVAL_US, NO_ORIGIN, STALE_US, Seen, Session
from backend.link.aiding import AidingForm, Origin, Reader
from backend.link.events import Autopilot
from estimator.geometry.local import LocalFrame
from estimator.types import Doubt, Mode, NavigationState
from tests.backend.flight_maker import GROUND_M, LAT_DEG, LON_DEG, state

T_US = 1_760_000_000_000_000
STEP_US = 50_000
FRAME = LocalFrame(math.radians(LAT_DEG), math.radians(LON_DEG), GROUND_M)
ORIGIN = Origin(FRAME.lat_rad, FRAME.lon_rad, GROUND_M)
GOOD = Seen(connected=True, has_fix=False, gps_denied=True, origin=ORIGIN)
EXTERNAL, ODOMETRY = AidingForm.EXTERNAL_POSITION, AidingForm.ODOMETRY


def flown(t_us: int, *, std_m: float = 1.0, mode: Mode = Mode.VISION, off_m: float = 0.0) -> NavigationState:
    """North at 5 m/s from the origin."""
    north_m = 5.0 * (t_us - T_US) * 1e-6 + off_m
    made = state(t_us, mode=mode)
    lat, lon, alt = FRAME.geodetic_from_ned(np.array((north_m, 0.0, -100.0)))
    return replace(
        made, lat_rad=float(lat), lon_rad=float(lon), alt_amsl_m=float(alt), pos_ned_m=np.array((north_m, 0.0, -100.0)),
        cov_pos_ned_m2=std_m**2 * np.eye(3),
    )  # fmt: skip


def session(form: AidingForm, autopilot: Autopilot = Autopilot.ARDUPILOT) -> Session:
    return Session(form, "page", Reader(1, 1, autopilot), T_US)


def run(
    told: Session, seconds: float, *, begin_us: int = T_US, seen: Seen = GOOD, epoch: int = 1, **how: Any
) -> list[Any]:  # fmt: skip
    sent = []
    for number in range(round(seconds * 1e6) // STEP_US):
        t_us = begin_us + number * STEP_US
        sent += told.messages(flown(t_us, **how), epoch, FRAME, seen, t_us)
    return sent


@pytest.mark.parametrize("form", list(AidingForm))
def test_each_form_goes_at_its_rate(form: AidingForm) -> None:
    sent = run(session(form), 10.0)
    assert len(sent) == round(10e6 / INTERVAL_US[form])


def test_a_position_by_command_goes_no_more_than_once_a_second() -> None:
    stamps = [m.param1 for m in run(session(EXTERNAL), 20.0)]
    assert np.diff(stamps).min() > 0.98


def test_what_is_sent_is_of_now_whatever_the_state_s_age() -> None:
    told = session(EXTERNAL)
    (m,) = told.messages(flown(T_US - 200_000), 1, FRAME, GOOD, T_US)
    north_m = FRAME.ne_from_geodetic(math.radians(m.x * 1e-7), math.radians(m.y * 1e-7))[0]
    assert north_m == pytest.approx(0.0, abs=0.01)  # it stood 1 m south 0.2 s before, at 5 m/s
    assert m.param2 == 0.0
    assert m.param3 > 1.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mode": Mode.LOST}, "lost the place"), ({"std_m": 12.0}, "known to 12.0 m only"),
        ({"std_m": math.nan}, "known to nan m only"), ({"mode": Mode.GPS}, "the vehicle's own GPS"),
    ],
)  # fmt: skip
def test_a_state_that_is_not_to_be_believed_is_not_sent(change: dict[str, Any], words: str) -> None:
    told = session(EXTERNAL)
    assert run(told, 2.0, **change) == []
    assert words in told.reason
    assert not told.sending


def test_states_of_other_times_are_not_sent() -> None:
    for t_us in (T_US - STALE_US - 1, T_US + 1_000_000):
        told = session(ODOMETRY)
        assert told.messages(flown(t_us), 1, FRAME, GOOD, T_US) == []
        assert "old" in told.reason


def test_numbers_that_are_none_are_not_sent() -> None:
    told = session(ODOMETRY)
    broken = replace(flown(T_US), vel_ned_m_s=np.array((math.nan, 0.0, 0.0)))
    assert told.messages(broken, 1, FRAME, GOOD, T_US) == []
    assert "lost" in told.reason


def test_pictures_that_do_not_fit_the_map_are_not_sent_by() -> None:
    told = session(ODOMETRY)
    assert told.messages(replace(flown(T_US), doubts=(Doubt.MAP_MISMATCH,)), 1, FRAME, GOOD, T_US) == []


def test_ardupilot_with_a_fix_is_not_given_a_position() -> None:
    told = session(EXTERNAL)
    assert run(told, 2.0, seen=replace(GOOD, has_fix=True)) == []
    assert "has a fix" in told.reason
    assert run(session(ODOMETRY), 1.0, seen=replace(GOOD, has_fix=True)) != []


def test_gps_input_goes_only_where_gps_is_kept_from_the_estimator() -> None:
    told = session(AidingForm.GPS_INPUT)
    assert run(told, 2.0, seen=replace(GOOD, gps_denied=False)) == []
    assert "kept from the estimator" in told.reason


def test_what_was_too_uncertain_is_sent_again_when_it_is_clearly_better() -> None:
    told = session(ODOMETRY)
    assert run(told, 0.5, std_m=4.9)
    assert not run(told, 0.5, begin_us=T_US + 500_000, std_m=5.1)
    assert not run(told, 0.5, begin_us=T_US + 1_000_000, std_m=4.5)
    assert told.reason == "the place is known to 4.5 m only; 4 m are asked for"
    assert run(told, 0.5, begin_us=T_US + 1_500_000, std_m=3.9)
    assert told.reason == ""


def test_the_first_after_a_pause_is_no_burst() -> None:
    told = session(EXTERNAL)
    run(told, 2.0)
    run(told, 60.0, begin_us=T_US + 2_000_000, mode=Mode.LOST)
    assert len(run(told, 5.0, begin_us=T_US + 62_000_000)) == 5


def test_a_clock_that_is_set_back_does_not_silence_it() -> None:
    told = session(EXTERNAL)
    run(told, 3.0)
    assert run(told, 2.0, begin_us=T_US - 3_600_000_000)


def test_jumps_of_the_estimate_are_counted_and_flight_is_not() -> None:
    told = session(ODOMETRY)
    straight = run(told, 2.0)
    jumped = run(told, 1.0, begin_us=T_US + 2_000_000, off_m=3.0)
    anew = run(told, 1.0, begin_us=T_US + 3_000_000, off_m=3.0, epoch=2)
    late = run(told, 1.0, begin_us=T_US + 10_000_000, off_m=3.0, epoch=2)
    assert {m.reset_counter for m in straight} == {0}
    assert {m.reset_counter for m in jumped} == {1}
    assert {m.reset_counter for m in anew} == {2}
    assert {m.reset_counter for m in late} == {3}


def test_odometry_waits_for_the_origin_and_gives_one_to_an_ardupilot_that_has_none() -> None:
    told = session(ODOMETRY)
    sent = run(told, 20.0, seen=replace(GOOD, origin=None))
    kinds = [m.get_type() for m in sent]
    assert told.reason == NO_ORIGIN
    assert told.sent == 0
    assert kinds[:3] == ["COMMAND_LONG"] * 3
    assert kinds.count("SET_GPS_GLOBAL_ORIGIN") == 1
    assert kinds.index("SET_GPS_GLOBAL_ORIGIN") == 3
    (m,) = [m for m in sent if m.get_type() == "SET_GPS_GLOBAL_ORIGIN"]
    assert (m.latitude, m.longitude) == (round(LAT_DEG * 1e7), round(LON_DEG * 1e7))


def test_px4_is_asked_for_its_origin_and_given_none() -> None:
    sent = run(session(ODOMETRY, Autopilot.PX4), 20.0, seen=replace(GOOD, origin=None))
    assert {m.get_type() for m in sent} == {"COMMAND_LONG"}


def test_quality_falls_with_what_is_not_known() -> None:
    (sure,) = session(ODOMETRY).messages(flown(T_US, std_m=0.5), 1, FRAME, GOOD, T_US)
    (unsure,) = session(ODOMETRY).messages(flown(T_US, std_m=4.9), 1, FRAME, GOOD, T_US)
    assert (sure.quality, unsure.quality) == (90, 2)


def test_a_moment_without_states_does_not_begin_the_wait_for_the_effect_anew() -> None:
    told = session(ODOMETRY)
    run(told, 3.0)
    told.silent("the estimator gives no state")
    run(told, 1.0, begin_us=T_US + 4_000_000)
    after_a_moment = told.evidence(T_US + 5_000_000, (0, 0, ""), None, 1.0).sending_us
    told.silent("the estimator gives no state")
    run(told, 1.0, begin_us=T_US + 10_000_000)
    after_a_pause = told.evidence(T_US + 11_000_000, (0, 0, ""), None, 1.0).sending_us

    assert (after_a_moment, after_a_pause) == (5_000_000, 1_000_000)
