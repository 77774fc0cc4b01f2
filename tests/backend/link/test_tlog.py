"""The link on recorded telemetry, and its figures against the truth of a flight."""

import itertools
from collections import Counter
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.link.events import LinkEvent, LinkStats, SampleEvent, TelemetryHeartbeat, VehicleAppeared, VehicleRebooted
from backend.link.tlog import LinkReplay, running_forward
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import euler_from_q, matrix_from_euler, wrap_pi
from estimator.types import (
    AirspeedSample,
    AttitudeSample,
    BarometerSample,
    CameraAttitudeSample,
    GnssSample,
    HomeSample,
    InertialSample,
)
from geodata.tlog import iter_tlog
from tests.backend.link.wire import Sender
from tests.shared_data import shared_data

LOGS = [
    "flights/ariel_b/telemetry.tlog",
    "flights/copter_120m/telemetry.tlog",
    "flights/plane_80m/telemetry.tlog",
    "telemetry/dronekit_flight.tlog",
    "telemetry/px4_sih_loop.tlog",
    "telemetry/heli_loop.tlog",
    "telemetry/plane_mission.tlog",
    "telemetry/signed_link.tlog",
    "telemetry/uavlogviewer_vtol_sitl.tlog",
]
# Enough of each log to meet every message of its flight, and short enough for a suite that runs often.
ENTRIES = 8_000


@cache
def _replayed(log: str, entries: int = ENTRIES) -> tuple[LinkReplay, list[LinkEvent]]:
    replay = LinkReplay()
    return replay, list(replay.events(itertools.islice(iter_tlog(shared_data(log)), entries)))


def _samples(log: str, kind: type, entries: int = ENTRIES) -> list:
    events = _replayed(log, entries)[1]
    return [e.sample for e in events if isinstance(e, SampleEvent) and isinstance(e.sample, kind)]


@pytest.mark.parametrize("log", LOGS)
def test_every_log_gives_one_vehicle_with_ordered_samples(log: str) -> None:
    _, events = _replayed(log)
    assert [e.system_id for e in events if isinstance(e, VehicleAppeared)] == [1]
    assert {e.system_id for e in events} == {1}

    # Behind their receipt by less than five seconds, and never after it.
    delays_s = [(e.t_us - e.sample.t_us) * 1e-6 for e in events if isinstance(e, SampleEvent)]
    reboots = sum(isinstance(e, VehicleRebooted) for e in events)
    assert min(delays_s, default=0.0) >= 0.0
    assert sum(delay > 5.0 for delay in delays_s) <= 10 * reboots


