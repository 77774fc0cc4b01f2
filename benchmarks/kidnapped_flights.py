"""The flights that starts without a position are cut from: flown once, without any network, and kept on the disk."""

from __future__ import annotations

import hashlib
import pickle
import tempfile
from dataclasses import astuple, dataclass
from pathlib import Path

import cv2
import numpy as np

from backend.link.events import SampleEvent
from backend.link.tlog import LinkReplay
from benchmarks.studies.flights import source_digest
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.types import Float, Sample
from simulator.scenario import CameraSection, Scenario, WorldSection
from simulator.sensors.camera import CameraView
from simulator.simulation import STEP_US, Simulation
from simulator.world.world import World, WorldSpec, world_for

FRAMES_PER_S = 5.0
JPEG_QUALITY = 90  # what a video codec leaves of a picture, roughly
FLOWN_BY = ("simulator", "estimator/geometry", "geodata", "backend/link")


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A recorded flight: samples in order, pictures as JPEG, truth by time (t_us, NED, yaw)."""

    samples: list[Sample]
    pictures: list[tuple[int, bytes]]
    truth: Float
    camera: Camera
    mount: Mount
    frame: LocalFrame


def spec_of(seed: int, half_size_m: float) -> WorldSpec:
    """The world of a seed as these flights use it."""
    return WorldSpec(seed=seed, half_size_m=half_size_m, gsd_m=0.3)


def world_of(seed: int, half_size_m: float, cache: Path) -> World:
    """The world of a seed, kept in ``cache``."""
    return world_for(spec_of(seed, half_size_m), cache)


def fly(world: World, seed: int, duration_s: float) -> Flight:
    """Fly the demo's aircraft over a world, without any network."""
    scenario = Scenario(
        duration_s=duration_s, gps_denied_s=(), world=WorldSection(gsd_m=world.spec.gsd_m),
        camera=CameraSection(frames_per_s=FRAMES_PER_S),
    )  # fmt: skip
    simulation = Simulation(scenario, world, seed, scenario.start_unix_us)
    section = scenario.camera
    view = CameraView(world, section.intrinsics(), seed, section.noise_std, section.vignetting)
    link = LinkReplay()
    samples: list[Sample] = []
    pictures: list[tuple[int, bytes]] = []
    truth = []
    for _ in range(round(duration_s * 1e6) // STEP_US):
        output = simulation.step()
        for packet in output.packets:
            events = link.feed(output.t_unix_us + 2_000, packet)
            samples += [event.sample for event in events if isinstance(event, SampleEvent)]
        if output.exposure is not None:
            seen = output.exposure
            grey = cv2.cvtColor(view.render(seen.camera_pos_ned_m, seen.ned_from_camera), cv2.COLOR_BGR2GRAY)
            _, packed = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            pictures.append((seen.t_unix_us, packed.tobytes()))
            truth.append((seen.t_unix_us, *seen.state.pos_ned_m, seen.state.yaw_rad))
    return Flight(samples, pictures, np.array(truth), section.intrinsics(), section.mount(), world.frame)


def flown(seed: int, half_size_m: float, duration_s: float, folder: Path, digest: str | None = None) -> Flight:
    """The flight of a seed, flown where the folder does not hold it whole."""
    by = digest or source_digest(FLOWN_BY)
    text = f"{astuple(spec_of(seed, half_size_m))} {duration_s} {FRAMES_PER_S} {JPEG_QUALITY} {by}"
    path = folder / "flights" / f"{seed}-{hashlib.sha256(text.encode()).hexdigest()[:12]}.pickle"
    if path.exists():
        with path.open("rb") as stored:
            flight = pickle.load(stored)  # noqa: S301  this program's own file, in the folder it was told to work in
        if not isinstance(flight, Flight):
            message = f"{path} does not hold a flight: remove it"
            raise TypeError(message)
        return flight
    flight = fly(world_of(seed, half_size_m, folder / "worlds"), seed, duration_s)
    path.parent.mkdir(parents=True, exist_ok=True)
    # under another name first: whoever is interrupted leaves no half flight
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".", delete=False) as file:
        pickle.dump(flight, file, protocol=5)
    Path(file.name).rename(path)
    return flight
