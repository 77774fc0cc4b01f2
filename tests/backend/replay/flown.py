"""A flight whose every number is known: level, 5 m/s to the north, 100 m above flat ground."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from geodata.flight import FlightFolder, TlogWriter, write_clicks_csv, write_flight_json, write_truth_csv
from geodata.flight_meta import CameraMeta, FlightMeta, HomeMeta, MapMeta, VehicleMeta
from geodata.flight_tables import Click, Truth
from tests.backend.flight_maker import CAMERA, GROUND_M, HEIGHT_M, LAT_DEG, LON_DEG, T0_US
from tests.backend.link.wire import Sender

SPEED_M_S = 5.0
EARTH_M = 6.368e6  # radius of the meridian at 47 degrees, to a part in a thousand


def lat_deg_at(t_us: int) -> float:
    return LAT_DEG + math.degrees(SPEED_M_S * (t_us - T0_US) / 1e6 / EARTH_M)


def packets(seconds: float, gps_east_m: Callable[[int], float] = lambda _: 0.0) -> list[tuple[int, bytes]]:
    """Attitude at 20 Hz, barometer at 10 Hz, GPS at 5 Hz, which errs to the east by ``gps_east_m(t_us)``."""
    wire, found = Sender(), []
    for n in range(round(seconds * 20)):
        t_us = T0_US + n * 50_000
        t_ms = n * 50
        if n % 20 == 0:
            found.append((t_us, wire.heartbeat()))
        found.append((t_us, wire.pack(dialect.MAVLink_attitude_message(t_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))))
        if n % 2 == 0:
            pressure_hpa = 1013.25 * (1.0 - 2.25577e-5 * (GROUND_M + HEIGHT_M)) ** 5.25588
            found.append((t_us, wire.pack(dialect.MAVLink_scaled_pressure_message(t_ms, pressure_hpa, 0.0, 1500))))
        if n % 4 == 0:
            lon_deg = LON_DEG + math.degrees(gps_east_m(t_us) / (EARTH_M * math.cos(math.radians(LAT_DEG))))
            fix = dialect.MAVLink_gps_raw_int_message(
                t_ms * 1000, 3, round(lat_deg_at(t_us) * 1e7), round(lon_deg * 1e7), round((GROUND_M + HEIGHT_M) * 1e3),
                80, 120, round(SPEED_M_S * 100), 0, 12,
            )  # fmt: skip
            found.append((t_us, wire.pack(fix)))
    return found


def write_known_flight(
    folder: Path, seconds: float = 12.0, *, truth: bool = True, clicks: tuple[Click, ...] = (),
    camera: CameraMeta | None = CAMERA, gps_denied: tuple[tuple[int, int], ...] = (),
    log: Sequence[tuple[int, bytes]] | None = None,
) -> FlightFolder:  # fmt: skip
    folder.mkdir(parents=True)
    write_flight_json(folder, FlightMeta(
        schema="pilotage.flight/1", name="known", vehicle=VehicleMeta(type="helicopter", system_id=1), camera=camera,
        home=HomeMeta(lat_deg=LAT_DEG, lon_deg=LON_DEG, alt_amsl_m=GROUND_M),
        map=MapMeta(ground_alt_amsl_m=GROUND_M), gps_denied=gps_denied,
    ))  # fmt: skip
    with TlogWriter(folder / "telemetry.tlog") as out:
        for t_us, data in packets(seconds) if log is None else log:
            out.write(t_us, data)
    if truth:
        t = T0_US + 100_000 * np.arange(round(seconds * 10))
        nothing = np.zeros(len(t))
        lat = np.radians([lat_deg_at(int(at)) for at in t])
        lon, alt = np.full(len(t), math.radians(LON_DEG)), np.full(len(t), GROUND_M + HEIGHT_M)
        vel = np.tile([SPEED_M_S, 0.0, 0.0], (len(t), 1))
        write_truth_csv(folder / "truth.csv", Truth(t, lat, lon, alt, nothing, nothing, nothing, vel))
    if clicks:
        write_clicks_csv(folder / "clicks.csv", clicks)
    return FlightFolder.open(folder)
