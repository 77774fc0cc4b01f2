"""A real flight played into a running station in real time: its video's clock is 0.12 s off, and nobody says so."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest

from backend.demo import free_udp_ports
from geodata.flight import FlightFolder
from tests.backend.station_runner import PATIENCE_S, next_of, running_station
from tests.shared_data import shared_data


async def test_a_live_station_finds_the_clock_of_a_real_video(tmp_path: Path) -> None:
    """
    Fault: no offset is configured, frame times are 0.12 s late (checked against the true attitude by other means).
    Expected: offset and misalignment are found and told with their sigmas, the states go on, the recording says it.
    """
    flight = shared_data("flights/plane_80m")
    mavlink_port, video_port = free_udp_ports(2)
    command = [
        sys.executable,
        "-m",
        "backend.cli",
        "replay",
        str(flight),
        "--live",
        "--start-s",
        "20",
        "--station",
        "none",
    ]
    command += ["--mavlink", f"udpout:127.0.0.1:{mavlink_port}", "--video", f"udp://127.0.0.1:{video_port}"]
    async with running_station(
        tmp_path / "data", mavlink=(f"udpin:127.0.0.1:{mavlink_port}",), video=f"udp://127.0.0.1:{video_port}",
        camera=flight / "flight.json", map=str(flight / "reference.tif"), record=True,
    ) as running, running.stream() as stream:  # fmt: skip
        await next_of(stream, "hello")
        player = await asyncio.create_subprocess_exec(*command, stdout=-1, stderr=-1)
        try:
            states = [await next_of(stream, "state")]
            while states[-1]["video_clock"]["source"] != "found":
                states.append(await asyncio.wait_for(next_of(stream, "state"), PATIENCE_S))
            fixes = [await next_of(stream, "fix") for _ in range(3)]
            told = (await running.client.get("/api/v1/vehicles/1/state")).json()
            await running.client.post("/api/v1/recording", json={"active": False})
            (recorded,) = (tmp_path / "data" / "flights").iterdir()
        finally:
            player.terminate()
            await player.wait()

    assert states[0]["video_clock"] == {
        "source": "searching", "time_offset_s": None, "std_s": None, "reason": states[0]["video_clock"]["reason"],
    }  # fmt: skip
    assert states[0]["video_clock"]["reason"]
    clock = told["video_clock"]
    # the sensors' own delay is known to 4 ms; a loaded machine delays pictures and packets unlike each other
    assert clock["time_offset_s"] == pytest.approx(-0.120, abs=0.030)
    assert 0.003 < clock["std_s"] < 0.02
    # by other means: -0.02, 0.73, -0.26 degrees
    assert told["boresight_deg"] == pytest.approx([-0.02, 0.73, -0.26], abs=4 * max(told["boresight_std_deg"]))
    assert max(told["boresight_std_deg"]) < 0.573
    assert any(fix["accepted"] for fix in fixes)
    times = [state["t_state_unix_us"] for state in states]
    assert times == sorted(times)
    assert FlightFolder.open(recorded).meta.video.time_offset_s == pytest.approx(clock["time_offset_s"], abs=0.01)
