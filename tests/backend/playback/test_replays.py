"""Flights replayed in the browser: pace, jumps, frames, clicks, broken folders."""

import asyncio
import json
import math
import shutil
import struct
from pathlib import Path
from typing import Any

import httpx
import pytest
from numpy.testing import assert_allclose

from backend.flights import FlightShelf
from backend.playback.replays import _cache_key
from backend.schemas.history import HistoryBody
from tests.backend.flight_maker import LAT_DEG, LON_DEG, T0_US, write_flight, write_recording_with_faulty_video
from tests.backend.station_runner import PATIENCE_S, RunningStation, next_of, running_station

FLIGHT = "/api/v1/flights/alpha/replay"
REPLAY = "/api/v1/replays/replay-alpha"


async def until(running: RunningStation, condition: Any, path: str = "/api/v1/replays") -> Any:
    """Wait on the stream until what a GET answers fulfils a condition."""
    async with running.stream() as socket, asyncio.timeout(PATIENCE_S):
        while True:
            answer = (await running.client.get(path)).json()
            if condition(answer):
                return answer
            await socket.recv()


def header_of(packet: bytes) -> dict[str, Any]:
    (length,) = struct.unpack(">I", packet[:4])
    return dict(json.loads(packet[4 : 4 + length]))


async def test_a_flight_plays_to_its_end_with_video_tracks_and_state(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha")
    async with running_station(tmp_path) as running:
        started = await running.client.post(FLIGHT, json={"speed": 4.0})
        async with running.video("cam-replay-alpha") as video:
            headers = [header_of(await asyncio.wait_for(video.recv(), PATIENCE_S))]
            while headers[-1]["t_unix_us"] < T0_US + 98 * 40_000:
                headers.append(header_of(await asyncio.wait_for(video.recv(), PATIENCE_S)))
        (ended,) = await until(running, lambda replays: replays[0]["ended"])
        tracks = (await running.client.get("/api/v1/vehicles/replay-alpha/tracks")).json()
        state = (await running.client.get("/api/v1/vehicles/replay-alpha/state")).json()
        vehicles = (await running.client.get("/api/v1/vehicles")).json()

    assert started.status_code == 201
    assert headers[0]["key"]
    times = [header["t_unix_us"] for header in headers]
    assert times == sorted(times)
    assert {(t - T0_US) % 40_000 for t in times} == {0}
    assert len({header["frame_id"] for header in headers}) == len(headers)
    assert ended["t_unix_us"] == ended["end_unix_us"]
    by_source = {feature["properties"]["source"]: feature for feature in tracks["features"]}
    assert set(by_source) == {"gps", "vision"}
    assert_allclose(by_source["vision"]["geometry"]["coordinates"][0][:2], [LON_DEG, LAT_DEG], atol=1e-9)
    assert state["mode"] == "gps"
    assert vehicles[0]["replay"]


async def test_a_jump_begins_a_new_epoch_at_the_wanted_time(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha", seconds=8.0)
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 1.0})
        await running.client.patch(REPLAY, json={"paused": True})
        await until(running, lambda replays: replays[0]["progress"] is None)
        async with running.video("cam-replay-alpha") as video:
            goal_us = T0_US + 6_200_000
            answer = await running.client.patch(REPLAY, json={"seek_unix_us": goal_us})
            headers: list[dict[str, Any]] = []
            while not headers or headers[-1]["epoch"] < 2 or headers[-1]["t_unix_us"] < goal_us:
                headers.append(header_of(await asyncio.wait_for(video.recv(), PATIENCE_S)))
        tracks = (await running.client.get("/api/v1/vehicles/replay-alpha/tracks?source=vision")).json()
        state = (await running.client.get("/api/v1/vehicles/replay-alpha/state")).json()

    assert (answer.json()["t_unix_us"], answer.json()["paused"]) == (goal_us, True)
    after = [header for header in headers if header["epoch"] == 2]
    assert after[0]["key"]
    assert after[0]["t_unix_us"] <= goal_us
    assert after[-1]["t_unix_us"] == goal_us
    (piece,) = tracks["features"]
    assert piece["properties"]["epoch"] == 2
    assert max(piece["properties"]["times_unix_us"]) <= goal_us
    assert piece["properties"]["times_unix_us"][0] < T0_US + 300_000
    assert (state["epoch"], state["t_state_unix_us"]) == (2, goal_us)


