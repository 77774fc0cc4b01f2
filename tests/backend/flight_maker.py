"""Small flights for tests: telemetry, numbered pictures, estimate."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.recorder.folder import FlightWriter, RecordingPlan
from estimator.geometry.rotation import q_from_euler
from estimator.types import Mode, NavigationState
from geodata.flight_meta import CameraMeta, HomeMeta, VehicleMeta
from tests.backend.link.wire import Sender
from tests.backend.video.coded import encoded_frames

T0_US = 1_760_000_000_000_000
SIZE = (320, 240)
LAT_DEG, LON_DEG, GROUND_M, HEIGHT_M = 47.0, 8.0, 400.0, 100.0
CAMERA = CameraMeta(width_px=SIZE[0], height_px=SIZE[1], fx_px=300.0, fy_px=300.0, cx_px=159.5, cy_px=119.5)


def plan(**changes: object) -> RecordingPlan:
    facts: dict[str, object] = {
        "vehicle": VehicleMeta(type="helicopter", system_id=1), "camera": CAMERA,
        "home": HomeMeta(lat_deg=LAT_DEG, lon_deg=LON_DEG, alt_amsl_m=GROUND_M), "reference": None, "elevation": None,
        "map_offset_ne_m": (0.0, 0.0), "ground_alt_amsl_m": GROUND_M, "gps_denied": False, "t_start_us": T0_US,
    }  # fmt: skip
    return RecordingPlan(**{**facts, **changes})  # type: ignore[arg-type]


def state(t_us: int, north_m: float = 0.0, mode: Mode = Mode.GPS, yaw_rad: float = 0.0) -> NavigationState:
    """Level, ``north_m`` north of the home, 100 m above the ground, camera straight down."""
    return NavigationState(
        t_us, mode, "inertial", math.radians(LAT_DEG) + north_m / 6.368e6, math.radians(LON_DEG), GROUND_M + HEIGHT_M,
        HEIGHT_M, np.array([north_m, 0.0, -HEIGHT_M]), np.array([5.0, 0.0, 0.0]), q_from_euler(0.0, 0.0, yaw_rad),
        q_from_euler(0.0, 0.0, math.pi / 2), np.diag([1.0, 4.0, 2.25]), np.eye(3), np.eye(3), np.eye(6), 0.5,
    )  # fmt: skip


def telemetry(seconds: float) -> list[tuple[int, bytes]]:
    """Heartbeats, attitudes and GPS of a helicopter that flies north at 5 m/s."""
    sender = Sender()
    packets = []
    for n in range(round(seconds * 10)):
        t_us = T0_US + n * 100_000
        if n % 10 == 0:
            packets.append((t_us, sender.heartbeat()))
        packets.append((t_us, sender.attitude(n * 100)))
        if n % 2 == 0:
            lat = LAT_DEG + math.degrees(n * 0.5 / 6.368e6)
            message = dialect.MAVLink_gps_raw_int_message(
                n * 100_000, 3, round(lat * 1e7), round(LON_DEG * 1e7), 500_000, 80, 80, 500, 0, 12
            )
            packets.append((t_us, sender.pack(message)))
    return packets


def write_flight(folder: Path, seconds: float = 4.0, with_estimate: bool = True, close: bool = True) -> FlightWriter:
    """Record a flight into a new folder."""
    folder.mkdir(parents=True)
    writer = FlightWriter(folder, plan(), folder.name)
    for t_us, data in telemetry(seconds):
        writer.packet(t_us, data)
    for frame in encoded_frames(round(seconds * 25), SIZE, t0_us=T0_US):
        writer.frame(frame)
    if with_estimate:
        for n in range(round(seconds * 10)):
            writer.state(state(T0_US + n * 100_000, north_m=n * 0.5))
    writer.flush()
    if close:
        writer.close()
    return writer


def write_recording_with_faulty_video(folder: Path) -> None:
    """14 s of telemetry, 10 s of video, 2 s each: good, twice as large, of another shape, as before, frozen."""
    from tests.backend.replay.flown import packets

    folder.mkdir(parents=True)
    writer = FlightWriter(folder, plan(), folder.name)
    for t_us, data in packets(14.0):
        writer.packet(t_us, data)
    for part, size in enumerate((SIZE, (640, 480), (352, 288), SIZE)):
        for frame in encoded_frames(50, size, t0_us=T0_US + part * 2_000_000):
            writer.frame(frame)
    still = encoded_frames(1, SIZE)[0]  # a key frame: the same picture each time
    for n in range(50):
        writer.frame(replace(still, t_us=T0_US + 8_000_000 + n * 40_000))
    writer.close()
    (folder / "estimate.csv").unlink()
