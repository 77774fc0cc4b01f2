"""Evidence through the service: what is kept with a click, who gets it, and what proves nothing."""

import hashlib
import json
import sqlite3
from pathlib import Path

import typer
from typer.testing import CliRunner, Result

from backend.evidence.bundle import unpack
from backend.evidence.cli import register
from geodata.maps import MapLibrary
from tests.backend.aircraft import flying, frame_header
from tests.backend.evidence.flown import STRIDE, VEHICLE, click, click_body, evidence_zip, hills, hilly_station
from tests.backend.flight_maker import T0_US
from tests.backend.station_runner import next_of


def run_verify(*arguments: object) -> Result:
    app = typer.Typer()
    register(app)
    app.command("other")(lambda: None)  # one command alone would lose its name
    return CliRunner().invoke(app, ["verify", *(str(a) for a in arguments)])


async def test_a_click_is_proven_by_what_is_kept_with_it(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        target = await click(running)
        answer = await evidence_zip(running, target["id"])
        alone = await running.client.get(
            f"/api/v1/targets/{target['id']}/evidence", headers={"Accept": "application/json"}
        )
        shown = await running.client.get(f"/api/v1/video/cam-{VEHICLE}/frames/{STRIDE + 30}.jpg")
    (tmp_path / "target.zip").write_bytes(answer.content)
    (tmp_path / "target.json").write_bytes(alone.content)
    other = hills(tmp_path / "other.tif", seed_m=1.0)

    whole = run_verify(tmp_path / "target.zip", "--map", tmp_path / "dtm.tif")
    document = run_verify(tmp_path / "target.json")
    wrong_map = run_verify(tmp_path / "target.zip", "--map", other)

    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/zip")
    assert alone.headers["content-type"] == "application/json"
    bundle = unpack(answer.content, "answer")
    assert bundle.document == alone.content
    assert bundle.picture == shown.content
    evidence, properties = bundle.evidence, target["properties"]
    assert (evidence.result.lat_deg, evidence.result.lon_deg) == (properties["lat_deg"], properties["lon_deg"])
    assert evidence.frame.t_unix_us == T0_US + 30 * 40_000
    assert (evidence.frame.frame_id, evidence.click.u_px) == (STRIDE + 30, 100.25)
    (elevation,) = evidence.files
    assert elevation.sha256 == hashlib.sha256((tmp_path / "dtm.tif").read_bytes()).hexdigest()
    assert evidence.result.ray_method == "ray_terrain"
    assert len(answer.content) < 100_000
    assert (whole.exit_code, document.exit_code, wrong_map.exit_code) == (0, 0, 1), whole.output
    assert "distance   0.000000 m" in whole.output
    assert "picture    as it was" in whole.output
    assert "the elevation in use" in whole.output
    assert whole.output.endswith("  agrees\n")
    assert "not checked" in document.output
    assert "none of the files in use" in wrong_map.output
    assert wrong_map.output.endswith("  does not agree\n")


async def test_what_is_gone_or_changed_since_is_said_in_the_bundle(tmp_path: Path) -> None:
    """
    Fault: the recording's video is taken away, and its elevation file replaced, while it is replayed.
    Expected: the click is located as before; its evidence says that there is no picture, and no hash of the file.
    """
    async with hilly_station(tmp_path) as running:
        flight = tmp_path / "flights" / "hills"
        (flight / "video.ts").rename(tmp_path / "away.ts")
        (flight / "elevation.tif").unlink()
        hills(flight / "elevation.tif", seed_m=3.0)
        target = await click(running)
        answer = await evidence_zip(running, target["id"])
    (tmp_path / "target.zip").write_bytes(answer.content)

    verified = run_verify(tmp_path / "target.zip")
    with_map = run_verify(tmp_path / "target.zip", "--map", flight / "elevation.tif")

    bundle = unpack(answer.content, "answer")
    assert (bundle.picture, bundle.evidence.picture.sha256) == (None, None)
    assert bundle.evidence.files[0].sha256 is None
    assert "changed since the station read it" in (bundle.evidence.files[0].problem or "")
    assert (verified.exit_code, with_map.exit_code) == (0, 1), verified.output
    assert "picture    none: the picture was no longer held" in verified.output
    assert "changed since the station read it" in with_map.output


async def test_a_live_click_is_proven_with_the_librarys_map(tmp_path: Path) -> None:
    MapLibrary(tmp_path / "data" / "maps").import_file(hills(tmp_path / "dtm.tif"))
    async with flying(tmp_path) as (running, _, stream):
        async with running.video("cam-1") as pictures:
            frame = await frame_header(pictures)
            while (await next_of(stream, "state"))["t_state_unix_us"] < frame["t_unix_us"] + 500_000:
                pass
        click = {"vehicle_id": "1", "frame_id": frame["frame_id"], "u_px": 160, "v_px": 120}
        for _ in range(40):  # until the estimator covers a picture that the ring holds
            made = await running.client.post("/api/v1/targets", json=click)
            if made.status_code == 201:
                break
            async with running.video("cam-1") as pictures:
                click["frame_id"] = (await frame_header(pictures))["frame_id"]
            await next_of(stream, "state")
        assert made.status_code == 201, made.text
        answer = await evidence_zip(running, made.json()["id"])
        shown = await running.client.get(f"/api/v1/video/cam-1/frames/{click['frame_id']}.jpg")
    (tmp_path / "live.zip").write_bytes(answer.content)

    evidence = unpack(answer.content, "live").evidence
    verified = run_verify(tmp_path / "live.zip", "--map", tmp_path / "dtm.tif")
    assert verified.exit_code == 0, verified.output
    assert "imported from, 'dtm.tif'" in verified.output
    assert evidence.result.ray_method == "ray_terrain"
    (elevation,) = evidence.files
    copy = tmp_path / "data" / "maps" / (elevation.map_id or "") / elevation.file
    assert elevation.sha256 == hashlib.sha256(copy.read_bytes()).hexdigest()
    assert unpack(answer.content, "live").picture == shown.content
    assert evidence.calibration is not None
    assert evidence.state.process_model == "attitude"


async def test_typed_in_moved_and_deleted_targets_have_no_evidence(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        client = running.client
        typed = (await client.post("/api/v1/targets", json={"lat_deg": 47.0, "lon_deg": 8.0})).json()
        of_typed = await evidence_zip(running, typed["id"])
        target = await click(running)
        before = await evidence_zip(running, target["id"])
        address = f"/api/v1/targets/{target['id']}"
        await client.patch(address, json={"name": "Renamed"})
        renamed = await evidence_zip(running, target["id"])
        await client.patch(address, json={"alt_amsl_m": 500.0})
        raised = await evidence_zip(running, target["id"])
        await client.patch(address, json={"lat_deg": 47.0, "lon_deg": 8.0})
        moved = await evidence_zip(running, target["id"])
        old = await evidence_zip(running, target["id"], "?version=1")
        never = await evidence_zip(running, target["id"], "?version=3")
        stale = await client.delete(address, headers={"If-Match": '"1"'})
        still = await evidence_zip(running, target["id"], "?version=1")
        await client.delete(address)
        deleted = await evidence_zip(running, target["id"])
        left = list((tmp_path / "evidence").iterdir())

    assert (of_typed.status_code, raised.status_code, moved.status_code, never.status_code) == (404,) * 4
    assert of_typed.headers["content-type"] == "application/problem+json"
    assert "typed in" in of_typed.json()["detail"]
    assert "moved by hand after version 1 (it has version 4 now)" in moved.json()["detail"]
    assert "?version=1" in moved.json()["detail"]
    assert "of version 1 only" in never.json()["detail"]
    assert renamed.content == before.content
    assert old.headers["pilotage-evidence"] == "superseded"
    assert unpack(old.content, "old").document == unpack(before.content, "before").document
    (tmp_path / "old.zip").write_bytes(old.content)
    verified = run_verify(tmp_path / "old.zip")
    assert verified.exit_code == 0
    assert "note of the station: it was moved by hand" in verified.output
    assert (stale.status_code, still.status_code, deleted.status_code) == (412, 200, 404)
    assert left == []


async def test_evidence_outlives_a_restart_and_an_older_databases_targets_have_none(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        first, second = await click(running), await click(running, frame=40)
        before = await evidence_zip(running, first["id"])
    (tmp_path / "evidence" / f"{second['id']}.zip").unlink()  # as if located before evidence was kept
    async with hilly_station(tmp_path) as running:
        after = await evidence_zip(running, first["id"])
        none = await evidence_zip(running, second["id"])
        listed = (await running.client.get("/api/v1/targets")).json()
        (tmp_path / "evidence" / f"{first['id']}.zip").write_bytes(before.content[:500])
        cut = await evidence_zip(running, first["id"])

    assert after.content == before.content
    assert none.status_code == 404
    assert "older version" in none.json()["detail"]
    assert len(listed["features"]) == 2
    assert cut.status_code == 500
    assert "was altered" in cut.json()["detail"]


async def test_a_database_that_fails_keeps_neither_target_nor_evidence(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        with sqlite3.connect(tmp_path / "station.db") as database:
            database.execute("ALTER TABLE targets RENAME TO away")
        refused = await running.client.post("/api/v1/targets", json=click_body())
        listed = (await running.client.get("/api/v1/targets")).json()
        with sqlite3.connect(tmp_path / "station.db") as database:
            database.execute("ALTER TABLE away RENAME TO targets")
        left = list((tmp_path / "evidence").iterdir())
        await click(running)

    assert refused.status_code == 507
    assert json.loads(refused.text)["type"] == "/problems#TargetNotKept"
    assert listed["features"] == []
    assert left == []
