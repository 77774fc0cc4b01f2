"""The station's clocks, and a station whose machine has its clock set while it flies."""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from typing import Any

import pytest

from backend.clock import unix_us
from geodata.flight import FlightFolder
from tests.backend.aircraft import flying, frame_header
from tests.backend.station_runner import next_of

STEP_US = 10_000_000
REAL_TIME_NS = time.time_ns


class Machine:
    """The machine's clock, and how far somebody has set it off."""

    def __init__(self) -> None:
        self.off_ns = 0

    def time_ns(self) -> int:
        return REAL_TIME_NS() + self.off_ns

    def time(self) -> float:
        return self.time_ns() / 1e9


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    machine = Machine()
    monkeypatch.setattr(time, "time_ns", machine.time_ns)
    monkeypatch.setattr(time, "time", machine.time)
    return machine


@pytest.mark.parametrize("step_us", [-STEP_US, STEP_US])
def test_the_time_base_runs_on_when_the_clock_is_set(machine: Machine, step_us: int) -> None:
    before_us = unix_us()
    assert abs(before_us - REAL_TIME_NS() // 1000) < 60_000_000
    machine.off_ns = step_us * 1000
    after_us = unix_us()

    assert 0 <= after_us - before_us < 5_000_000


async def test_a_clock_set_back_in_flight_stops_nothing(tmp_path: Path, machine: Machine) -> None:
    """
    Fault: the machine's clock is set back by ten seconds while a vehicle flies and is recorded.
    Expected: states, GPS and video go on with rising times and no alarm, clicks work, the recording runs forward.
    """
    heard: list[dict[str, Any]] = []

    async def listen(stream: Any, count: int) -> None:
        states = 0
        while states < count:
            heard.append(await next_of(stream, "state", "gps", "alarm", "link", "video", "vehicle"))
            states += heard[-1]["type"] == "state"

    async with flying(tmp_path) as (running, _, stream):
        await next_of(stream, "state")
        await running.client.post("/api/v1/recording", json={"active": True, "name": "step"})
        async with running.video("cam-1") as pictures:
            headers = [await frame_header(pictures) for _ in range(25)]
            await listen(stream, 20)
            before = len(heard)
            machine.off_ns = -STEP_US * 1000
            headers += [await frame_header(pictures) for _ in range(50)]
            await listen(stream, 40)
            click = {"vehicle_id": "1", "frame_id": headers[-5]["frame_id"], "u_px": 160, "v_px": 120}
            clicked = await running.client.post("/api/v1/targets", json=click)
        await running.client.post("/api/v1/recording", json={"active": False})
        (recorded,) = (tmp_path / "data" / "flights").iterdir()

    def of(kind: str, field: str) -> list[Any]:
        return [message[field] for message in heard if message["type"] == kind]

    after = {message["type"] for message in heard[before:]}
    assert {"state", "gps", "link", "video"} <= after
    for times in (
        of("state", "t_state_unix_us"), of("gps", "t_gps_unix_us"), [message["t_unix_us"] for message in heard],
        [header["t_unix_us"] for header in headers],
    ):  # fmt: skip
        assert all(a <= b for a, b in itertools.pairwise(times)), times
        assert times[-1] - times[0] < 60_000_000
    assert len(set(of("state", "epoch"))) == 1
    assert [message["text"] for message in heard if message["type"] == "alarm"] == []
    assert all(of("link", "connected"))
    assert {header["epoch"] for header in headers} == {headers[0]["epoch"]}
    assert clicked.status_code == 201, clicked.text
    flight = FlightFolder.open(recorded)
    times_us = [t_us for t_us, _ in flight.telemetry()]
    assert times_us == sorted(times_us)
    frame_times = flight.frame_times()
    assert frame_times is not None
    # 75 pictures were shown meanwhile: none is left out of the list for a time that ran back
    assert len(frame_times.t_video_us) >= 70
    assert flight.warnings == []
