"""A hundred viewers of one aircraft's stream."""

from __future__ import annotations

import asyncio
import re
import time

import websockets

from benchmarks.budget import Measurement, percentile
from benchmarks.flying import FlyingStation

VIEWERS, AT_ONCE = 100, 10
DELAY_MS, LATE_FRAMES = 200.0, 0.0
_SAID_AT = re.compile(r'"t_unix_us":(\d+)')


def measure_viewers(station: FlyingStation, short: bool) -> list[Measurement]:
    """Delay from the making of a message to its arrival, and frames that the estimator had no time for meanwhile."""
    seconds = 8.0 if short else 60.0
    dropped = "pilotage_navigator_frames_dropped"
    before = station.metric(dropped)
    delays_ms = asyncio.run(_watch(station.address.replace("http", "ws") + "/api/v1/stream", seconds))
    late = station.metric(dropped) - before
    lost = station.metric("pilotage_stream_clients_dropped_total")
    note = f"{len(delays_ms)} messages in {seconds:.0f} s; median {percentile(delays_ms, 0.5):.3g} ms"
    return [
        Measurement(f"{VIEWERS} viewers, message delay p99", percentile(delays_ms, 0.99), "ms", DELAY_MS, note=note),
        Measurement(
            f"{VIEWERS} viewers, estimator frames late", late, "frames", LATE_FRAMES, note=f"{lost:.0f} viewers dropped"
        ),
    ]


async def _watch(url: str, seconds: float) -> list[float]:
    delays_ms: list[float] = []
    sockets: list[websockets.ClientConnection] = []
    for _ in range(VIEWERS // AT_ONCE):
        connects = (websockets.connect(url, max_size=None, max_queue=None) for _ in range(AT_ONCE))
        sockets += await asyncio.gather(*connects)
    try:
        # What was said while the others still connected has waited here, not on its way.
        from_us = time.time_ns() // 1000
        end_s = time.monotonic() + seconds
        await asyncio.gather(*(_read(socket, from_us, end_s, delays_ms) for socket in sockets))
    finally:
        await asyncio.gather(*(socket.close() for socket in sockets))
    return delays_ms


async def _read(socket: websockets.ClientConnection, from_us: int, end_s: float, delays_ms: list[float]) -> None:
    while (left_s := end_s - time.monotonic()) > 0:
        try:
            text = str(await asyncio.wait_for(socket.recv(), left_s))
        except TimeoutError:
            return
        said = _SAID_AT.search(text, 0, 200)
        if said is not None and int(said[1]) >= from_us:
            delays_ms.append((time.time_ns() / 1e3 - int(said[1])) / 1e3)
