"""The stream: hello first, then what happens; what a client says or fails to read harms nobody else."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import orjson
import pytest
import websockets

from backend.hub import Mailbox
from tests.backend.station_runner import PATIENCE_S, next_of, running_station


async def test_a_newcomer_is_told_everything_at_once(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        await running.client.post("/api/v1/targets", json={"lat_deg": 47, "lon_deg": 8, "name": "here"})
        await running.client.post("/api/v1/recording", json={"active": True})
        async with running.stream() as stream:
            first = orjson.loads(await asyncio.wait_for(stream.recv(), PATIENCE_S))

    assert first["type"] == "hello"
    assert first["station"]["data_dir_free_bytes"] > 0
    assert [target["properties"]["name"] for target in first["targets"]["features"]] == ["here"]
    assert first["recording"]["active"]
    assert (first["vehicles"], first["replays"], first["alarms"], first["pad"]) == ([], [], [], None)


@pytest.mark.parametrize("said", ["{", "[]", '"ping"', '{"type": 7}', "x" * 100_000, b"\x00\xff", ""])
async def test_whatever_a_client_says_the_stream_goes_on(tmp_path: Path, said: str | bytes) -> None:
    async with running_station(tmp_path) as running, running.stream() as stream:
        await next_of(stream, "hello")
        await stream.send(said)
        await stream.send('{"type": "ping"}')
        pong = await next_of(stream, "pong")

    assert pong["seq"] > 0


async def test_a_client_that_reads_too_slowly_is_sent_away_and_the_others_read_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """
    Fault: one of two clients does not read, while more is said than may wait for it.
    Expected: it is closed with 1013 and counted, the other misses nothing.
    """
    monkeypatch.setattr("backend.hub.Mailbox", lambda: Mailbox(max_messages=50))
    async with running_station(tmp_path) as running, running.stream() as reader:
        await next_of(reader, "hello")
        # A small window: what is not read waits in the station, not in the buffers between.
        async with running.stream(max_queue=1) as deaf:
            await next_of(deaf, "hello")
            deaf.transport.pause_reading()
            for n in range(400):
                running.station.hub.publish("alarm", number=n, text="x" * 50_000)
                await asyncio.sleep(0)
                assert (await next_of(reader, "alarm"))["number"] == n
            deaf.transport.resume_reading()
            with pytest.raises(websockets.ConnectionClosed) as closed:
                async with asyncio.timeout(PATIENCE_S):
                    while True:
                        await deaf.recv()
        metrics = (await running.client.get("/metrics")).text

    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1013
    assert "pilotage_stream_clients_dropped_total 1.0" in metrics


async def test_a_client_that_vanishes_leaves_nothing_behind(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running, running.stream() as witness:
        await next_of(witness, "hello")
        gone: Any = await running.stream()
        await next_of(gone, "hello")
        assert running.station.hub.listeners == 2
        gone.transport.abort()
        async with asyncio.timeout(PATIENCE_S):
            while running.station.hub.listeners > 1:
                await running.client.get("/healthz")

    assert running.station.hub.listeners == 0
