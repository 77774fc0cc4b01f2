"""Targets over REST and on the stream."""

import re
from pathlib import Path

import pytest

from tests.backend.station_runner import next_of, running_station

ZURICH = {"lat_deg": 47.3769, "lon_deg": 8.5417, "name": "Bridge"}


async def test_create_get_change_delete(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        client = running.client
        created = await client.post("/api/v1/targets", json=ZURICH)
        target_id = created.json()["id"]
        changed = await client.patch(f"/api/v1/targets/{target_id}", json={"name": "Quay"}, headers={"If-Match": '"1"'})
        stale = await client.patch(f"/api/v1/targets/{target_id}", json={"name": "No"}, headers={"If-Match": '"1"'})
        listed = (await client.get("/api/v1/targets")).json()
        deleted = await client.delete(f"/api/v1/targets/{target_id}", headers={"If-Match": changed.headers["etag"]})
        gone = await client.get(f"/api/v1/targets/{target_id}")

    assert (created.status_code, created.headers["etag"]) == (201, '"1"')
    assert created.json()["geometry"]["coordinates"] == [8.5417, 47.3769]
    assert created.json()["properties"]["mgrs"].startswith("32TMT65")
    assert created.json()["properties"]["utm"] == "32T 465403 5247151"
    assert created.json()["properties"]["dms"] == "47°22′36.84″N 008°32′30.12″E"
    assert created.json()["properties"]["ellipse95"] is None
    assert (changed.status_code, changed.json()["properties"]["version"], changed.headers["etag"]) == (200, 2, '"2"')
    assert stale.status_code == 412
    assert stale.headers["content-type"] == "application/problem+json"
    assert [feature["properties"]["name"] for feature in listed["features"]] == ["Quay"]
    assert (deleted.status_code, gone.status_code) == (204, 404)


async def test_everybody_hears_of_a_target(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running, running.stream() as socket:
        hello = await next_of(socket, "hello")
        created = (await running.client.post("/api/v1/targets", json=ZURICH)).json()
        heard = await next_of(socket, "target")
        await running.client.delete(f"/api/v1/targets/{created['id']}")
        dropped = await next_of(socket, "target")

    assert hello["targets"] == {"type": "FeatureCollection", "features": []}
    assert heard["action"] == "created"
    assert heard["target"] == created
    assert (dropped["action"], dropped["target"]) == ("deleted", created["id"])


async def test_targets_are_there_after_a_restart(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        created = (await running.client.post("/api/v1/targets", json=ZURICH)).json()
    async with running_station(tmp_path) as running:
        listed = (await running.client.get("/api/v1/targets")).json()

    assert listed["features"] == [created]


async def test_wrong_requests_are_refused_with_a_reason(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        client = running.client
        answers = {
            "nothing": await client.post("/api/v1/targets", json={"name": "x"}),
            "latitude": await client.post("/api/v1/targets", json={"lat_deg": 91, "lon_deg": 0}),
            "stranger": await client.post(
                "/api/v1/targets", json={"vehicle_id": "9", "frame_id": 1, "u_px": 1, "v_px": 1}
            ),
            "unknown field": await client.post("/api/v1/targets", json={**ZURICH, "colour": "red"}),
            "nonsense": await client.get("/api/v1/targets?format=nonsense"),
            "half a move": await client.patch("/api/v1/targets/x", json={"lat_deg": 1}),
            "no etag": await client.delete("/api/v1/targets/x", headers={"If-Match": "one"}),
        }

    statuses = {name: answer.status_code for name, answer in answers.items()}
    assert statuses == {
        "nothing": 400, "latitude": 422, "stranger": 404, "unknown field": 422, "nonsense": 400,
        "half a move": 400, "no etag": 400,
    }  # fmt: skip
    assert all(answer.headers["content-type"] == "application/problem+json" for answer in answers.values())
    assert all(answer.json()["detail"] for answer in answers.values())


@pytest.mark.parametrize(
    ("format", "media_type", "words"),
    [
        ("geojson", "application/geo+json", b'"FeatureCollection"'),
        ("kml", "application/vnd.google-earth.kml+xml", b"<name>Bridge</name>"),
        ("gpx", "application/gpx+xml", b"<name>Bridge</name>"),
        ("csv", "text/csv; charset=utf-8", b",Bridge,47.3769000,8.5417000,"),
        ("cot", "application/xml-external-parsed-entity", b'callsign="Bridge"'),
    ],
)
async def test_targets_as_files(tmp_path: Path, format: str, media_type: str, words: bytes) -> None:
    async with running_station(tmp_path) as running:
        await running.client.post("/api/v1/targets", json=ZURICH)
        answer = await running.client.get(f"/api/v1/targets?format={format}")
        described = (await running.client.get("/openapi.json")).json()["paths"]["/api/v1/targets"]["get"]

    assert (answer.status_code, answer.headers["content-type"]) == (200, media_type)
    assert re.fullmatch(
        rf'attachment; filename="targets-\d{{8}}T\d{{6}}Z\.{format}"', answer.headers["content-disposition"]
    )
    assert words in answer.content
    assert media_type.partition(";")[0] in described["responses"]["200"]["content"]


async def test_without_a_format_targets_are_not_a_file(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        answer = await running.client.get("/api/v1/targets")

    assert answer.headers["content-type"] == "application/json"
    assert "content-disposition" not in answer.headers


async def test_a_moved_target_loses_the_clicks_uncertainty(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        target_id = (await running.client.post("/api/v1/targets", json=ZURICH)).json()["id"]
        moved = await running.client.patch(f"/api/v1/targets/{target_id}", json={"lat_deg": 47.0, "lon_deg": 8.0})

    assert moved.json()["geometry"]["coordinates"] == [8.0, 47.0]
    assert moved.json()["properties"]["method"] == "manual"
