"""One station wired together: what it refuses, what it lets go of when it cannot start, what outlives it."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rasterio.transform import from_origin

from backend.demo import free_udp_ports
from backend.errors import (
    CommandRefusedError,
    ConflictError,
    InvalidRequestError,
    StartError,
    UnknownSourceError,
    UnknownVehicleError,
)
from backend.schemas.geometry import NewTarget
from backend.schemas.vehicles import CommandBody
from backend.settings import load_settings
from backend.station import Station
from backend.store.lock import DataDirLock
from backend.store.targets import TargetChange
from geodata.flight import FlightFolder
from geodata.raster import write_geotiff
from tests.backend.aircraft import flying
from tests.backend.flight_maker import CAMERA, LAT_DEG, LON_DEG, write_flight
from tests.backend.station_runner import PATIENCE_S, next_of, running_station


def settings(data_dir: Path, **options: Any) -> Any:
    return load_settings(data_dir=data_dir, **{"mavlink": (), "video": "none", **options})


def test_what_is_not_running_has_no_targets(tmp_path: Path) -> None:
    with pytest.raises(ConflictError, match="not running"):
        _ = Station(settings(tmp_path)).targets


@pytest.mark.parametrize("trouble", ["camera", "map", "port", "video", "database"])
async def test_a_start_that_fails_leaves_nothing_behind(tmp_path: Path, trouble: str) -> None:
    """
    Fault: one of the things that the operator asked for cannot be had.
    Expected: it is named; folder, ports and files are free for the next start, which succeeds without it.
    """
    data, options = tmp_path / "data", {}
    (mavlink_port,) = free_udp_ports(1)
    good = {"mavlink": (f"udpin:127.0.0.1:{mavlink_port}",)}
    match trouble:
        case "camera":
            (tmp_path / "cam.json").write_text("{}")
            options = {"camera": tmp_path / "cam.json"}
        case "map":
            options = {"map": "no-such-map"}
        case "port":
            options = {"mavlink": (*good["mavlink"], "serial:/dev/null:x")}
        case "video":
            options = {"video": "http://camera"}
        case "database":
            data.mkdir()
            (data / "station.db").write_bytes(b"this is a letter" * 500)
    station = Station(settings(data, **{**good, **options}))
    with pytest.raises(StartError) as refused:
        await station.start()
    if trouble == "database":
        (data / "station.db").unlink()

    assert not station.running
    assert str(refused.value)
    lock = DataDirLock(data)
    lock.acquire()
    lock.release()
    again = Station(settings(data, **good))
    await again.start()
    assert again.running
    await again.stop()


async def test_a_second_station_leaves_the_first_ones_folder_alone(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        second = Station(settings(tmp_path))
        with pytest.raises(StartError, match="in use by another station"):
            await second.start()
        made = await running.client.post("/api/v1/targets", json={"lat_deg": 47.0, "lon_deg": 8.0})

    assert made.status_code == 201


async def test_stopping_twice_is_no_trouble(tmp_path: Path) -> None:
    station = Station(settings(tmp_path))
    await station.start()
    await station.stop()
    await station.stop()

    assert not station.running


async def test_targets_and_their_numbers_outlive_the_station(tmp_path: Path) -> None:
    body = NewTarget(lat_deg=47.0, lon_deg=8.0)
    first = Station(settings(tmp_path))
    await first.start()
    one = await first.create_target(body)
    two = await first.create_target(NewTarget(lat_deg=47.1, lon_deg=8.0, name="bridge"))
    renamed = await first.change_target(one.id, TargetChange(name="mast"), one.version)
    await first.stop()
    second = Station(settings(tmp_path))
    await second.start()
    kept = second.targets.all()
    three = await second.create_target(body)
    await second.delete_target(two.id, None)
    left = {target.id for target in second.targets.all()}
    await second.stop()

    assert (one.name, two.name, three.name) == ("Target 1", "bridge", "Target 3")
    assert kept == [renamed, two]
    assert left == {one.id, three.id}


async def test_what_nobody_has_heard_of_is_named(tmp_path: Path) -> None:
    station = Station(settings(tmp_path))
    await station.start()
    try:
        for call in (
            lambda: station.vehicle("7"),
            lambda: station.live_vehicle("7"),
            lambda: station.deny_gps("7", True),
            lambda: station.command("7", CommandBody(command="arm")),
        ):
            with pytest.raises(UnknownVehicleError, match="'7'"):
                call()
        with pytest.raises(UnknownSourceError, match="cam-7"):
            station.feed("cam-7")
        for body, error in (
            (NewTarget(frame_id=1, u_px=1.0, v_px=1.0), ConflictError),
            (NewTarget(vehicle_id="7", u_px=1.0, v_px=1.0), InvalidRequestError),
            (NewTarget(vehicle_id="7", frame_id=1, u_px=1.0, v_px=1.0), UnknownVehicleError),
            (NewTarget(), InvalidRequestError),
        ):
            with pytest.raises(error):
                await station.create_target(body)
        assert station.targets.all() == []
    finally:
        await station.stop()


async def test_what_happened_cannot_be_commanded(tmp_path: Path) -> None:
    write_flight(tmp_path / "flights" / "alpha")
    station = Station(settings(tmp_path))
    await station.start()
    try:
        await station.start_replay("alpha", 1.0, 0.0)
        assert [vehicle.id for vehicle in station.vehicles()] == ["replay-alpha"]
        assert station.feed("cam-replay-alpha").vehicle_id == "replay-alpha"
        for call in (
            lambda: station.deny_gps("replay-alpha", True),
            lambda: station.command("replay-alpha", CommandBody(command="arm")),
        ):
            with pytest.raises(CommandRefusedError, match="is a replay"):
                call()
    finally:
        await station.stop()


async def test_denying_gps_is_told_once_and_recorded(tmp_path: Path) -> None:
    async with flying(tmp_path) as (running, _, stream):
        await next_of(stream, "state")
        await running.client.post("/api/v1/recording", json={"active": True})
        for denied in (True, True, False, True, False):
            running.station.deny_gps("1", denied)
            await next_of(stream, "telemetry")
        await running.client.post("/api/v1/recording", json={"active": False})
        (folder,) = (tmp_path / "data" / "flights").iterdir()
        told = running.station.vehicle("1").summary()["gps_denied"]
    spans = FlightFolder.open(folder).meta.gps_denied

    assert told is False
    assert len(spans) == 2
    assert all(start < end for start, end in spans)


async def test_a_map_that_cannot_be_read_is_waited_for_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """
    Fault: the reference image that covers the place is damaged on the disk after it was imported.
    Expected: the station says so and goes on receiving.
    """
    image = np.random.default_rng(1).integers(0, 255, (200, 200, 3), dtype=np.uint8)
    reference = tmp_path / "reference.tif"
    write_geotiff(reference, image, from_origin(LON_DEG - 0.005, LAT_DEG + 0.005, 5e-5, 5e-5), "EPSG:4326")
    async with running_station(tmp_path / "data") as running:
        record = await running.station.maps.import_file(reference, "here", "imagery")
    for path in (tmp_path / "data" / "maps").rglob("*.tif"):
        path.write_bytes(path.read_bytes()[:2000])
    async with flying(tmp_path) as (running, _, stream):
        async with asyncio.timeout(PATIENCE_S):
            while not any("a usable map" in wait for wait in running.station.waiting_for()):
                await next_of(stream, "gps")
        gps = await next_of(stream, "gps")

    assert record.name == "here"
    assert gps["fix_type"] == 3


async def test_the_recordings_plan_says_what_is_known(tmp_path: Path) -> None:
    """What a replay needs: camera, home, vehicle, and whether the video's clock is still to be found."""
    async with flying(tmp_path) as (running, _, stream):
        await next_of(stream, "state")
        await running.client.post("/api/v1/recording", json={"active": True, "name": "known"})
        await next_of(stream, "recording")
        async with asyncio.timeout(PATIENCE_S):
            while running.station.recorder.status.bytes < 30_000:
                await next_of(stream, "telemetry")
        await running.client.post("/api/v1/recording", json={"active": False})
        (folder,) = (tmp_path / "data" / "flights").iterdir()
    meta = FlightFolder.open(folder).meta

    assert meta.name == "known"
    assert meta.camera == CAMERA
    assert (meta.vehicle.system_id, meta.vehicle.type) == (1, "helicopter")
    assert meta.home is not None
    assert np.allclose([meta.home.lat_deg, meta.home.lon_deg, meta.home.alt_amsl_m], [LAT_DEG, LON_DEG, 400.0])
    assert meta.map.ground_alt_amsl_m == 400.0
    # the aircraft stamps its pictures
    assert meta.video.time_offset_s == 0.0
    assert json.loads((folder / "flight.json").read_text())["schema"] == "pilotage.flight/1"
