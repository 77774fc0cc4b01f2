"""When a picture was taken, on the station's time base. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

VehicleClockMap = Callable[[int], int | None]

_BUCKET_US = 1_000_000
_BUCKETS = 30
_STEP_US = 2_000_000
_LONGEST_STALL_US = 3_000_000
# A stamp this far from the arrival is on another clock, or of another day.
_MAX_AGE_US = 10_000_000
_MAX_AHEAD_US = 500_000
_MAX_AGE_UNMAPPED_US = 2_000_000
_MAX_AHEAD_UNMAPPED_US = 50_000


class ExposureClock:
    """Exposure times from stamps in the picture, or from the sender's clock and the smallest delay seen.

    A stamp is on the vehicle's Unix clock and goes through ``map_vehicle_unix``; while that knows nothing, a stamp that
    agrees with the station's clock is taken as it is. ``time_offset_us`` is added to times that are not stamps.
    ``stamped`` says whether the last exposure was a stamp.
    """

    def __init__(self, map_vehicle_unix: VehicleClockMap | None = None, time_offset_us: int = 0) -> None:
        self._map = map_vehicle_unix
        self._time_offset_us = time_offset_us
        self.stamped = False
        self._of_stamps = SmallestDelay()
        self._of_pts = SmallestDelay()

    def exposure_us(self, stamp_us: int | None, pts_us: int | None, t_wire_us: int) -> int:
        """Exposure of a picture with these times, any of them None, whose first byte arrived at ``t_wire_us``."""
        self.stamped = False
        if stamp_us is not None:
            by_delay_us = self._of_stamps.station_us(stamp_us, t_wire_us)
            mapped_us = self._map(stamp_us) if self._map is not None else None
            if mapped_us is not None and -_MAX_AHEAD_US <= t_wire_us - mapped_us <= _MAX_AGE_US:
                self.stamped = True
                return mapped_us
            # The smallest delay, not this picture's: one that was held up on the way has its exposure all the same.
            if mapped_us is None and -_MAX_AHEAD_UNMAPPED_US <= by_delay_us - stamp_us <= _MAX_AGE_UNMAPPED_US:
                self.stamped = True
                return stamp_us
            return by_delay_us + self._time_offset_us
        if pts_us is not None:
            return self._of_pts.station_us(pts_us, t_wire_us) + self._time_offset_us
        return t_wire_us + self._time_offset_us

    def restart(self) -> None:
        """Forget the sender's clock, as after a reconnect."""
        self._of_stamps = SmallestDelay()
        self._of_pts = SmallestDelay()


class SmallestDelay:
    """Maps a sender's clock by the smallest delay of the last half minute, so that jitter does not reach the times."""

    def __init__(self) -> None:
        self._smallest: deque[tuple[int, int]] = deque(maxlen=_BUCKETS)  # (bucket of arrival, smallest difference)
        self._newest_sender_us = 0
        self._late_since_us: int | None = None

    def station_us(self, t_sender_us: int, t_arrival_us: int) -> int:
        """Station time of a sender's time that arrived then."""
        difference = t_arrival_us - t_sender_us
        if self._smallest:
            difference = self._without_delay(difference, t_sender_us, t_arrival_us)
        self._newest_sender_us = t_sender_us
        bucket = t_arrival_us // _BUCKET_US
        if self._smallest and self._smallest[-1][0] == bucket:
            difference = min(difference, self._smallest.pop()[1])
        self._smallest.append((bucket, difference))
        return t_sender_us + min(d for _, d in self._smallest)

    def _without_delay(self, difference: int, t_sender_us: int, t_arrival_us: int) -> int:
        """The difference to learn from; forgets the past where the sender's clock has stepped."""
        smallest = min(d for _, d in self._smallest)
        if difference - smallest <= _STEP_US:
            self._late_since_us = None
            if smallest - difference > _STEP_US:
                self._smallest.clear()
            return difference
        # Held up in a buffer, or a clock set back? A restarted sender begins again; a buffer empties soon.
        self._late_since_us = self._late_since_us or t_arrival_us
        if t_sender_us >= self._newest_sender_us and t_arrival_us - self._late_since_us <= _LONGEST_STALL_US:
            return smallest
        self._smallest.clear()
        self._late_since_us = None
        return difference
