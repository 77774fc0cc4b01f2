"""The station's own pace: alarms with hysteresis of their causes, and a fault that silences nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest

from backend import alarms
from backend.hub import Hub
from tests.backend.station_runner import next_of, running_station


class Usage(NamedTuple):
    total: int
    used: int
    free: int


async def test_a_full_disk_alarms_and_the_alarm_ends_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = [10**12]
    monkeypatch.setattr(alarms, "DISK_LOW", replace(alarms.DISK_LOW, clear_after_s=0.0))
    monkeypatch.setattr("backend.station.shutil.disk_usage", lambda _: Usage(2 * 10**12, 0, free[0]))
    async with running_station(tmp_path) as running, running.stream() as stream:
        await next_of(stream, "hello")
        free[0] = 5 * 10**8
        raised = await next_of(stream, "alarm")
        free[0] = 10**12
        over = await next_of(stream, "alarm")
        metrics = (await running.client.get("/metrics")).text

    assert (raised["code"], raised["active"]) == ("disk_low", True)
    assert "0.5 GB" in raised["text"]
    assert (over["code"], over["active"]) == ("disk_low", False)
    assert "pilotage_disk_free_bytes 1e+12" in metrics


async def test_a_disk_that_cannot_be_asked_is_no_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with running_station(tmp_path) as running, running.stream() as stream:
        await next_of(stream, "hello")

        def broken(_: object) -> Usage:
            raise OSError(5, "Input/output error")

        monkeypatch.setattr("backend.station.shutil.disk_usage", broken)
        alarm = await next_of(stream, "alarm")
        health = await running.client.get("/healthz")

    assert alarm["code"] == "disk_low"
    assert health.status_code == 200


async def test_one_message_that_fails_does_not_silence_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault: the first messages of the ticker cannot be made. Expected: those after them come."""
    publish, failures = Hub.publish, [3]

    def sometimes(self: Hub, kind: str, /, **fields: object) -> None:
        if kind == "recording" and failures[0] > 0:
            failures[0] -= 1
            raise TypeError("not JSON")
        publish(self, kind, **fields)

    async with running_station(tmp_path) as running, running.stream() as stream:
        await next_of(stream, "hello")
        await running.client.post("/api/v1/recording", json={"active": True})
        monkeypatch.setattr(Hub, "publish", sometimes)
        while failures[0] > 0:
            await running.client.get("/healthz")
        told = await next_of(stream, "recording")
        told = await next_of(stream, "recording") if told["duration_s"] < 1.0 else told

    assert told["active"]
