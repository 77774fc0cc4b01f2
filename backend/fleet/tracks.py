"""Where a vehicle has been: rings that keep more than an hour at five points a second."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

TRACK_SOURCES = ("gps", "vision", "fused")
MIN_STEP_US = 190_000  # five a second, with room for jitter
MAX_POINTS = 20_000  # 66 min at five a second
GAP_US = 5_000_000


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """One point of a track; ``epoch`` changes at a reconnect or seek and then no line joins the two."""

    t_us: int
    epoch: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


class TrackRing:
    """The newest points of one track, in order of time, at most five a second."""

    def __init__(self) -> None:
        self._points: deque[TrackPoint] = deque(maxlen=MAX_POINTS)

    def add(self, point: TrackPoint) -> bool:
        """Keep a point unless it comes too soon after, or before, the last one of the same epoch."""
        if self._points:
            last = self._points[-1]
            if point.epoch == last.epoch and point.t_us - last.t_us < MIN_STEP_US:
                return False
        self._points.append(point)
        return True

    def clear(self) -> None:
        """Forget everything."""
        self._points.clear()

    def pieces(self, since_us: int = -1) -> list[list[TrackPoint]]:
        """Runs of points after a time, cut at gaps and epochs."""
        pieces: list[list[TrackPoint]] = []
        for point in self._points:
            if point.t_us <= since_us:
                continue
            last = pieces[-1][-1] if pieces else None
            if last is None or point.epoch != last.epoch or point.t_us - last.t_us > GAP_US:
                pieces.append([point])
            else:
                pieces[-1].append(point)
        return pieces
