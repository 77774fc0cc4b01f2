"""Recording over REST: on, off, twice, and what becomes of it."""

from __future__ import annotations

from pathlib import Path

from tests.backend.station_runner import next_of, running_station

PATH = "/api/v1/recording"


async def test_on_off_and_the_flight_is_there(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running, running.stream() as stream:
        client = running.client
        before = (await client.get(PATH)).json()
        started = await client.post(PATH, json={"active": True, "name": "North field"})
        told = await next_of(stream, "recording")
        again = await client.post(PATH, json={"active": True})
        listed = (await client.get("/api/v1/flights")).json()
        kept = await client.delete(f"/api/v1/flights/{started.json()['flight_id']}")
        stopped = (await client.post(PATH, json={"active": False})).json()
        once_more = await client.post(PATH, json={"active": False})

    assert not before["active"]
    assert started.json()["active"]
    assert started.json()["flight_id"].endswith("-north-field")
    assert told["flight_id"] == started.json()["flight_id"]
    assert again.status_code == 409
    assert "stop it first" in again.json()["detail"]
    assert [flight["recording"] for flight in listed] == [True]
    assert kept.status_code == 409
    assert not stopped["active"]
    assert once_more.status_code == 200
    assert (tmp_path / "flights" / started.json()["flight_id"] / "flight.json").exists()


async def test_a_name_cannot_lead_out_of_the_folder(tmp_path: Path) -> None:
    async with running_station(tmp_path / "data") as running:
        started = await running.client.post(PATH, json={"active": True, "name": "../../../etc/passwd \n"})
        await running.client.post(PATH, json={"active": False})
        too_long = await running.client.post(PATH, json={"active": True, "name": "x" * 101})

    (folder,) = (tmp_path / "data" / "flights").iterdir()
    assert started.json()["flight_id"] == folder.name
    assert folder.name.endswith("-etc-passwd")
    assert too_long.status_code == 422


async def test_a_disk_that_takes_nothing_is_said_and_the_station_goes_on(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        (tmp_path / "flights").write_text("a file where the folder should be")
        refused = await running.client.post(PATH, json={"active": True})
        health = await running.client.get("/healthz")

    assert refused.status_code == 409
    assert "flights" in refused.json()["detail"]
    assert health.status_code == 200
