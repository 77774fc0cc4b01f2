"""Vehicles over REST: strangers, and commands that make no sense."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.backend.station_runner import running_station


async def test_strangers_are_named_with_where_to_look(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        client = running.client
        answers = [
            await client.get("/api/v1/vehicles/7"),
            await client.get("/api/v1/vehicles/7/state"),
            await client.get("/api/v1/vehicles/7/tracks"),
            await client.post("/api/v1/vehicles/7/navigation", json={"gps_denied": True}),
            await client.post("/api/v1/vehicles/7/commands", json={"command": "land"}),
        ]

    assert [answer.status_code for answer in answers] == [404] * 5
    assert all("'7'" in answer.json()["detail"] for answer in answers)
    assert "/api/v1/vehicles" in answers[0].json()["detail"]


@pytest.mark.parametrize(
    "body",
    [
        {}, {"command": "dance"}, {"command": "goto", "lat_deg": 91}, {"command": "takeoff", "alt_rel_m": -1},
        {"command": "land", "surprise": True}, {"command": "goto", "lat_deg": "north"}, [], None,
    ],
)  # fmt: skip
async def test_commands_that_make_no_sense_are_refused_before_anybody_hears_them(tmp_path: Path, body: Any) -> None:
    async with running_station(tmp_path) as running:
        refused = await running.client.post("/api/v1/vehicles/1/commands", json=body)

    assert refused.status_code == 422
    assert refused.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("query", ["source=dowsing", "since_us=-1", "since_us=soon"])
async def test_tracks_that_do_not_exist_are_refused(tmp_path: Path, query: str) -> None:
    async with running_station(tmp_path) as running:
        refused = await running.client.get(f"/api/v1/vehicles/1/tracks?{query}")

    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"].startswith("query/")


@pytest.mark.parametrize("query", ["since_us=-1", "since_us=soon", "step_us=60000001", "step_us=-1"])
async def test_a_history_that_makes_no_sense_is_refused(tmp_path: Path, query: str) -> None:
    async with running_station(tmp_path) as running:
        refused = await running.client.get(f"/api/v1/vehicles/1/history?{query}")
        stranger = await running.client.get("/api/v1/vehicles/7/history")

    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"].startswith("query/")
    assert stranger.status_code == 404
