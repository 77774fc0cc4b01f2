"""A station that sends its targets: from REST to the sockets of receivers, and how it says that one is missing."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import httpx
import pytest

from backend.errors import StartError
from tests.backend.exports.receivers import HOST, free_port, tcp_receiver, udp_receiver, until
from tests.backend.station_runner import RunningStation, running_station

ZURICH = {"lat_deg": 47.3769, "lon_deg": 8.5417, "name": "Bridge"}


async def _ready(client: httpx.AsyncClient) -> dict[str, Any]:
    found: dict[str, Any] = (await client.get("/readyz")).json()
    return found


async def test_targets_go_out_as_they_are_made_changed_and_deleted(tmp_path: Path) -> None:
    async with udp_receiver() as udp, tcp_receiver() as tcp:
        destinations = (f"udp://{HOST}:{udp.port}", f"tcp://{HOST}:{tcp.port}")
        async with running_station(tmp_path, cot=destinations) as running:
            path = f"/api/v1/targets/{(await running.client.post('/api/v1/targets', json=ZURICH)).json()['id']}"
            created = [await udp.event(), await tcp.event()]
            await running.client.patch(path, json={"name": "Quay", "lat_deg": 47.0, "lon_deg": 8.0})
            changed = [await udp.event(), await tcp.event()]
            await running.client.delete(path)
            deleted = [await udp.event(), await tcp.event()]
            await until(lambda: all(state.sent == 3 for state in running.station.cot.states()))
            metrics = (await running.client.get("/metrics")).text
            ready = await _ready(running.client)

    assert {event.get("uid") for event in created + changed + deleted} == {f"pilotage.{path.rpartition('/')[2]}"}
    assert [event.find("point").get("lat") for event in created + changed] == ["47.3769000"] * 2 + ["47.0000000"] * 2
    assert [event.find("detail/contact").get("callsign") for event in changed] == ["Quay"] * 2
    assert [event.get("stale") == event.get("time") for event in created + deleted] == [False, False, True, True]
    assert f'pilotage_cot_events_total{{destination="{destinations[0]}"}} 3.0' in metrics
    assert ready["ready"] is True
    assert ready["waiting_for"] == []
    assert ready["cot"] == [
        {"destination": one, "sent": 3, "failures": 0, "dropped": 0, "problem": None, "last_error": None}
        for one in destinations
    ]


async def test_kept_targets_go_out_after_a_restart(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        await running.client.post("/api/v1/targets", json=ZURICH)
    async with udp_receiver() as udp, running_station(tmp_path, cot=(f"udp://{HOST}:{udp.port}",)):
        assert (await udp.event()).find("detail/contact").get("callsign") == "Bridge"


async def test_a_missing_receiver_is_waited_for_and_holds_up_nothing(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_STREAM)
    async with running_station(tmp_path, cot=(f"tcp://{HOST}:{port}",)) as running:
        await until(lambda: bool(running.station.cot.states()[0].failures))
        created = await running.client.post("/api/v1/targets", json=ZURICH)
        ready = await _ready(running.client)
        metrics = (await running.client.get("/metrics")).text
        async with tcp_receiver(port) as receiver:
            event = await receiver.event()

    assert created.status_code == 201
    assert ready["ready"] is True
    assert [one.partition(": ")[0] for one in ready["waiting_for"]] == [f"CoT to tcp://{HOST}:{port}"]
    assert "pilotage_cot_failures_total" in metrics
    assert event.find("detail/contact").get("callsign") == "Bridge"


async def test_an_interface_that_is_not_there_ends_the_start_and_frees_the_data(tmp_path: Path) -> None:
    with pytest.raises(StartError, match=r"--cot .*no interface 'wlan99'"):
        async with running_station(tmp_path, cot=("udp://239.2.3.1:6969?interface=wlan99",)):
            pass
    async with running_station(tmp_path) as running:
        assert isinstance(running, RunningStation)