async def test_a_click_on_a_replayed_frame_uses_the_state_at_its_exposure(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha")
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 16.0})
        await until(running, lambda replays: replays[0]["ended"] and replays[0]["progress"] is None)
        stride = 100
        frame_id = stride + 50  # epoch 1, picture 50: exposed two seconds after the start, 10 m north of it
        body = {"vehicle_id": "replay-alpha", "frame_id": frame_id, "u_px": 159.5, "v_px": 119.5, "name": "below"}
        made = await running.client.post("/api/v1/targets", json=body)
        picture = await running.client.get(f"/api/v1/video/cam-replay-alpha/frames/{frame_id}.jpg")
        unknown = await running.client.post("/api/v1/targets", json={**body, "frame_id": 99})
        outside = await running.client.post("/api/v1/targets", json={**body, "u_px": 999})

    target = made.json()["properties"]
    assert made.status_code == 201, made.text
    assert_allclose(target["lat_deg"], LAT_DEG + math.degrees(10.0 / 6.368e6), atol=2e-7)
    assert_allclose(target["lon_deg"], LON_DEG, atol=2e-7)
    assert_allclose(target["alt_amsl_m"], 400.0, atol=0.1)
    assert target["t_unix_us"] == T0_US + 2_000_000
    # flight_maker.state(): sigmas of 1 and 2 m and of 1 rad in attitude, which 100 m above ground makes 100 m
    assert target["method"] == "ray_terrain"
    assert 100.0 < target["std_n_m"] < 101.0
    assert picture.content.startswith(b"\xff\xd8")
    assert unknown.status_code == 404
    assert outside.status_code == 400


async def test_video_that_changes_size_freezes_and_stops_plays_to_the_end(tmp_path: Path) -> None:
    """
    Fault: the recorded video doubles its size, takes another shape, freezes and ends before the telemetry does.
    Expected: every picture is shown under its own size, clicks use that size, and where the shape contradicts the
    camera they say so; the replay goes on to the end of the telemetry, and other requests are served.
    """
    write_recording_with_faulty_video(tmp_path / "flights" / "alpha")
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 0.1})
        sizes: dict[int, tuple[int, int]] = {}
        async with running.video("cam-replay-alpha") as video:
            await running.client.patch(REPLAY, json={"speed": 16.0})
            while max(sizes, default=0) < 250 + 249:
                header = header_of(await asyncio.wait_for(video.recv(), PATIENCE_S))
                sizes[header["frame_id"]] = (header["width"], header["height"])
        (replay,) = await until(running, lambda replays: replays[0]["ended"] and replays[0]["progress"] is None)
        answers = [
            await running.client.post(
                "/api/v1/targets", json={"vehicle_id": "replay-alpha", "frame_id": 250 + n, "u_px": u, "v_px": v}
            )
            for n, u, v in ((90, 319.5, 239.5), (190, 159.5, 119.5), (140, 100.0, 100.0))
        ]

    assert [sizes[250 + n] for n in (0, 60, 110, 160, 240)] == [
        (320, 240),
        (640, 480),
        (352, 288),
        (320, 240),
        (320, 240),
    ]
    assert replay["t_unix_us"] > T0_US + 13_000_000
    assert [answer.status_code for answer in answers] == [201, 201, 409], [answer.text for answer in answers]
    centre = [answer.json()["properties"] for answer in answers[:2]]
    for about in centre:  # the middle of the picture is below the aircraft, 5 m/s north of its start
        north_m = math.radians(about["lat_deg"] - LAT_DEG) * 6.368e6
        assert abs(north_m - 5.0 * (about["t_unix_us"] - T0_US) / 1e6) < 3.0
    assert "352 x 288" in answers[2].json()["detail"]


async def test_a_click_with_an_estimate_of_others_says_what_it_assumes(tmp_path: Path) -> None:
    """An estimate.csv of the contract's columns alone: nobody knows how good its attitude is."""
    folder = tmp_path / "flights" / "alpha"
    write_flight(folder)
    lines = [line.split(",") for line in (folder / "estimate.csv").read_text().splitlines()]
    (folder / "estimate.csv").write_text("".join(",".join(cells[:15]) + "\n" for cells in lines))
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 16.0})
        await until(running, lambda replays: replays[0]["ended"] and replays[0]["progress"] is None)
        body = {"vehicle_id": "replay-alpha", "frame_id": 150, "u_px": 159.5, "v_px": 119.5}
        made = await running.client.post("/api/v1/targets", json=body)

    target = made.json()["properties"]
    assert made.status_code == 201, made.text
    assert target["method"] == "ray_terrain, attitude 1 deg assumed"
    # sigma 1 m of the position, 1 deg at 100 m, 2 px at 300 px focal length, and the ground's height straight below
    assert_allclose(target["std_n_m"], math.hypot(1.0, 100 * math.radians(1.0), 100 * 2 / 300), atol=0.05)


