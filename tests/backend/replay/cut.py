"""The beginning of a recorded flight, as a flight folder of its own."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

from geodata.flight import FlightFolder
from tests.shared_data import shared_data


def cut_flight(folder: Path, name: str, seconds: float) -> FlightFolder:
    """Write the first seconds of an evaluation flight whose pictures are files; returns the folder, opened."""
    flight = FlightFolder.open(shared_data(f"flights/{name}"))
    start_us, _ = flight.telemetry_span()
    end_us = start_us + round(seconds * 1e6)
    folder.mkdir(parents=True)
    for file in ("flight.json", "reference.tif", "elevation.tif", "clicks.csv", "truth.csv", "targets_truth.csv"):
        shutil.copyfile(flight.path / file, folder / file)
    header, *rows = (flight.path / "frames.csv").read_text().splitlines()
    rows = [row for row in rows if int(row.split(",")[1]) <= end_us]
    (folder / "frames.csv").write_text("\n".join([header, *rows]) + "\n")
    (folder / "frames").mkdir()
    for row in rows:
        picture = f"{int(row.split(',')[0]):06d}.jpg"
        shutil.copyfile(flight.path / "frames" / picture, folder / "frames" / picture)
    with (folder / "telemetry.tlog").open("wb") as log:
        for t_us, packet in flight.telemetry():
            if t_us <= end_us:
                log.write(struct.pack(">Q", t_us) + packet)
    return FlightFolder.open(folder)
