import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.link.timebase import BootClock

UNIX_US = 1_760_000_000_000_000


def _run(delays_us: list[int], period_us: int = 40_000, rate: float = 0.0) -> tuple[BootClock, list[float]]:
    """A clock fed with jittered messages, and the error of each mapped time against the true one."""
    clock = BootClock()
    errors = []
    for i, delay_us in enumerate(delays_us):
        t_boot_us = 5_000_000 + i * period_us
        t_true_us = UNIX_US + round(i * period_us * (1.0 + rate))
        clock.observe(t_boot_us, t_true_us + delay_us)
        mapped = clock.unix_from_boot(t_boot_us)
        assert mapped is not None
        errors.append(mapped - t_true_us)
    return clock, errors


@settings(deadline=None, max_examples=30)
@given(st.lists(st.integers(0, 400_000), min_size=5, max_size=200))
def test_a_mapped_time_is_never_after_receipt_nor_before_the_truth(delays_us: list[int]) -> None:
    _, errors = _run(delays_us)

    for error, delay in zip(errors, delays_us, strict=True):
        # The rate fitted to jitter may bend the line by a little below the truth.
        assert -60_000 <= error <= delay + 1


def test_jitter_is_filtered() -> None:
    rng = np.random.default_rng(1)
    delays = (5_000 + rng.exponential(30_000, 3000)).astype(int)
    _, errors = _run(list(delays))

    # After ten seconds the anchor is the smallest delay; one of 30 samples a second has under 2 ms of jitter.
    assert np.abs(np.array(errors[250:]) - 5_000).max() < 3_000


def test_drift_of_a_slow_simulation_is_followed() -> None:
    rng = np.random.default_rng(2)
    delays = rng.exponential(3_000, 3000).astype(int)
    clock, errors = _run(list(delays), rate=0.013)

    assert np.abs(errors[500:]).max() < 10_000
    assert not clock.steps


def test_a_reboot_anchors_anew() -> None:
    clock, _ = _run([1_000] * 100)
    for i in range(5):
        clock.observe(1_000_000 + i * 40_000, UNIX_US + 30_000_000 + i * 40_000)

    assert clock.reboots == 1
    assert clock.unix_from_boot(1_000_000) == UNIX_US + 30_000_000


def test_one_bogus_receive_time_moves_nothing() -> None:
    clock, _ = _run([1_000] * 100)
    before = clock.unix_from_boot(9_000_000)
    clock.observe(9_000_000, UNIX_US - 3_600_000_000)
    clock.observe(9_040_000, UNIX_US + 3_600_000_000)

    assert clock.unix_from_boot(9_000_000) == before
    assert (clock.reboots, clock.steps) == (0, 0)


def test_one_overtaken_old_message_is_no_reboot() -> None:
    clock, _ = _run([1_000] * 100)
    clock.observe(5_000_000, UNIX_US + 4_000_000)

    assert clock.reboots == 0
    assert clock.unix_from_boot(5_000_000) == UNIX_US + 1_000


def test_receive_times_running_backwards_are_followed() -> None:
    """The recorder's clock is set back by a minute in flight."""
    clock, _ = _run([1_000] * 100)
    for i in range(10):
        clock.observe(9_000_000 + i * 40_000, UNIX_US - 56_000_000 + i * 40_000)

    assert clock.steps == 1
    assert clock.unix_from_boot(9_400_000) == UNIX_US - 55_600_000


def test_a_burst_held_up_for_two_seconds_is_mapped_to_when_it_was_made() -> None:
    clock, _ = _run([1_000] * 100)
    held = [9_000_000 + i * 40_000 for i in range(50)]
    for t_boot_us in held:
        clock.observe(t_boot_us, UNIX_US + 6_000_000)

    assert clock.steps == 0
    mapped = clock.unix_from_boot(held[0])
    assert mapped is not None
    assert abs(mapped - (UNIX_US + 4_001_000)) < 1_000


def test_vehicle_unix_time_maps_through_boot_time() -> None:
    clock, _ = _run([0] * 50)
    assert clock.unix_from_vehicle_unix(1_500_000_000_000_000) is None
    for i in range(50):
        # The vehicle's calendar is a year behind; its boot stamp is cut to whole milliseconds.
        t_us = 6_000_000 + i * 100_437
        clock.observe_unix(UNIX_US - 31_536_000_000_000 + t_us, t_us // 1000 * 1000)

    mapped = clock.unix_from_vehicle_unix(UNIX_US - 31_536_000_000_000 + 7_000_000)
    assert mapped is not None
    assert abs(mapped - (UNIX_US + 2_000_000)) < 1_000


def test_nothing_is_known_before_the_first_message() -> None:
    clock = BootClock()

    assert not clock.is_set
    assert clock.unix_from_boot(1) is None
    assert clock.unix_from_vehicle_unix(1) is None
