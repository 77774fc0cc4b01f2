from __future__ import annotations

import numpy as np

from backend.video.timing import ExposureClock, SmallestDelay

T0_US = 1_760_000_000_000_000


def test_a_stamp_that_agrees_with_the_clock_is_taken_exactly() -> None:
    clock = ExposureClock(time_offset_us=77)

    assert clock.exposure_us(T0_US, 123, T0_US + 60_000) == T0_US


def test_a_stamp_goes_through_the_links_map() -> None:
    """The vehicle's clock is an hour off; the link knows by how much."""
    clock = ExposureClock(lambda t: t + 3_600_000_000)

    assert clock.exposure_us(T0_US - 3_600_000_000, None, T0_US + 60_000) == T0_US


def test_a_foreign_stamp_without_a_map_falls_back_to_the_smallest_delay() -> None:
    clock = ExposureClock(lambda _: None, time_offset_us=-30_000)

    assert clock.exposure_us(5_000_000, None, T0_US) == T0_US - 30_000


def test_a_map_that_gives_nonsense_is_not_believed() -> None:
    clock = ExposureClock(lambda t: t + 86_400_000_000)

    assert clock.exposure_us(T0_US, None, T0_US + 50_000) == T0_US + 50_000


def test_jitter_does_not_reach_the_times() -> None:
    """Delays of 5 to 60 ms: after the first ones, times run at the sender's even pace."""
    delays = np.random.default_rng(3).integers(5_000, 60_000, 500)
    clock = ExposureClock(time_offset_us=1_000)
    times = [clock.exposure_us(None, 40_000 * n, T0_US + 40_000 * n + int(d)) for n, d in enumerate(delays)]

    errors = np.array(times[100:]) - (T0_US + 40_000 * np.arange(100, 500) + 1_000)
    # The smallest of a hundred draws lies within a few per cent of the range.
    assert errors.min() >= 5_000
    assert errors.max() < 8_000
    assert np.ptp(errors) < 1_500


def test_a_restarted_sender_is_followed_at_once() -> None:
    delay = SmallestDelay()
    delay.station_us(900_000_000, T0_US)

    assert delay.station_us(0, T0_US + 40_000) == T0_US + 40_000


def test_a_burst_that_was_held_up_keeps_its_times() -> None:
    """Fault: 4 s of pictures come at once, late. Expected: their exposures are as if nothing had happened."""
    delay, clock = SmallestDelay(), ExposureClock()
    for n in range(50):
        delay.station_us(40_000 * n, T0_US + 40_000 * n)
        clock.exposure_us(T0_US + 40_000 * n, None, T0_US + 40_000 * n + 3_000)

    for n in range(50, 150):
        assert delay.station_us(40_000 * n, T0_US + 6_000_000) == T0_US + 40_000 * n
        assert clock.exposure_us(T0_US + 40_000 * n, None, T0_US + 6_000_000) == T0_US + 40_000 * n


def test_a_clock_set_back_for_good_is_followed() -> None:
    """The sender's clock loses 10 s but runs on: after 3 s that is the new rule."""
    delay = SmallestDelay()
    for n in range(25):
        delay.station_us(20_000_000 + 400_000 * n, T0_US + 400_000 * n)
    times = [delay.station_us(20_000_000 + 400_000 * n, T0_US + 10_000_000 + 400_000 * n) for n in range(25, 40)]

    assert times[0] == T0_US + 400_000 * 25
    assert times[-1] == T0_US + 10_000_000 + 400_000 * 39


def test_a_slow_drift_is_followed() -> None:
    """The smallest delay is forgotten after half a minute: 100 ppm of drift stay below 4 ms."""
    delay = SmallestDelay()
    for n in range(0, 3000):
        t_us = T0_US + 40_000 * n
        error = delay.station_us(int(40_000 * n * (1 - 1e-4)), t_us) - t_us

    assert -4_000 < error <= 0


def test_without_any_time_the_arrival_counts() -> None:
    assert ExposureClock().exposure_us(None, None, T0_US) == T0_US


def test_it_says_whether_the_vehicles_own_clock_stamped_the_picture() -> None:
    known, unknown = ExposureClock(lambda t: t), ExposureClock(lambda _: None)
    known.exposure_us(T0_US, None, T0_US + 60_000)
    assert known.stamped
    known.exposure_us(None, 123, T0_US + 100_000)
    assert not known.stamped
    # a stamp of another day whose clock nobody knows gives the picture's pace, not its time
    unknown.exposure_us(5_000_000, None, T0_US)
    assert not unknown.stamped
