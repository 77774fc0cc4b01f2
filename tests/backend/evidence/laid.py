"""Clicks on pictures of a recorded flight that were registered to its map, from the flight's truth a little off."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from backend.clicks import clicked_target
from backend.evidence.keeper import EvidenceKeeper
from backend.fleet.feed import FrameIdentity
from backend.mapping import StationMaps
from backend.navigation.setup import MapFiles, NavigationSetup, Place, build_setup, profile_of_flight
from backend.refining.places import refine, registered
from backend.schemas.geometry import NewTarget
from backend.video.recorded import RecordedVideo
from estimator.geometry.rotation import q_from_euler, q_from_matrix
from estimator.measurements.camera_attitude import CameraAttitudeModel, Gimbal
from estimator.types import Mode, NavigationState
from geodata.flight import FlightFolder
from geodata.maps import MapLibrary
from tests.shared_data import shared_data

FRAME_INDEX = 50
OFF_NED_M = np.array([1.0, -1.0, 0.5])
POSE_COV = np.diag([4.0, 4.0, 4.0, 1e-4, 1e-4, 1e-4])


@cache
def flight() -> FlightFolder:
    return FlightFolder.open(shared_data("flights/ariel_b"))


def imported_setup(maps_dir: Path) -> NavigationSetup:
    """The flight's camera, with its map and elevation as the library makes them."""
    folder, library = flight(), MapLibrary(maps_dir)
    home = folder.meta.home
    assert home is not None
    assert folder.reference_path is not None
    assert folder.elevation_path is not None
    reference, elevation = (library.import_file(path).id for path in (folder.reference_path, folder.elevation_path))
    files = MapFiles(reference, library.raster_path(reference), library.raster_path(elevation), None)
    here = Place(math.radians(home.lat_deg), math.radians(home.lon_deg), home.alt_amsl_m)
    return build_setup(profile_of_flight(folder.meta), files, here)


def true_state(setup: NavigationSetup, t_us: int) -> NavigationState:
    """The vehicle at a time, ``OFF_NED_M`` from where it was."""
    truth = flight().truth()
    assert truth is not None
    at = int(np.argmin(np.abs(truth.t_unix_us - t_us)))
    q = q_from_euler(float(truth.roll_rad[at]), float(truth.pitch_rad[at]), float(truth.yaw_rad[at]))
    rotation = CameraAttitudeModel(setup.mount, Gimbal(setup.gimbal)).at(t_us, q, np.zeros(3)).ned_from_camera
    where = (float(values[at]) for values in (truth.lat_rad, truth.lon_rad, truth.alt_amsl_m))
    pos = setup.frame.ned_from_geodetic(*where) + OFF_NED_M
    lat, lon, alt = (float(value) for value in setup.frame.geodetic_from_ned(pos))
    ground_m = float(setup.ground.alt_amsl_m(pos[:1], pos[1:2])[0])
    return NavigationState(
        t_us, Mode.GPS, "attitude", lat, lon, alt, alt - ground_m, pos, np.zeros(3), q, q_from_matrix(rotation),
        POSE_COV[:3, :3], np.eye(3), POSE_COV[3:, 3:], POSE_COV, 0.5,
    )  # fmt: skip


class _Vehicle:
    id = "1"

    def __init__(self, setup: NavigationSetup) -> None:
        self.setup = setup

    def exposure_us(self, frame: FrameIdentity) -> int:
        return frame.t_us

    async def state_at(self, t_us: int) -> NavigationState:
        return true_state(self.setup, t_us)

    def assumption_at(self, _: int) -> None:
        return None


def registered_bundle(folder: Path, corrected: bool = False) -> bytes:
    """The evidence of a click that was registered and fused, by the station's own functions.

    With ``corrected`` a later fix has moved the state after that.
    """
    setup = imported_setup(folder / "maps")
    video, t_us = RecordedVideo.open(flight().video_path or Path()), flight().frame_time_us(FRAME_INDEX, None)
    assert t_us is not None
    picture = video.jpeg(FRAME_INDEX)
    maps = StationMaps(folder / "maps")
    keeper = EvidenceKeeper(folder / "evidence", maps, "test")

    async def kept() -> bytes:
        await maps.refresh()
        vehicle: Any = _Vehicle(setup)
        frame = FrameIdentity(7, t_us, video.width_px, video.height_px)
        body = NewTarget(vehicle_id="1", frame_id=7, u_px=500.0, v_px=300.0)
        sighting = await clicked_target(body, vehicle, frame)
        search = registered(sighting, picture)
        state = sighting.state
        if corrected:
            moved = state.pos_ned_m - 0.5 * OFF_NED_M
            lat, lon, alt = (float(value) for value in setup.frame.geodetic_from_ned(moved))
            state = replace(state, pos_ned_m=moved, lat_rad=lat, lon_rad=lon, alt_amsl_m=alt)
        found = refine(sighting, search, state)
        assert found.sighting is not None, found.registration
        better = replace(found.sighting, target=replace(found.sighting.target, version=2))
        await keeper.keep_again(better, "cam-1", picture)
        await keeper.confirm(better.target.id, 2)
        return (keeper.folder / f"{better.target.id}@2.zip").read_bytes()

    return asyncio.run(kept())
