"""Plans over REST, and to and from an autopilot on a real socket: the simulator's own, or one that is scripted."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest

from backend.demo import free_udp_ports
from simulator.mavlink_input import messages_in
from simulator.mission_store import KINDS, MissionStore
from tests.backend.link.wire import Sender
from tests.backend.missions.plans import WAYPOINTS, plan_document
from tests.backend.station_runner import PATIENCE_S, RunningStation, next_of, running_station

PLAN = "/api/v1/vehicles/1/plan"


def without_fence() -> dict[str, Any]:
    document = plan_document()
    del document["geoFence"], document["rallyPoints"]
    return document


class Vehicle:
    """Heartbeats and the simulator's mission store; ``swallows`` says what it does not hear."""

    def __init__(self, port: int) -> None:
        self.wire = Sender()
        self.store = MissionStore(self.send)
        self.swallows: Callable[[Any], bool] = lambda _m: False
        self.count = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._target = ("127.0.0.1", port)

    def send(self, message: Any) -> None:
        self._socket.sendto(self.wire.pack(message), self._target)

    def step(self) -> None:
        if self.count % 20 == 0:
            self._socket.sendto(self.wire.heartbeat(), self._target)
        self.count += 1
        with contextlib.suppress(BlockingIOError):
            while True:
                for message in messages_in(self._socket.recv(2048)):
                    if message.get_type() in KINDS and not self.swallows(message):
                        self.store.receive(message, self.count * 20_000)
        self.store.step(self.count * 20_000)

    def close(self) -> None:
        self._socket.close()


@contextlib.asynccontextmanager
async def connected(tmp_path: Path) -> AsyncIterator[tuple[RunningStation, Vehicle, Any]]:
    (port,) = free_udp_ports(1)
    vehicle = Vehicle(port)

    async def live() -> None:
        while True:
            vehicle.step()
            await asyncio.sleep(0.02)

    async with (
        running_station(tmp_path / "data", mavlink=(f"udpin:127.0.0.1:{port}",)) as running,
        running.stream() as stream,
    ):
        task = asyncio.create_task(live())
        try:
            await next_of(stream, "vehicle")
            yield running, vehicle, stream
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            vehicle.close()


async def end_of(stream: Any, answer: Any) -> dict[str, Any]:
    """The last acknowledgement of what an answer has begun."""
    assert answer.status_code == 202, answer.text
    async with asyncio.timeout(PATIENCE_S):
        while True:
            ack = await next_of(stream, "ack")
            if ack["command_id"] == answer.json()["command_id"] and ack["status"] != "in_progress":
                return ack


