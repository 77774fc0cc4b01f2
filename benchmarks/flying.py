"""A station of its own process and a simulated helicopter of another, for what is measured on the whole."""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import cv2
import httpx
import numpy as np

from backend.demo import free_udp_ports
from geodata.raster import open_raster, write_geotiff

MAP_GSD_M, MAP_SIDE_PX = 0.25, 4000  # 1 km2
START_S, END_S = 120.0, 10.0
Found = TypeVar("Found")
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+")


class CannotFlyError(Exception):
    """Station or simulator did not come up; the text says which and what it said."""


@dataclass(frozen=True, slots=True)
class FlyingStation:
    """A station with one aircraft whose estimator runs."""

    address: str
    pid: int

    def get(self, path: str) -> Any:
        """What a GET answers."""
        answer = httpx.get(self.address + path, timeout=30.0)
        answer.raise_for_status()
        return answer.json()

    def metric(self, name: str) -> float:
        """Sum of a metric over its labels, 0 where it has no value yet."""
        text = httpx.get(f"{self.address}/metrics", timeout=30.0).text
        found = re.findall(rf"^{re.escape(name)}(?:{{[^}}]*}})? ([0-9.eE+-]+)$", text, re.MULTILINE)
        return sum(float(value) for value in found)

    def resident_mb(self) -> float:
        """Resident memory of the station's process (not of the simulator)."""
        status = Path(f"/proc/{self.pid}/status").read_text()
        found = re.search(r"^VmRSS:\s+(\d+) kB", status, re.MULTILINE)
        return float(found[1]) * 1024 / 1e6 if found else float("nan")


@contextlib.contextmanager
def flying_station(folder: Path, seed: int = 5) -> Iterator[FlyingStation]:
    """Prepare a world with a map of 1 km2 at 0.25 m, start both, wait for the estimator; CannotFlyError."""
    world = folder / "world"
    _run_to_end(["sim", "demo", "--prepare", str(world), "--seed", str(seed)])
    fine_map(world / "reference.tif", folder / "map.tif")
    mavlink_port, video_port = free_udp_ports(2)
    with contextlib.ExitStack() as stack:
        serve = [
            "serve", "--port", "0", "--data-dir", str(folder / "data"), "--map", str(folder / "map.tif"),
            "--camera", str(world / "flight.json"), "--mavlink", f"udpin:127.0.0.1:{mavlink_port}",
            "--video", f"udp://127.0.0.1:{video_port}",
        ]  # fmt: skip
        station, said = stack.enter_context(started(serve, folder / "station.log"))
        address = wait_for(lambda: ADDRESS.search(said.read_text()), station, said)[0]
        fly = [
            "sim", "demo", "--seed", str(seed), "--mavlink", f"udpout:127.0.0.1:{mavlink_port}",
            "--video", f"udp://127.0.0.1:{video_port}",
        ]  # fmt: skip
        simulator, its_words = stack.enter_context(started(fly, folder / "simulator.log"))
        flying = FlyingStation(address, station.pid)
        wait_for(lambda: _mode_of(flying), simulator, its_words)
        yield flying


def fine_map(source: Path, target: Path) -> None:
    """The middle of a map at 0.25 m, whatever the source has."""
    with open_raster(source) as raster:
        bands, _ = raster.read(raster.levels[0], 0, 0, raster.width_px, raster.height_px)
        scale = raster.gsd_m / MAP_GSD_M
        image = np.moveaxis(bands[:3], 0, -1)
        transform, crs = raster.transform, raster.crs.to_wkt()
    rows, cols = (round(n * scale) for n in image.shape[:2])
    larger = cv2.resize(image, (cols, rows), interpolation=cv2.INTER_CUBIC)
    top, left = max(0, (rows - MAP_SIDE_PX) // 2), max(0, (cols - MAP_SIDE_PX) // 2)
    a, b, c, d, e, f = (float(value) for value in tuple(transform)[:6])
    fx, fy = image.shape[1] / cols, image.shape[0] / rows
    moved = (a * fx, b * fy, c + a * fx * left + b * fy * top, d * fx, e * fy, f + d * fx * left + e * fy * top)
    write_geotiff(target, larger[top : top + MAP_SIDE_PX, left : left + MAP_SIDE_PX], moved, crs)


def command(arguments: list[str]) -> list[str]:
    """A ``pilotage`` command line by this interpreter."""
    return [sys.executable, "-m", "backend.cli", *arguments]


def _mode_of(flying: FlyingStation) -> str | None:
    """The mode of the only vehicle once it has a map fix."""
    for vehicle in flying.get("/api/v1/vehicles"):
        answer = httpx.get(f"{flying.address}/api/v1/vehicles/{vehicle['id']}/state", timeout=30.0)
        if answer.status_code == 200 and answer.json()["last_fix_age_s"] is not None:
            return str(answer.json()["mode"])
    return None


def _run_to_end(arguments: list[str]) -> None:
    done = subprocess.run(command(arguments), stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise CannotFlyError(f"'pilotage {' '.join(arguments[:2])}' failed: {done.stderr.strip()[-300:]}")


@contextlib.contextmanager
def started(arguments: list[str], log: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """A command that runs until the end of the block, and the file of what it says."""
    with log.open("wb") as out:
        process = subprocess.Popen(command(arguments), stdin=subprocess.DEVNULL, stdout=out, stderr=out)
    try:
        yield process, log
    finally:
        process.terminate()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def wait_for(look: Callable[[], Found | None], process: subprocess.Popen[bytes], log: Path) -> Found:
    """What ``look`` gives once it gives something; CannotFlyError where the process ends or it takes too long."""
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        found = look()
        if found is not None:
            return found
        if process.poll() is not None:
            break
        time.sleep(0.2)
    raise CannotFlyError(f"not ready after {START_S:.0f} s; it said: {log.read_text(errors='replace')[-300:]}")
