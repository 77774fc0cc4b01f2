"""The simulated aircraft without its camera, in real time on a socket: light enough to fly beside a browser."""

from __future__ import annotations

import socket
import threading
import time
from pathlib import Path

from simulator.scenario import CameraSection, FlightSection, Scenario, WorldSection
from simulator.simulation import Simulation
from simulator.world.world import world_for

SEED = 7
_STEP_S = 0.005
_END_S = 10.0


class FlyingAircraft:
    """Flies from a thread of its own until closed, and hears what the station sends."""

    def __init__(self, port: int, worlds: Path) -> None:
        scenario = Scenario(
            name="small", duration_s=600.0, world=WorldSection(half_size_m=180.0, gsd_m=0.5),
            camera=CameraSection(width_px=96, height_px=72),
            flight=FlightSection(height_agl_m=(70.0, 80.0), waypoints=6, hover_stops=1),
        )  # fmt: skip
        world = world_for(scenario.world.spec(SEED), worlds)
        self._simulation = Simulation(scenario, world, SEED, time.time_ns() // 1000)
        self._station = ("127.0.0.1", port)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._thread.join(_END_S)

    def _run(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
            wire.bind(("127.0.0.1", 0))
            wire.setblocking(False)
            due_s = time.monotonic()
            while not self._ending.wait(max(0.0, due_s - time.monotonic())):
                # A machine that is busy elsewhere makes the flight slower, not the answers later.
                due_s = max(due_s, time.monotonic() - 0.1) + 4 * _STEP_S
                while (data := _heard(wire)) is not None:
                    self._simulation.receive(data)
                for _ in range(4):
                    for packet in self._simulation.step().packets:
                        wire.sendto(packet, self._station)


def _heard(wire: socket.socket) -> bytes | None:
    try:
        return wire.recv(2048)
    except BlockingIOError:
        return None
