"""Clicks on a flight that is replayed: registered to its map, and moved by what its later fixes say."""

from __future__ import annotations

import asyncio
import json
import math
import shutil
from pathlib import Path
from typing import Any

import pytest

from backend.evidence.bundle import unpack
from backend.playback.estimate import EstimateTable
from backend.refining import refiner
from backend.replay.offline import replay_flight
from estimator.geometry.local import LocalFrame
from geodata.flight import FlightFolder
from tests.backend.evidence.test_service import run_verify
from tests.backend.replay.cut import cut_flight
from tests.backend.station_runner import PATIENCE_S, RunningStation, running_station

VEHICLE = "replay-cut"
SECONDS, CLICKED_AT = 45.0, (25, 30)  # of pictures, one a second; GPS is denied from the tenth on
PIXEL = (480.0, 330.0)


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refiner, "LOOK_BACK_S", 0.2)
    monkeypatch.setattr(refiner, "QUIET_US", 0)


async def replay(running: RunningStation) -> int:
    """Begin to replay, paused; returns what is added to the numbers of pictures."""
    started = await running.client.post("/api/v1/flights/cut/replay", json={"speed": 1.0})
    assert started.status_code == 201, started.text
    paused = await running.client.patch(f"/api/v1/replays/{VEHICLE}", json={"paused": True})
    assert paused.status_code == 200, paused.text
    for _ in range(round(20 * PATIENCE_S)):  # the flight is estimated by a process that yields to all others
        (body,) = (await running.client.get("/api/v1/replays")).json()
        if body["progress"] is None:
            return round(SECONDS) + 1
        await asyncio.sleep(0.2)
    raise AssertionError("there is no estimate")


async def clicked(running: RunningStation, stride: int) -> list[dict[str, Any]]:
    made = []
    for index in CLICKED_AT:
        body = {"vehicle_id": VEHICLE, "frame_id": stride + index, "u_px": PIXEL[0], "v_px": PIXEL[1]}
        answer = await running.client.post("/api/v1/targets", json=body)
        assert answer.status_code == 201, answer.text
        made.append(answer.json())
    return made


async def became(running: RunningStation, target_id: str, wanted: Any) -> dict[str, Any]:
    properties: dict[str, Any] = {}
    for _ in range(round(20 * PATIENCE_S)):  # the flight is estimated by a process that yields to all others
        properties = (await running.client.get(f"/api/v1/targets/{target_id}")).json()["properties"]
        if wanted(properties):
            return properties
        await asyncio.sleep(0.2)
    raise AssertionError(f"it stayed {properties}")


async def proof(running: RunningStation, target_id: str, path: Path, query: str = "") -> Any:
    answer = await running.client.get(f"/api/v1/targets/{target_id}/evidence{query}")
    assert answer.status_code == 200, answer.text
    path.write_bytes(answer.content)
    return unpack(answer.content, path.name).evidence


def apart_m(a: dict[str, Any], b: dict[str, Any]) -> float:
    local = LocalFrame(math.radians(a["lat_deg"]), math.radians(a["lon_deg"]), 0.0)
    return float(math.hypot(*local.ne_from_geodetic(math.radians(b["lat_deg"]), math.radians(b["lon_deg"]))))


@pytest.mark.parametrize("with_estimate", [False, True])
async def test_clicks_on_a_replay_are_registered_and_moved_by_the_flights_later_fixes(
    tmp_path: Path, with_estimate: bool, flown: Path
) -> None:
    """
    Expected: a click is answered by the replayed state; then it is registered to the map; then the fixes of the rest
    of the flight move it. Each is a version with evidence that is verified, the registration repeated. It is so where
    the station computes the flight's estimate, and where that was recorded.
    """
    shutil.copytree(flown, tmp_path / "flights" / "cut")
    if not with_estimate:
        (tmp_path / "flights" / "cut" / "estimate.csv").unlink()
    (tmp_path / "flights" / "cut" / "smoothed.csv").unlink()
    async with running_station(tmp_path) as running:
        made = await clicked(running, await replay(running))
        ids = [target["id"] for target in made]
        tried = [await became(running, each, lambda p: p["registration"] != "waiting") for each in ids]
        moved = [await became(running, ids[0], lambda p: p["refined"] >= 1 and p["version"] >= 3)]
        evidence = await proof(running, ids[0], tmp_path / "now.zip")
        first = await proof(running, ids[0], tmp_path / "first.zip", "?version=1")
        await asyncio.sleep(1.0)
        later = [(await running.client.get(f"/api/v1/targets/{each}")).json()["properties"] for each in ids]
        await running.client.delete(f"/api/v1/replays/{VEHICLE}")

    assert all(target["properties"]["registration"] == "waiting" for target in made)
    assert all(p["registration"].startswith(("matched by", "no match")) for p in tried)
    assert any(p["method"] == "fused" for p in later), later
    assert evidence.state.corrected_by_later_fixes
    assert not first.state.corrected_by_later_fixes
    assert evidence.target.version == moved[0]["version"]
    assert later[0]["version"] == moved[0]["version"]  # the same fixes move it once
    assert later[0]["ce90_m"] < made[0]["properties"]["ce90_m"]
    assert 0.1 < apart_m(made[0]["properties"], later[0]) < 40.0
    for name in ("now.zip", "first.zip"):
        verified = run_verify(tmp_path / name, "--json", "--map", flown / "reference.tif")
        assert verified.exit_code == 0, verified.output
        outcome = json.loads(verified.stdout)["registration"]["outcome"]
        assert outcome == ("agrees" if name == "now.zip" and evidence.placement else "none")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight with its own estimate, as after a recording."""
    folder = tmp_path_factory.mktemp("flown") / "cut"
    out = tmp_path_factory.mktemp("out")
    replay_flight(cut_flight(folder, "ariel_b", SECONDS), out)
    for name in ("estimate.csv", "smoothed.csv"):
        shutil.copyfile(out / name, folder / name)
    return folder


def test_a_flights_hindsight_is_nearer_to_the_truth_and_surer(flown: Path) -> None:
    truth = FlightFolder.open(flown).truth()
    assert truth is not None
    then, later = EstimateTable.read(flown / "estimate.csv"), EstimateTable.read(flown / "smoothed.csv")
    misses = {"then": 0.0, "later": 0.0}
    stds = {"then": 0.0, "later": 0.0}
    denied = [n for n, t in enumerate(truth.t_unix_us.tolist()) if 10e6 < t - truth.t_unix_us[0] < 40e6]
    for n in denied:
        at = {"lat_deg": math.degrees(truth.lat_rad[n]), "lon_deg": math.degrees(truth.lon_rad[n])}
        for name, table in (("then", then), ("later", later)):
            found = table.at(int(truth.t_unix_us[n]))
            assert found is not None
            values = found[0]
            misses[name] += apart_m(at, {"lat_deg": values[0], "lon_deg": values[1]}) ** 2
            stds[name] += float(values[9] ** 2 + values[10] ** 2)

    assert len(denied) > 20
    assert misses["later"] < 0.8 * misses["then"]
    assert stds["later"] < stds["then"]
