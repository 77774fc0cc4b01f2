"""Clicks on the newest picture, as a program sends them: from the request to the answer with the coordinate."""

from __future__ import annotations

import asyncio
import json
import struct
import time

import httpx
import websockets

from benchmarks.budget import Measurement, percentile
from benchmarks.flying import FlyingStation

ANSWER_P95_MS = 100.0
# What an operator does at most, and no multiple of the estimator's own pace.
EVERY_S = 0.23
NAME = "click to answer of the station, p95"


def measure_clicks(station: FlyingStation, short: bool) -> list[Measurement]:
    """Time from the request to the answer, of clicks on pictures as fresh as they come."""
    vehicle = station.get("/api/v1/vehicles")[0]
    times_ms = asyncio.run(_click(station.address, vehicle["id"], vehicle["video_source"], 40 if short else 200))
    note = f"{len(times_ms)} clicks, median {percentile(times_ms, 0.5):.3g} ms, longest {max(times_ms):.3g} ms"
    return [Measurement(NAME, percentile(times_ms, 0.95), "ms", ANSWER_P95_MS, note=note)]


async def _click(address: str, vehicle_id: str, source: str, count: int) -> list[float]:
    times_ms: list[float] = []
    newest = -1
    url = f"{address.replace('http', 'ws')}/api/v1/video/{source}"
    async with (
        websockets.connect(url, max_size=None, max_queue=None) as video,
        httpx.AsyncClient(base_url=address, timeout=30.0) as client,
    ):

        async def watch() -> None:
            nonlocal newest
            while True:
                packet = bytes(await video.recv())  # type: ignore[arg-type]  # pictures are binary
                (length,) = struct.unpack_from(">I", packet)
                newest = json.loads(packet[4 : 4 + length])["frame_id"]

        watching = asyncio.create_task(watch())
        try:
            while newest < 0:
                await asyncio.sleep(EVERY_S)
            for n in range(count):
                await asyncio.sleep(EVERY_S)
                pixel = {"u_px": 200.0 + 40.0 * (n % 7), "v_px": 150.0 + 40.0 * (n % 5)}
                began_s = time.perf_counter()
                answer = await client.post(
                    "/api/v1/targets", json={"vehicle_id": vehicle_id, "frame_id": newest, **pixel}
                )
                times_ms.append((time.perf_counter() - began_s) * 1e3)
                answer.raise_for_status()
        finally:
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)
    return times_ms