async def test_pictures_without_a_time_are_shown_but_cannot_be_clicked(tmp_path: Path) -> None:
    """
    Fault: pictures 10 to 19 of the flight have no time, because it ran backwards there.
    Expected: the browser gets them, since it decodes the next ones from them; a click on one is refused in words.
    """
    folder = tmp_path / "flights" / "alpha"
    write_flight(folder)
    lines = (folder / "frames.csv").read_text().splitlines()
    for n in range(10, 20):
        lines[1 + n] = f"{n},{T0_US - 1_000_000}"
    (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 0.1})
        headers: list[dict[str, Any]] = []
        async with running.video("cam-replay-alpha") as video:
            await running.client.patch(REPLAY, json={"speed": 4.0})
            while not headers or headers[-1]["t_unix_us"] < T0_US + 30 * 40_000:
                headers.append(header_of(await asyncio.wait_for(video.recv(), PATIENCE_S)))
        body = {"vehicle_id": "replay-alpha", "frame_id": 100 + 15, "u_px": 159.5, "v_px": 119.5}
        refused = await running.client.post("/api/v1/targets", json=body)
        picture = await running.client.get("/api/v1/video/cam-replay-alpha/frames/115.jpg")

    numbers = [header["frame_id"] for header in headers]
    assert numbers == list(range(numbers[0], 131))
    assert numbers[0] <= 110
    assert [header["t_unix_us"] for header in headers if 110 <= header["frame_id"] < 120] == [T0_US + 9 * 40_000] * 10
    assert refused.status_code == 409
    assert "does not say when it was taken" in refused.json()["detail"]
    assert picture.content.startswith(b"\xff\xd8")


async def test_a_flight_without_estimate_has_one_computed_and_kept(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha", with_estimate=False)
    (tmp_path / "flights" / "alpha" / "estimate.csv").unlink()
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 16.0})
        await until(running, lambda replays: replays[0]["progress"] is None)
        vehicle = (await running.client.get("/api/v1/vehicles/replay-alpha")).json()

    # This flight has no barometer and no inertial sensors: whether an estimate comes of it is the estimator's affair.
    computed = list((tmp_path / "cache" / "estimates").glob("alpha-*/estimate.csv"))
    assert computed or vehicle["estimate_problem"]


async def test_jpeg_viewers_see_frames_with_the_same_identity(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha")
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 0.5})
        async with running.video("cam-replay-alpha?codec=jpeg") as video:
            packets = [await asyncio.wait_for(video.recv(), PATIENCE_S) for _ in range(3)]

    for packet in packets:
        header = header_of(packet)
        assert header["codec"] == "jpeg"
        assert header["t_unix_us"] == T0_US + (header["frame_id"] - 100) * 40_000
        assert packet.endswith(b"\xff\xd9")


async def test_changes_that_make_no_sense_are_refused(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha")
    async with running_station(tmp_path) as running:
        client: httpx.AsyncClient = running.client
        await client.post(FLIGHT, json={"speed": 1})
        answers = [
            await client.patch(REPLAY, json={"speed": 17}),
            await client.patch("/api/v1/replays/replay-x", json={"paused": True}),
            await client.post("/api/v1/flights/x/replay", json={}),
            await client.post("/api/v1/vehicles/replay-alpha/navigation", json={"gps_denied": True}),
            await client.delete("/api/v1/flights/alpha"),
            await client.delete(REPLAY),
            await client.delete(REPLAY),
            await client.delete("/api/v1/flights/alpha"),
        ]

    assert [answer.status_code for answer in answers] == [422, 404, 404, 409, 409, 204, 404, 204]


@pytest.mark.parametrize("broken", ["flight.json", "telemetry.tlog"])
async def test_a_broken_folder_is_listed_with_its_problem(tmp_path: Path, broken: str) -> None:
    elsewhere = tmp_path / "elsewhere"
    write_flight(elsewhere / "alpha")
    shutil.copytree(elsewhere / "alpha", elsewhere / "beta")
    (elsewhere / "beta" / broken).unlink()
    async with running_station(tmp_path / "data", flights=(elsewhere,)) as running:
        flights = {flight["id"]: flight for flight in (await running.client.get("/api/v1/flights")).json()}
        refused = await running.client.post("/api/v1/flights/beta/replay", json={})
        kept = await running.client.delete("/api/v1/flights/alpha")

    assert flights["alpha"]["problem"] is None
    assert flights["alpha"]["read_only"]
    assert broken in flights["beta"]["problem"]
    assert refused.status_code == 409
    assert broken in refused.json()["detail"]
    assert kept.status_code == 409


async def test_the_stream_tells_where_a_replay_stands(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha")
    async with running_station(tmp_path) as running, running.stream() as socket:
        await running.client.post(FLIGHT, json={"speed": 2.0})
        told = [await next_of(socket, "replay") for _ in range(3)]
        state = await next_of(socket, "state")
        telemetry = await next_of(socket, "telemetry")

    assert [message["vehicle_id"] for message in told] == ["replay-alpha"] * 3
    assert told[0]["t_unix_us"] < told[2]["t_unix_us"]
    assert state["vehicle_id"] == telemetry["vehicle_id"] == "replay-alpha"
    assert telemetry["vehicle_type"] == "helicopter"


@pytest.mark.parametrize(
    ("report", "offset_us"),
    [
        ('{"video_clock": {"observable": true, "time_offset_s": -0.4}}', -400_000),
        ('{"video_clock": {"observable": false, "time_offset_s": null}}', 0),
        ('{"video_clock": null}', 0),
        ("cut off {", 0),
    ],
)
async def test_a_click_counts_with_the_offset_that_was_found_with_the_estimate(
    tmp_path: Path, report: str, offset_us: int
) -> None:
    """The flight does not say how far its video's clock is off; its estimate was computed before, and is kept."""
    folder = tmp_path / "flights" / "alpha"
    write_flight(folder)
    estimate = (folder / "estimate.csv").read_bytes()
    (folder / "estimate.csv").unlink()
    meta = json.loads((folder / "flight.json").read_text())
    meta["video"]["time_offset_s"] = None
    (folder / "flight.json").write_text(json.dumps(meta))
    kept = tmp_path / "cache" / "estimates" / _cache_key(FlightShelf(tmp_path / "flights", ()).get("alpha"))
    kept.mkdir(parents=True)
    (kept / "estimate.csv").write_bytes(estimate)
    (kept / "report.json").write_text(report)
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 1.0, "start_s": 2.0})
        await until(running, lambda replays: replays[0]["progress"] is None)
        click = {"vehicle_id": "replay-alpha", "frame_id": 100 + 50, "u_px": 159.5, "v_px": 119.5}
        answer = await running.client.post("/api/v1/targets", json=click)

    assert answer.status_code == 201, answer.text
    exposed_us = T0_US + 50 * 40_000 + offset_us
    properties = answer.json()["properties"]
    assert properties["t_unix_us"] == exposed_us
    # straight down, 5 m/s to the north
    north_m = math.radians(properties["lat_deg"] - LAT_DEG) * 6.368e6
    assert north_m == pytest.approx(5.0 * (exposed_us - T0_US) / 1e6, abs=0.05)


