"""Simulated flights in a cache with their worlds: the same scenario, seed and simulator give the same folder."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import threading
from pathlib import Path

import cv2

from simulator.offline import record_offline
from simulator.scenario import Scenario
from simulator.world.world import world_for

ROOT = Path(__file__).resolve().parents[2]
SIMULATOR_SOURCES = ("simulator", "estimator/geometry", "geodata")
ESTIMATOR_SOURCES = (
    "estimator",
    "geodata",
    "backend/link",
    "backend/navigation",
    "backend/replay",
    "benchmarks/studies",
)


def source_digest(folders: tuple[str, ...]) -> str:
    """Digest of code and calibrations in some folders, so that nothing of older ones is taken for the present's."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted((*(ROOT / folder).rglob("*.py"), *(ROOT / folder).rglob("*.toml"))):
            digest.update(path.relative_to(ROOT).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def flight_key(scenario: Scenario, seed: int, simulator_digest: str) -> str:
    """Name of a flight's folder in the cache."""
    text = f"{scenario.model_dump_json()} {seed} {simulator_digest}"
    return f"{scenario.name}-{seed}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def flown(scenario: Scenario, seed: int, cache: Path, simulator_digest: str) -> Path:
    """The folder of a flight, simulated where the cache does not hold it whole."""
    folder = cache / "flights" / flight_key(scenario, seed, simulator_digest)
    if (folder / "flight.json").exists():
        return folder
    cv2.setNumThreads(1)
    folder.parent.mkdir(parents=True, exist_ok=True)
    # under another name first: whoever is interrupted leaves no half flight
    partial = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        world = world_for(scenario.world.spec(seed), cache / "worlds")
        record_offline(scenario, world, seed, partial, threading.Event())
        try:
            partial.rename(folder)
        except OSError:
            if not (folder / "flight.json").exists():
                raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder
