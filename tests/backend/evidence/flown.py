"""A flight over hills with an oblique, distorted camera, and clicks on it through the service."""

from __future__ import annotations

import contextlib
import math
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pyproj
from affine import Affine

from backend.recorder.folder import FlightWriter
from estimator.geometry.rotation import q_from_matrix
from estimator.types import Float, NavigationState
from geodata.flight_meta import CameraMeta
from tests.backend.flight_maker import GROUND_M, LAT_DEG, LON_DEG, SIZE, T0_US, plan, state, telemetry
from tests.backend.station_runner import PATIENCE_S, RunningStation, running_station
from tests.backend.video.coded import encoded_frames
from tests.geodata.rasters import texture, write

SECONDS = 3.0
STRIDE = 75  # frames of the flight: ids of the first epoch begin there
VEHICLE = "replay-hills"
CAMERA = CameraMeta(
    width_px=640, height_px=480, fx_px=520.0, fy_px=515.0, cx_px=322.0, cy_px=236.5,
    distortion=(-0.21, 0.06, 1e-3, -7e-4, -0.004),
)  # fmt: skip


def hills(path: Path, seed_m: float = 0.0) -> Path:
    """An elevation model of 1.2 km about the home, 5 m between heights, rising and falling by some 20 m."""
    heights = (GROUND_M - 10.0 + seed_m + texture(240, 240, 0.0, 25.0)).astype(np.float32)
    x, y = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True).transform(LON_DEG, LAT_DEG)
    return write(path, heights[np.newaxis], transform=Affine(5.0, 0.0, x - 600.0, 0.0, -5.0, y + 600.0), nodata=-9999.0)


def oblique(t_us: int, north_m: float) -> NavigationState:
    """Looks north-east and 35 degrees below the horizon, rolled by 4 degrees; errors are correlated."""
    azimuth, down, roll = math.radians(40.0), math.radians(35.0), math.radians(4.0)
    axis = np.array([math.cos(azimuth) * math.cos(down), math.sin(azimuth) * math.cos(down), math.sin(down)])
    right = np.cross([0.0, 0.0, 1.0], axis)
    right /= np.linalg.norm(right)
    below = np.cross(axis, right)
    x = math.cos(roll) * right + math.sin(roll) * below
    turned = np.stack((x, np.cross(axis, x), axis), axis=-1)
    return replace(
        state(t_us, north_m=north_m), q_ned_from_camera=q_from_matrix(turned), cov_camera_pose=pose_covariance()
    )


def pose_covariance() -> Float:
    std = np.array([1.2, 0.9, 1.6, 0.008, 0.011, 0.02])
    correlation = np.eye(6)
    correlation[0, 4] = correlation[4, 0] = 0.5
    correlation[1, 3] = correlation[3, 1] = -0.4
    cov: Float = correlation * std[:, np.newaxis] * std
    return cov


def write_hilly_flight(folder: Path) -> Path:
    """Record the flight, three seconds, with its elevation and a reference; returns the elevation file given."""
    elevation = hills(folder.parent.parent / "dtm.tif")
    folder.mkdir(parents=True)
    writer = FlightWriter(folder, plan(camera=CAMERA, elevation=elevation), folder.name)
    for t_us, data in telemetry(SECONDS):
        writer.packet(t_us, data)
    for frame in encoded_frames(round(SECONDS * 25), SIZE, t0_us=T0_US):
        writer.frame(frame)
    for n in range(round(SECONDS * 10)):
        writer.state(oblique(T0_US + n * 100_000, n * 0.5))
    writer.close()
    return elevation


@contextlib.asynccontextmanager
async def hilly_station(data_dir: Path) -> AsyncIterator[RunningStation]:
    """A station that replays the flight, its estimate read; the flight is made when it is not there."""
    if not (data_dir / "flights" / "hills").exists():
        write_hilly_flight(data_dir / "flights" / "hills")
    async with running_station(data_dir) as running:
        await replay(running)
        yield running


async def replay(running: RunningStation) -> None:
    started = await running.client.post("/api/v1/flights/hills/replay", json={"speed": 16.0})
    assert started.status_code == 201, started.text
    async with running.stream() as socket:
        for _ in range(round(PATIENCE_S * 20)):
            replays = (await running.client.get("/api/v1/replays")).json()
            if replays[0]["progress"] is None:
                return
            await socket.recv()
    raise AssertionError("the estimate was not read")


def click_body(frame: int = 30, u_px: float = 100.25, v_px: float = 190.75, **changes: Any) -> dict[str, Any]:
    return {"vehicle_id": VEHICLE, "frame_id": STRIDE + frame, "u_px": u_px, "v_px": v_px, **changes}


async def click(
    running: RunningStation, frame: int = 30, u_px: float = 100.25, v_px: float = 190.75, **choice: Any
) -> dict[str, Any]:
    made = await running.client.post("/api/v1/targets", json=click_body(frame, u_px, v_px, **choice))
    assert made.status_code == 201, made.text
    return dict(made.json())


async def evidence_zip(running: RunningStation, target_id: str, query: str = "") -> httpx.Response:
    return await running.client.get(f"/api/v1/targets/{target_id}/evidence{query}")
