"""Descents onto a pad: the flight is what it says, and what is measured of it is what was put in."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.pad_flights import FRAME, HEIGHT_M, LOW_M, MANOEUVRES_S, MOUNT, T0_US, PadFlight, flown, sensed
from benchmarks.pad_fusion import CALIBRATED_RAD, Fused, blind_m, lag_s, markdown, measured_mount
from estimator.filters.strapdown import EarthModel, Motion, propagate
from estimator.geometry.rotation import q_from_matrix, rotvec_from_q
from estimator.types import InertialSample, PadMode, PadRelative
from simulator.random_streams import rng_for

PAD_AT = np.array([5.0, -8.0, 1.0])


@pytest.fixture(scope="module")
def flight() -> PadFlight:
    """A descent without its pictures."""
    truth = flown(301, PAD_AT, rng_for(301, "test"))
    last_us = T0_US + truth[-1].t_us - 5_500_000
    return PadFlight(sensed(301, truth), [], truth, PAD_AT, np.eye(3), MOUNT.body_from_camera, last_us)


def _states(flight: PadFlight, off_m: np.ndarray, by_us: int = 0) -> list[SimpleNamespace]:
    """What an estimator would say that is off by so much, and ``by_us`` late."""
    states = []
    for t_us in range(T0_US + 5_000_000, T0_US + 29_000_000, 20_000):
        true, then = flight.state_at(t_us), flight.state_at(t_us - by_us)
        pad = PadRelative(
            PadMode.TRACKING, true.pos_ned_m - PAD_AT + off_m, then.vel_ned_m_s, np.eye(3), np.eye(3),
            np.array([1.0, 0.0, 0.0, 0.0]), 0.0,
        )  # fmt: skip
        states.append(SimpleNamespace(t_us=t_us, vel_ned_m_s=then.vel_ned_m_s, pad=pad))
    return states


def test_it_hangs_above_the_pad_and_comes_down_onto_it(flight: PadFlight) -> None:
    high = np.array([s.pos_ned_m - PAD_AT for s in flight.truth if s.t_us < MANOEUVRES_S * 1e6])
    low = flight.state_at(flight.last_seen_us).pos_ned_m - PAD_AT
    assert np.abs(-high[:, 2] - HEIGHT_M).max() < 2.0
    assert np.abs(high[:, :2]).max() < 4.0
    # a picture is 0.48 m wide and 0.36 m high there: triples of 0.17 and 0.06 m must stay in it in part
    assert np.abs(low[:2]).max() < 0.3
    assert -low[2] == pytest.approx(LOW_M, abs=0.3)


def test_inertial_readings_are_of_that_flight(flight: PadFlight) -> None:
    """Strapdown over two seconds stays with the truth as far as biases of 0.13 m/s2 and 0.1 deg/s let it."""
    earth = EarthModel.at(FRAME.lat_rad, FRAME.alt_m)
    first = flight.state_at(T0_US + 4_000_000)
    motion = Motion(first.pos_ned_m, first.vel_ned_m_s, first.q_ned_from_body)
    for sample in flight.samples:
        if isinstance(sample, InertialSample) and 4_000_000 < sample.t_us - T0_US <= 6_000_000:
            motion = propagate(motion, sample.rate_body_rad_s, sample.specific_force_body_m_s2, 0.02, earth)
    assert np.linalg.norm(motion.pos_ned_m - flight.state_at(T0_US + 6_000_000).pos_ned_m) < 0.6


@pytest.mark.parametrize("late_us", [-15_000, 0, 25_000])
def test_lag_is_how_late_a_velocity_is(flight: PadFlight, late_us: int) -> None:
    states = _states(flight, np.zeros(3), late_us)
    off = np.array([s.vel_ned_m_s - flight.state_at(s.t_us).vel_ned_m_s for s in states])
    # the acceleration changes within the lag: a sixth of it at most here
    assert lag_s(flight, states, off) * 1e6 == pytest.approx(late_us, abs=1_000 + abs(late_us) / 6)


def test_blind_error_is_taken_after_the_last_picture(flight: PadFlight) -> None:
    states = _states(flight, np.array([0.03, 0.0, 0.04]))
    assert blind_m(flight, states, 1.0) == pytest.approx(0.05)
    later_us = flight.last_seen_us + 3_000_000
    far = _states(flight, np.array([1.03, 0.0, 0.04]))
    far = [s if s.t_us < later_us else other for s, other in zip(states, far, strict=True)]
    assert blind_m(flight, far, 1.0) == pytest.approx(0.05)
    assert blind_m(flight, far, 5.0) == pytest.approx(np.hypot(1.03, 0.04))


def test_a_measured_mount_is_off_by_what_is_left(flight: PadFlight) -> None:
    turned = [
        rotvec_from_q(q_from_matrix(measured_mount(seed, flight).body_from_camera @ flight.body_from_camera.T))
        for seed in range(100)
    ]
    assert np.std(turned) == pytest.approx(CALIBRATED_RAD, rel=0.15)


def test_the_table_ends_with_rms_and_worst() -> None:
    rows = [Fused(seed, *([value] * 12), 1, 1.0, 20.0) for seed, value in ((401, 3.0), (402, -4.0))]
    lines = markdown(rows).splitlines()
    assert lines[2].startswith("| 401 | 3 |")
    cells = [cell.strip() for cell in lines[4].split("|")[1:-1]]
    names = [cell.strip() for cell in lines[0].split("|")[1:-1]]
    assert cells[names.index("down m")] == "3.54"
    assert cells[names.index("lag ms")] == "-0.5"
    assert [cell.strip() for cell in lines[5].split("|")[1:-1]][names.index("down m")] == "4"