async def test_a_replay_tells_the_history_of_the_whole_flight(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha", seconds=8.0)
    header = "time_us,kind,accepted,reason,north_m,east_m,std_n_m,std_e_m,score,elapsed_ms\n"
    lines = f"{T0_US + 1_000_000},match,1,,100.0,0.0,2.0,3.0,0.5,12.5\n"
    lines += f"{T0_US + 2_000_000},match,0,ambiguous,nan,nan,nan,nan,0.1,9\n"
    (tmp_path / "flights" / "alpha" / "fixes.csv").write_text(header + lines + "cut,of")
    async with running_station(tmp_path) as running:
        await running.client.post(FLIGHT, json={"speed": 1.0})
        await running.client.patch(REPLAY, json={"paused": True})
        await until(running, lambda replays: replays[0]["progress"] is None)
        answer = await running.client.get("/api/v1/vehicles/replay-alpha/history")
        state = (await running.client.get("/api/v1/vehicles/replay-alpha/state")).json()

    history = HistoryBody.model_validate(answer.json())
    states, fixes = history.states, history.fixes
    assert states.t_unix_us[-1] - states.t_unix_us[0] > 7_000_000
    assert all(b > a for a, b in zip(states.t_unix_us, states.t_unix_us[1:], strict=False))
    assert len(history.gps.t_unix_us) > 10
    assert_allclose(states.alt_agl_m[0], state["alt_agl_m"], atol=1.0)
    assert_allclose(states.lat_deg[0], LAT_DEG, atol=1e-4)
    assert (fixes.accepted, fixes.reason, fixes.elapsed_ms) == ([True, False], ["", "ambiguous"], [12.5, 9.0])
    assert fixes.lat_deg[1] is None
    assert_allclose((fixes.lat_deg[0] or 0.0) - LAT_DEG, 100.0 / 111_200.0, atol=1e-5)


async def test_a_flight_has_a_report_that_asks_nothing_of_a_network(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha", seconds=4.0)
    async with running_station(tmp_path) as running:
        early = await running.client.get("/api/v1/flights/alpha/report")
        stranger = await running.client.get("/api/v1/flights/beta/report")
        if early.status_code == 409:
            await running.client.post(FLIGHT, json={"speed": 1.0})
            await until(running, lambda replays: replays[0]["progress"] is None)
        page = await running.client.get("/api/v1/flights/alpha/report")

    assert early.status_code in (200, 409)
    assert stranger.status_code == 404
    assert page.status_code == 200
    assert page.headers["content-type"].startswith("text/html")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert "data-name='estimate'" in page.text
    assert "<script" not in page.text