@pytest.mark.parametrize(
    ("log", "kind", "rate_hz"),
    [
        ("flights/copter_120m/telemetry.tlog", InertialSample, 50),
        ("flights/copter_120m/telemetry.tlog", AttitudeSample, 25),
        ("flights/copter_120m/telemetry.tlog", BarometerSample, 20),
        ("flights/copter_120m/telemetry.tlog", GnssSample, 5),
        ("flights/plane_80m/telemetry.tlog", InertialSample, 25),
        ("flights/plane_80m/telemetry.tlog", AirspeedSample, 2),
        ("flights/ariel_b/telemetry.tlog", CameraAttitudeSample, 10),
        ("flights/ariel_b/telemetry.tlog", BarometerSample, 10),
        ("flights/ariel_b/telemetry.tlog", GnssSample, 5),
        ("telemetry/plane_mission.tlog", InertialSample, 25),
        ("telemetry/heli_loop.tlog", InertialSample, 50),
        ("telemetry/px4_sih_loop.tlog", InertialSample, 50),
        ("telemetry/px4_sih_loop.tlog", AttitudeSample, 50),
    ],
)
def test_each_quantity_comes_once_at_its_rate(log: str, kind: type, rate_hz: float) -> None:
    samples = _samples(log, kind)
    # From the second quarter on: a vehicle starts its streams one by one, and the better source has to show itself.
    t_us = np.array([sample.t_us for sample in samples])[len(samples) // 4 :]

    assert np.median(np.diff(t_us)) == pytest.approx(1e6 / rate_hz, rel=0.06)
    assert np.mean(np.diff(t_us) <= 0) < 0.002


def test_a_log_without_inertial_messages_gives_none() -> None:
    assert _samples("flights/ariel_b/telemetry.tlog", InertialSample) == []
    assert all(sample.yaw_is_earth for sample in _samples("flights/ariel_b/telemetry.tlog", CameraAttitudeSample))
    assert _samples("flights/ariel_b/telemetry.tlog", HomeSample)


def test_a_real_log_with_bad_data_and_a_reboot() -> None:
    replay, events = _replayed("telemetry/dronekit_flight.tlog", 25_000)

    assert replay.link.noise_bytes > 4_000
    assert sum(isinstance(e, VehicleRebooted) for e in events) == 1
    fixes = [e.sample for e in events if isinstance(e, SampleEvent) and isinstance(e.sample, GnssSample)]
    lat_deg = np.degrees([fix.lat_rad for fix in fixes])
    assert np.ptp(lat_deg) < 0.01


def test_a_signed_link_is_accepted_and_counted() -> None:
    replay, events = _replayed("telemetry/signed_link.tlog")
    stats = [e for e in events if isinstance(e, LinkStats)][-1]

    assert stats.signed_packets > 40
    assert stats.signed_packets < stats.packets
    assert replay.link.noise_bytes == 0


def test_modes_of_both_autopilots() -> None:
    def modes(log: str) -> set[str]:
        heartbeats = ((t, packet) for t, packet in iter_tlog(shared_data(log)) if packet[7:10] == bytes(3))
        return {e.mode for e in LinkReplay().events(heartbeats) if isinstance(e, TelemetryHeartbeat)}

    assert modes("telemetry/px4_sih_loop.tlog") == {"AUTO LOITER", "AUTO TAKEOFF", "OFFBOARD", "AUTO LAND"}
    assert modes("telemetry/plane_mission.tlog") == {"MANUAL", "AUTO", "GUIDED", "RTL"}


def test_a_replay_is_deterministic_and_sends_nothing() -> None:
    log = "flights/plane_80m/telemetry.tlog"
    again = LinkReplay()
    events = list(again.events(itertools.islice(iter_tlog(shared_data(log)), 3_000)))

    assert Counter(map(repr, events)) != Counter()
    assert [(type(e), e.t_us) for e in events] == [(type(e), e.t_us) for e in _replayed(log, 3_000)[1]]
    assert again.link.data_to_send() == []


def test_times_that_run_backwards_stop_nothing() -> None:
    sender, replay = Sender(), LinkReplay()
    start_us = 1_760_000_000_000_000
    entries = [(start_us, sender.heartbeat())]
    for i in range(200):
        # The recorder's clock is set back by an hour half way.
        t_us = start_us + i * 40_000 - (3_600_000_000 if i >= 100 else 0)
        entries.append((t_us, sender.attitude(60_000 + 40 * i)))
    samples = [e.sample for e in replay.events(entries) if isinstance(e, SampleEvent)]

    assert len(samples) == 200
    assert samples[-1].t_us == entries[-1][0]


# --- against truth ---


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return np.genfromtxt(shared_data("flights/copter_120m/truth.csv"), delimiter=",", names=True)


def _at(truth: np.ndarray, t_us: np.ndarray, column: str) -> np.ndarray:
    return np.interp(t_us, truth["time_us"], truth[column])


COPTER = "flights/copter_120m/telemetry.tlog"
# The first 100 s.
FLIGHT_ENTRIES = 20_000


def _within(truth: np.ndarray, samples: list) -> tuple[list, np.ndarray]:
    inside = [x for x in samples if truth["time_us"][0] + 2e6 < x.t_us < truth["time_us"][-1]]
    return inside, np.array([x.t_us for x in inside], dtype=np.float64)


def test_attitude_against_truth(truth: np.ndarray) -> None:
    samples, t_us = _within(truth, _samples(COPTER, AttitudeSample, FLIGHT_ENTRIES))
    angles_rad = euler_from_q(np.array([x.q_ned_from_body for x in samples]))
    names = ("roll_deg", "pitch_deg", "yaw_deg")
    true_rad = [np.interp(t_us, truth["time_us"], np.unwrap(np.radians(truth[name]))) for name in names]
    errors_deg = [np.degrees(wrap_pi(a - b)) for a, b in zip(angles_rad, true_rad, strict=True)]

    # The autopilot's filter: 0.2 degrees of tilt, 1 of heading. A wrong sign or axis is off by tens.
    assert [float(np.sqrt(np.mean(e**2))) < limit for e, limit in zip(errors_deg, (0.25, 0.25, 1.0), strict=True)] == [
        True
    ] * 3


def test_attitude_times_against_truth(truth: np.ndarray) -> None:
    """The mapped time is right to 10 ms: moving it either way makes the roll fit worse."""
    samples, t_us = _within(truth, _samples(COPTER, AttitudeSample, FLIGHT_ENTRIES))
    roll_rad = euler_from_q(np.array([x.q_ned_from_body for x in samples]))[0]
    spread = {
        lag_ms: float(np.std(roll_rad - np.radians(_at(truth, t_us + 1e3 * lag_ms, "roll_deg"))))
        for lag_ms in range(-40, 41, 5)
    }

    assert abs(min(spread, key=spread.__getitem__)) <= 10


def test_specific_force_and_rates_against_truth(truth: np.ndarray) -> None:
    samples, t_us = _within(truth, _samples(COPTER, InertialSample, FLIGHT_ENTRIES))
    force = np.array([x.specific_force_body_m_s2 for x in samples])
    unwrapped = [np.unwrap(np.radians(truth[name])) for name in ("roll_deg", "pitch_deg", "yaw_deg")]
    ned_from_body = matrix_from_euler(*(np.interp(t_us, truth["time_us"], angle) for angle in unwrapped))
    velocity = np.stack([_at(truth, t_us, name) for name in ("vn_mps", "ve_mps", "vd_mps")], axis=-1)
    gravity = np.array((0.0, 0.0, 9.794))  # at 32 degrees north
    expected = np.einsum("nji,nj->ni", ned_from_body, np.gradient(velocity, t_us * 1e-6, axis=0) - gravity)
    # A bias of some 0.07 m/s2 on each axis; g in place of m/s2, or a wrong sign, is off by metres.
    assert np.abs(np.mean(force - expected, axis=0)).max() < 0.15
    assert np.std(force - expected, axis=0).max() < 0.2

    rates = np.array([x.rate_body_rad_s for x in samples])
    yaw_deg = np.degrees(np.interp(t_us, truth["time_us"], np.unwrap(np.radians(truth["yaw_deg"]))))
    turned_deg = np.degrees(np.sum(0.5 * (rates[1:, 2] + rates[:-1, 2]) * np.diff(t_us) * 1e-6))
    # A gyro bias of 0.2 deg/s over 100 s is 20 degrees.
    assert abs(turned_deg - (yaw_deg[-1] - yaw_deg[0])) < 30.0
    roll_rate = np.gradient(np.radians(_at(truth, t_us, "roll_deg")), t_us * 1e-6)
    assert np.corrcoef(rates[:, 0], roll_rate)[0, 1] > 0.8


def test_gnss_against_truth(truth: np.ndarray) -> None:
    samples, t_us = _within(truth, _samples(COPTER, GnssSample, FLIGHT_ENTRIES))
    frame = LocalFrame(samples[0].lat_rad, samples[0].lon_rad, samples[0].alt_amsl_m)
    measured = frame.ned_from_geodetic(
        np.array([x.lat_rad for x in samples]),
        np.array([x.lon_rad for x in samples]),
        np.array([x.alt_amsl_m for x in samples]),
    )
    # The simulated receiver's position is 90 ms older than its stamp, which is 1 m at 11 m/s.
    t_us -= 90e3
    actual = frame.ned_from_geodetic(
        np.radians(_at(truth, t_us, "lat_deg")),
        np.radians(_at(truth, t_us, "lon_deg")),
        _at(truth, t_us, "alt_amsl_m"),
    )
    assert np.abs(measured - actual).max() < 1.0
    assert np.abs(np.mean(measured - actual, axis=0)).max() < 0.1

    velocity = np.array([x.vel_ned_m_s[:2] for x in samples])
    t_us += 90e3
    true_velocity = np.stack((_at(truth, t_us, "vn_mps"), _at(truth, t_us, "ve_mps")), axis=-1)
    assert np.sqrt(np.mean((velocity - true_velocity) ** 2)) < 0.3


def test_barometer_against_truth(truth: np.ndarray) -> None:
    samples, t_us = _within(truth, _samples(COPTER, BarometerSample, FLIGHT_ENTRIES))
    offset_m = np.array([x.pressure_alt_m for x in samples]) - _at(truth, t_us, "alt_amsl_m")

    # Set to the standard atmosphere, with a drift of some metres over the flight and 0.1 m of noise.
    assert np.abs(offset_m).max() < 6.0
    assert np.std(np.diff(offset_m)) < 0.5


S_US = 1_000_000


@pytest.mark.parametrize(
    ("times_s", "kept_s"),
    [
        ([1, 2, 3], [1, 2, 3]),
        ([1, 2, 1.5, 3], [1, 2, 1.5, 3]),  # swapped by a relay: the link sees to that
        ([1, 2, 3700, 3, 4], [1, 2, 3, 4]),  # one wrong time far ahead
        ([1, 2, 0, 3, 4], [1, 2, 3, 4]),
        ([0, 3600, 3601], [3600, 3601]),  # the clock was set after the first packet
        ([1, 2, 3600, 3601, 3602], [1, 2, 3600, 3601, 3602]),  # a silence of an hour
        ([3600, 3601, 1, 2, 3], [3600, 3601]),  # set back for good
        ([1, 2, 3700], [1, 2, 3700]),
        ([5], [5]),
        ([], []),
    ],
)
def test_what_turns_the_time_of_a_log_back_is_left_out(times_s: list[float], kept_s: list[float]) -> None:
    entries = [(round(1e15 + t * S_US), str(n).encode()) for n, t in enumerate(times_s)]
    warnings: list[str] = []
    kept = list(running_forward(entries, warnings.append))

    assert [(t - 1e15) / S_US for t, _ in kept] == kept_s
    assert set(kept) <= set(entries)
    lost = len(times_s) - len(kept_s)
    assert len(warnings) == (1 if lost else 0)
    assert not lost or f"{lost} packets" in warnings[0]


@given(st.lists(st.integers(0, 10**9), max_size=60))
def test_no_log_can_turn_time_back_by_more_than_a_swap(times_us: list[int]) -> None:
    kept = [t for t, _ in running_forward([(t, b"") for t in times_us], lambda _: None)]
    newest = 0
    for t_us in kept:
        assert newest - t_us <= S_US
        newest = max(newest, t_us)
