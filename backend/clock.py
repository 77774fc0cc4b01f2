"""The station's clocks: the only module of the service that reads them."""

from __future__ import annotations

import time


def _boot_ns() -> int:
    """Nanoseconds of a clock that never steps, and goes on while the machine sleeps where the system has such a one."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic_ns() if clock is None else time.clock_gettime_ns(clock)


# Read once: whoever sets the machine's clock later (by hand, by NTP, by a GPS receiver) must not send the estimator,
# the link and the recording back in time, or ahead of it. The time of the start holds until the next start.
_UNIX_MINUS_BOOT_NS = time.time_ns() - _boot_ns()


def unix_us() -> int:
    """Microseconds since 1970 by the machine's clock as it was at the start: the time base of samples, frames, states.

    Never runs back.
    """
    return (_boot_ns() + _UNIX_MINUS_BOOT_NS) // 1000


def mono_us() -> int:
    """Microseconds of a clock that never steps; for time-outs, paces and durations."""
    return time.monotonic_ns() // 1000
