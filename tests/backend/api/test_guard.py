"""Pages of other origins, and other names for this machine, are turned away."""

from pathlib import Path

import pytest
import websockets

from tests.backend.station_runner import next_of, running_station


async def test_a_foreign_page_may_read_nothing_that_changes_and_no_stream(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        evil = {"Origin": "http://evil.example"}
        post = await running.client.post("/api/v1/targets", json={"lat_deg": 1, "lon_deg": 1}, headers=evil)
        with pytest.raises(websockets.InvalidStatus) as refused:
            async with running.stream(origin="http://evil.example"):
                pass
        async with running.stream(origin=running.address) as socket:
            hello = await next_of(socket, "hello")
        own = await running.client.post(
            "/api/v1/targets", json={"lat_deg": 1, "lon_deg": 1}, headers={"Origin": running.address}
        )

    assert post.status_code == 403
    assert refused.value.response.status_code == 403
    assert hello["type"] == "hello"
    assert own.status_code == 201


async def test_another_name_for_this_machine_is_turned_away(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        rebound = await running.client.get("/healthz", headers={"Host": "evil.example"})
        local = await running.client.get("/healthz", headers={"Host": "localhost:8700"})

    assert rebound.status_code == 403
    assert local.status_code == 200
