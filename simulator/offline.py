"""Flies a scenario as fast as the machine allows and records it; the same seed gives the same folder."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from simulator.random_streams import rng_for
from simulator.recording import FlightRecorder
from simulator.scenario import Scenario
from simulator.sensors.camera import CameraView
from simulator.simulation import STEP_US, Simulation
from simulator.world.world import World

_LINK_DELAY_US = 2_000
_LINK_JITTER_US = 3_000.0


def record_offline(
    scenario: Scenario,
    world: World,
    seed: int,
    folder: Path,
    stop: threading.Event,
    progress: Callable[[float], None] = lambda _: None,
) -> float:
    """Fly until the scenario's end or until ``stop`` is set; returns the seconds flown."""
    simulation = Simulation(scenario, world, seed, scenario.start_unix_us)
    section = scenario.camera
    view = CameraView(world, section.intrinsics(), seed, section.noise_std, section.vignetting, simulation.pad)
    link = rng_for(seed, "link")
    last_us = 0
    with FlightRecorder(folder, scenario, world, simulation.home_ned_m, seed, simulation.pad) as recorder:
        for step in range(round(scenario.duration_s * 1e6) // STEP_US):
            if stop.is_set():
                break
            output = simulation.step()
            for packet in output.packets:
                arrival_us = output.t_unix_us + _LINK_DELAY_US + int(link.exponential(_LINK_JITTER_US))
                # The link delivers in order: a late packet holds up those behind it.
                last_us = max(last_us, arrival_us)
                recorder.write_packet(last_us, packet)
            if output.exposure is not None:
                picture = view.render(output.exposure.camera_pos_ned_m, output.exposure.ned_from_camera)
                recorder.write_picture(output.exposure, picture)
            if step % 200 == 0:
                progress(simulation.elapsed_us / 1e6)
    return simulation.elapsed_us / 1e6
