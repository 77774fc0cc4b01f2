"""The station's clocks: the only module of the service that reads them."""

from __future__ import annotations

import time


def unix_us() -> int:
    """Microseconds since 1970 by the machine's clock: the one time base of samples, frames and states."""
    return time.time_ns() // 1000


def mono_us() -> int:
    """Microseconds of a clock that never steps; for time-outs, paces and durations."""
    return time.monotonic_ns() // 1000