async def test_a_plan_is_kept_shown_and_given_back_as_it_was(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        client = running.client
        missing = await client.get(PLAN)
        put = await client.put(PLAN, content=json.dumps(plan_document()))
        shown = (await client.get(PLAN)).json()
        file = await client.get(f"{PLAN}?format=plan")
    async with running_station(tmp_path) as running:
        again = await running.client.get(f"{PLAN}?format=plan")
        gone = await running.client.delete(PLAN)
        after = await running.client.get(PLAN)

    assert (missing.status_code, missing.json()["type"]) == (404, "/problems#NoPlan")
    assert put.json() == shown
    assert [item["name"] for item in shown["items"]][:2] == ["NAV_TAKEOFF", "NAV_WAYPOINT"]
    item = shown["items"][0]
    assert (item["lat_deg"], item["alt_m"], item["datum"], item["params"][3]) == (47.397742, 50.0, "home", None)
    assert (shown["circles"][0]["radius_m"], shown["rally"][0]["alt_rel_m"], shown["warnings"]) == (60.5, 30.0, [])
    assert json.loads(file.content) == plan_document() == json.loads(again.content)
    assert "vehicle-1.plan" in file.headers["content-disposition"]
    assert (gone.status_code, after.status_code) == (204, 404)


async def test_what_cannot_be_kept_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    bad = plan_document()
    bad["mission"]["items"][1]["TransectStyleComplexItem"] = {}
    async with running_station(tmp_path) as running:
        client = running.client
        await client.put(PLAN, content=WAYPOINTS)
        refused = [
            await client.put(PLAN, content=json.dumps(bad)), await client.put(PLAN, content=b"\x00\xff"),
            await client.put(PLAN, content=b" " * 4_000_001),
        ]  # fmt: skip
        strangers = [await client.get(f"/api/v1/vehicles/{name}/plan") for name in ("0", "256", "x", "..%2f1")]
        unheard = await client.post(f"{PLAN}/upload")
        kept = (await client.get(PLAN)).json()

    assert [answer.status_code for answer in refused] == [422] * 3
    assert refused[0].json()["detail"].startswith("mission.items[1]: the complex item 'survey'")
    assert {answer.status_code for answer in strangers} == {404}
    assert unheard.status_code == 404
    assert len(kept["items"]) == 3


async def test_a_save_that_rests_on_an_older_plan_is_refused(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running, running.stream() as stream:
        client = running.client
        first = await client.put(PLAN, content=WAYPOINTS, headers={"If-None-Match": "*"})
        said = await next_of(stream, "plan")
        tag = {"If-Match": first.headers["etag"]}
        twice = await client.put(PLAN, content=WAYPOINTS, headers={"If-None-Match": "*"})
        mine = await client.put(PLAN, content=json.dumps(plan_document()), headers=tag)
        stale = [
            await client.put(PLAN, content=WAYPOINTS, headers=tag), await client.delete(PLAN, headers=tag),
        ]  # fmt: skip
        shown, file = await client.get(PLAN), await client.get(f"{PLAN}?format=plan")
        several = {"If-Match": f'"other", {mine.headers["etag"]}'}
        same = await client.put(PLAN, content=json.dumps(plan_document()), headers=several)
        gone = await client.delete(PLAN, headers={"If-Match": mine.headers["etag"]})
        nothing = await client.put(PLAN, content=WAYPOINTS, headers={"If-Match": "*"})
        senseless = [
            await client.put(PLAN, content=WAYPOINTS, headers=headers)
            for headers in ({"If-Match": "3"}, {"If-None-Match": '"a"'}, {"If-Match": '"a"', "If-None-Match": "*"})
        ]

    assert f'"{said["etag"]}"' == first.headers["etag"] != mine.headers["etag"]
    assert twice.status_code == 412
    assert [answer.status_code for answer in stale] == [412, 412]
    assert stale[0].json()["type"] == "/problems#PlanChanged"
    assert mine.headers["etag"].strip('"') in stale[0].json()["detail"]
    assert shown.headers["etag"] == file.headers["etag"] == mine.headers["etag"] == same.headers["etag"]
    assert json.loads(file.content) == plan_document()
    assert (gone.status_code, nothing.status_code) == (204, 412)
    assert "none is kept" in nothing.json()["detail"]
    assert {answer.status_code for answer in senseless} == {400}


async def test_the_path_of_the_kept_plan_is_shown_with_its_etag(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        client = running.client
        nothing = await client.get(f"{PLAN}/path")
        put = await client.put(PLAN, content=json.dumps(plan_document()))
        shown = (await client.get(f"{PLAN}/path")).json()
        stranger = await client.get("/api/v1/vehicles/x/plan/path")

    assert (nothing.status_code, nothing.json()["geometry"], nothing.json()["properties"]["etag"]) == (200, None, None)
    assert (shown["type"], shown["geometry"]["type"]) == ("Feature", "LineString")
    assert f'"{shown["properties"]["etag"]}"' == put.headers["etag"]
    assert shown["properties"]["time_s"][-1] == pytest.approx(shown["properties"]["duration_s"], abs=0.01)
    assert stranger.status_code == 404


async def test_the_vehicles_mission_is_compared_and_neither_is_changed(tmp_path: Path) -> None:
    async with connected(tmp_path) as (running, vehicle, stream):
        client = running.client
        await client.put(PLAN, content=json.dumps(without_fence()))
        empty = await end_of(stream, await client.post(f"{PLAN}/compare"))
        await end_of(stream, await client.post(f"{PLAN}/upload"))
        same = await end_of(stream, await client.post(f"{PLAN}/compare"))
        vehicle.store.items[2].z = 5.0
        other = await end_of(stream, await client.post(f"{PLAN}/compare"))
        kept = await client.get(f"{PLAN}?format=plan")
        await client.put(PLAN, content=json.dumps(plan_document()))
        fenced = await end_of(stream, await client.post(f"{PLAN}/compare"))

    assert (empty["status"], empty["same"]) == ("accepted", False)
    assert "0 items instead of 5" in empty["text"]
    assert (same["command"], same["status"], same["same"]) == ("plan_compare", "accepted", True)
    assert (other["same"], "parameter 7 of item 2 is 5 instead of 50" in other["text"]) == (False, True)
    assert json.loads(kept.content) == without_fence()
    assert (fenced["same"], "fence: the vehicle supports none" in fenced["text"]) == (False, True)


async def test_up_and_down_again(tmp_path: Path) -> None:
    async with connected(tmp_path) as (running, vehicle, stream):
        client = running.client
        await client.put(PLAN, content=json.dumps(without_fence()))
        sent = await end_of(stream, await client.post(f"{PLAN}/upload"))
        on_vehicle = list(vehicle.store.items)
        refused = await client.post(f"{PLAN}/download")
        fetched = await end_of(stream, await client.post(f"{PLAN}/download", json={"replace": True}))
        back = (await client.get(PLAN)).json()
        cleared = await end_of(stream, await client.delete(f"{PLAN}/vehicle"))

    assert (sent["command"], sent["status"], sent["vehicle_id"]) == ("plan_upload", "accepted", "1")
    assert "read back and compared: mission of 5 items" in sent["text"]
    # home in front, as ArduPilot counts
    assert [(m.command, m.frame) for m in on_vehicle] == [(16, 0), (22, 3), (16, 3), (16, 3), (177, 2), (20, 2)]
    assert (on_vehicle[0].x, on_vehicle[2].x) == (473977400, 473981000)
    assert (refused.status_code, "replace" in refused.json()["detail"]) == (409, True)
    assert fetched["status"] == "accepted"
    assert "supports no fence" in fetched["text"]
    assert [item["command"] for item in back["items"]] == [22, 16, 16, 177, 20]
    assert back["home"] == {"lat_deg": 47.39774, "lon_deg": 8.545594, "alt_amsl_m": 488.0}
    assert back["items"][1]["lat_deg"] == 47.3981
    assert cleared["status"] == "accepted"
    assert vehicle.store.items == []


async def test_a_fence_that_the_vehicle_does_not_support_is_told_after_the_mission_arrived(tmp_path: Path) -> None:
    async with connected(tmp_path) as (running, vehicle, stream):
        await running.client.put(PLAN, content=json.dumps(plan_document()))
        end = await end_of(stream, await running.client.post(f"{PLAN}/upload"))
        only = await end_of(stream, await running.client.post(f"{PLAN}/upload", json={"parts": ["mission"]}))

    assert (end["status"], "on the vehicle already: mission of 5" in end["text"]) == ("unsupported", True)
    assert only["status"] == "accepted"
    assert len(vehicle.store.items) == 6


async def test_a_vehicle_that_stores_something_else_is_found_out(tmp_path: Path) -> None:
    def lower(message: Any) -> bool:
        if message.get_type() == "MISSION_REQUEST_LIST":
            vehicle.store.items[2].z = 5.0
        return False

    async with connected(tmp_path) as (running, vehicle, stream):
        vehicle.swallows = lower
        await running.client.put(PLAN, content=json.dumps(without_fence()))
        end = await end_of(stream, await running.client.post(f"{PLAN}/upload"))

    assert end["status"] == "failed"
    assert "parameter 7 of item 2 is 5 instead of 50" in end["text"]


async def test_one_operation_at_a_time_and_silence_ends_it(tmp_path: Path) -> None:
    async with connected(tmp_path) as (running, vehicle, stream):
        vehicle.swallows = lambda _m: True
        client = running.client
        await client.put(PLAN, content=WAYPOINTS)
        first = await client.post(f"{PLAN}/upload")
        second = await client.post(f"{PLAN}/upload")
        end = await end_of(stream, first)
        vehicle.swallows = lambda _m: False
        third = await end_of(stream, await client.post(f"{PLAN}/upload"))

    assert (second.status_code, "plan_upload" in second.json()["detail"]) == (409, True)
    assert (end["status"], "no answer" in end["text"]) == ("timeout", True)
    assert third["status"] == "accepted"


async def test_a_plan_put_during_a_download_is_not_overwritten(tmp_path: Path) -> None:
    async with connected(tmp_path) as (running, _, stream):
        begun = await running.client.post(f"{PLAN}/download")
        await running.client.put(PLAN, content=WAYPOINTS)
        end = await end_of(stream, begun)
        kept = (await running.client.get(PLAN)).json()

    assert (end["status"], "changed meanwhile" in end["text"]) == ("failed", True)
    assert len(kept["items"]) == 3


@pytest.mark.parametrize(
    ("path", "body"),
    [("upload", {"parts": []}), ("upload", {"parts": ["moon"]}), ("download", {"replace": "maybe"}),
     ("upload", {"x": 1})],
)  # fmt: skip
async def test_requests_that_make_no_sense(tmp_path: Path, path: str, body: Any) -> None:
    async with running_station(tmp_path) as running:
        assert (await running.client.post(f"{PLAN}/{path}", json=body)).status_code == 422


async def test_an_empty_plan_and_a_silent_vehicle_are_refused(tmp_path: Path) -> None:
    empty = {"fileType": "Plan", "version": 1, "mission": {"version": 2, "items": []}}
    async with connected(tmp_path) as (running, _, stream):
        await running.client.put(PLAN, content=json.dumps(empty))
        refused = await running.client.post(f"{PLAN}/upload")
        named = await end_of(stream, await running.client.post(f"{PLAN}/upload", json={"parts": ["mission"]}))
        running.station.fleet.vehicles["1"].connected = False
        silent = await running.client.delete(f"{PLAN}/vehicle")
    assert (refused.status_code, silent.status_code, named["status"]) == (400, 409, "accepted")
