"""The vehicle's clocks on the station's time base.

A message's delay is never negative, so the smallest difference between receive time and boot time is the best anchor.
The two clocks also drift (65 ppm between two good crystals, 1.3 % for a simulation that cannot keep up), so a rate is
fitted to the smallest differences of the last half minute.
"""

from __future__ import annotations

from collections import deque

import numpy as np

_BUCKET_US = 1_000_000
_BUCKETS = 30
_BUCKETS_FOR_RATE = 10
_RATE_LIMIT = 0.05
# Beyond this a message is not late or jittery: one of the clocks has stepped.
_STEP_US = 1_000_000
_STEP_COUNT = 5
# A burst that was held up in a buffer comes at once; a clock that has stepped stays away.
_LATE_STEP_US = 3_000_000
_REBOOT_COUNT = 2
_UNIX_SMOOTHING = 0.1
_UNIX_STEP_US = 20_000


class BootClock:
    """Maps one component's boot time to the station's Unix time; reads no clock itself."""

    def __init__(self) -> None:
        self.reboots = 0
        self.steps = 0
        self._offset_us: float | None = None
        self._rate = 0.0
        self._anchor_boot_us = 0
        self._newest_boot_us = 0
        self._buckets: deque[tuple[int, int]] = deque(maxlen=_BUCKETS)  # (boot time, smallest receive - boot)
        self._bucket_id = 0
        self._strange: list[tuple[int, int]] = []  # (receive, boot) that do not fit
        self._unix_minus_boot_us: float | None = None

    @property
    def is_set(self) -> bool:
        """Whether any boot time has been seen."""
        return self._offset_us is not None

    def observe(self, t_boot_us: int, t_receive_us: int) -> None:
        """Take one pair; only of messages stamped when they are made, not of those that repeat an old stamp."""
        if self._offset_us is None:
            self._restart(t_boot_us, t_receive_us)
            return
        residual_us = t_receive_us - self._predict(t_boot_us)
        if abs(residual_us) > _STEP_US:
            self._observe_strange(t_boot_us, t_receive_us, residual_us)
            return
        self._strange.clear()
        self._newest_boot_us = max(self._newest_boot_us, t_boot_us)
        self._add_to_bucket(t_boot_us, t_receive_us - t_boot_us)
        if residual_us < 0:
            self._offset_us += residual_us

    def unix_from_boot(self, t_boot_us: int) -> int | None:
        """Station time of a boot time; None before the first observation."""
        if self._offset_us is None:
            return None
        return round(self._predict(t_boot_us))

    def observe_unix(self, t_vehicle_unix_us: int, t_boot_us: int) -> None:
        """Take the vehicle's own Unix time (SYSTEM_TIME), which need not agree with the station's."""
        difference = t_vehicle_unix_us - t_boot_us
        known = self._unix_minus_boot_us
        if known is None or abs(difference - known) > _UNIX_STEP_US:
            self._unix_minus_boot_us = float(difference)
        else:
            # The boot time is cut to a millisecond: the mean is better than any single difference.
            self._unix_minus_boot_us = known + _UNIX_SMOOTHING * (difference - known)

    def unix_from_vehicle_unix(self, t_vehicle_unix_us: int) -> int | None:
        """Station time of a stamp on the vehicle's Unix clock; None until SYSTEM_TIME has been seen."""
        if self._unix_minus_boot_us is None:
            return None
        return self.unix_from_boot(round(t_vehicle_unix_us - self._unix_minus_boot_us))

    def _predict(self, t_boot_us: int) -> float:
        offset_us = self._offset_us or 0.0
        return t_boot_us + offset_us + self._rate * (t_boot_us - self._anchor_boot_us)

    def _observe_strange(self, t_boot_us: int, t_receive_us: int, residual_us: float) -> None:
        """A pair that does not fit: a single one is an error, a run of them is a reboot or a step of a clock."""
        self._strange.append((t_receive_us, t_boot_us))
        ran_back = t_boot_us < self._newest_boot_us - _STEP_US
        late = residual_us > 0
        span_us = t_receive_us - self._strange[0][0]
        if ran_back and late and len(self._strange) >= _REBOOT_COUNT:
            self.reboots += 1
        elif len(self._strange) >= _STEP_COUNT and (not late or span_us > _LATE_STEP_US):
            self.steps += 1
        else:
            return
        self._restart(t_boot_us, t_receive_us)

    def _restart(self, t_boot_us: int, t_receive_us: int) -> None:
        self._offset_us = float(t_receive_us - t_boot_us)
        self._rate = 0.0
        self._anchor_boot_us = t_boot_us
        self._newest_boot_us = t_boot_us
        self._buckets.clear()
        self._buckets.append((t_boot_us, t_receive_us - t_boot_us))
        self._bucket_id = t_boot_us // _BUCKET_US
        self._strange.clear()
        self._unix_minus_boot_us = None

    def _add_to_bucket(self, t_boot_us: int, difference_us: int) -> None:
        bucket_id = t_boot_us // _BUCKET_US
        if bucket_id > self._bucket_id:
            self._refit(t_boot_us)
            self._bucket_id = bucket_id
            self._buckets.append((t_boot_us, difference_us))
        elif difference_us < self._buckets[-1][1]:
            self._buckets[-1] = (t_boot_us, difference_us)

    def _refit(self, t_boot_us: int) -> None:
        """Rate: the median slope between the buckets; anchor: the line's lowest contact with them."""
        pairs = np.array(self._buckets, dtype=np.float64)
        boot_us, difference_us = pairs[:, 0] - t_boot_us, pairs[:, 1]
        rate = 0.0
        if len(pairs) >= _BUCKETS_FOR_RATE:
            first, second = np.triu_indices(len(pairs), k=len(pairs) // 3)
            slopes = (difference_us[second] - difference_us[first]) / (boot_us[second] - boot_us[first])
            rate = float(np.clip(np.median(slopes), -_RATE_LIMIT, _RATE_LIMIT))
        self._rate = rate
        self._anchor_boot_us = t_boot_us
        self._offset_us = float(np.min(difference_us - rate * boot_us))
